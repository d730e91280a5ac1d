"""Figures with the bounds they must keep, and how they are measured: in turn, in a process of its own."""

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

__all__ = ["ROOT", "Figure", "ask", "in_turn", "median", "paired_ratio", "table"]

ROOT = Path(__file__).resolve().parents[1]
Name = TypeVar("Name")


class Figure(NamedTuple):
    """One measured figure. `least` or `most` is what it must keep; a figure without either is told.

    By more than the `tolerance`, a part of it, it should not get worse: times on a busy machine do by
    a third, counts by nothing.
    """

    name: str
    value: float
    unit: str = ""
    least: float | None = None
    most: float | None = None
    tolerance: float = 0.3

    @property
    def better(self) -> str:
        """Which way it should go."""
        return "less" if self.least is None else "more"

    @property
    def shown(self) -> str:
        """Its value in words."""
        return f"{self.value:.3g} {self.unit}".strip()

    @property
    def asked(self) -> str:
        """Its bounds in words."""
        bounds = (("at least", self.least), ("at most", self.most))
        return ", ".join(f"{word} {bound:.3g}" for word, bound in bounds if bound is not None)

    @property
    def holds(self) -> bool | None:
        """Whether the bounds are kept; None where there are none. NaN keeps no bound."""
        if self.least is None and self.most is None:
            return None
        above = self.least is None or self.value >= self.least
        return above and (self.most is None or self.value <= self.most)


def table(figures: Iterable[Figure]) -> str:
    """The figures as Markdown."""
    lines = ["| figure | measured | asked | holds |", "|---|---|---|---|"]
    for figure in figures:
        holds = {None: "", True: "yes", False: "**no**"}[figure.holds]
        cells = (figure.name, figure.shown, figure.asked, holds)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def ask(
    module: str, *, precision: int = 32, cores: int | None = None, **request: Any
) -> dict[str, Any]:
    """What a module of this folder measures, in a fresh process in that precision, on so many cores."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "JAX_ENABLE_X64": str(int(precision == 64)),
    }
    command = [sys.executable, "-P", "-m", "benchmarks.figures", module, json.dumps(request)]
    confined = None
    if cores is not None:  # the last ones: the first has most of the system's own work
        own = sorted(os.sched_getaffinity(0))[-cores:]
        confined = partial(os.sched_setaffinity, 0, own)
    done = subprocess.run(
        command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True, preexec_fn=confined
    )
    if done.returncode:
        raise SystemExit(f"benchmarks.{module} stopped with status {done.returncode}")
    return json.loads(done.stdout.splitlines()[-1])


def in_turn(
    calls: Mapping[Name, Callable[[], Any]],
    rounds: int,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[Name, list[float]]:
    """Seconds of each call in every round, in which all take their turn; before, each compiles.

    A machine that slows down slows all alike: ratios are those of one round.
    """
    for call in calls.values():
        call()
    seen: dict[Name, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            before = clock()
            call()
            seen[name].append(clock() - before)
    return seen


def median(values: Iterable[float]) -> float:
    """The median, as a plain number."""
    return float(statistics.median(values))


def paired_ratio(a: Sequence[float], b: Sequence[float]) -> float:
    """The median of a / b, each pair measured one after the other."""
    return median(x / y for x, y in zip(a, b, strict=True))


if __name__ == "__main__":  # the other end of `ask`: what was requested, as the last line
    measure = import_module(f"benchmarks.{sys.argv[1]}").measure
    print(json.dumps(measure(**json.loads(sys.argv[2]))))
