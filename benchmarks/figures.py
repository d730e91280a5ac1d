"""Figures with the bounds they must keep, and how they are measured: each in a process of its own."""

import json
import os
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

__all__ = ["ROOT", "Figure", "answer", "ask", "median", "paired_ratio", "table"]

ROOT = Path(__file__).resolve().parents[1]


class Figure(NamedTuple):
    """One measured figure. `least` or `most` is what it must keep; a figure without either is told."""

    name: str
    value: float
    unit: str = ""
    least: float | None = None
    most: float | None = None

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
        bounds = (("at least", figure.least), ("at most", figure.most))
        asked = ", ".join(f"{word} {bound:.3g}" for word, bound in bounds if bound is not None)
        holds = {None: "", True: "yes", False: "**no**"}[figure.holds]
        cells = (figure.name, f"{figure.value:.3g} {figure.unit}".strip(), asked, holds)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def ask(module: str, *, precision: int = 32, **request: Any) -> dict[str, Any]:
    """What a module of this folder measures, in a fresh process in that precision."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "JAX_ENABLE_X64": str(int(precision == 64)),
    }
    command = [sys.executable, "-P", "-m", f"benchmarks.{module}", json.dumps(request)]
    done = subprocess.run(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        raise SystemExit(f"benchmarks.{module} stopped with status {done.returncode}")
    return json.loads(done.stdout.splitlines()[-1])


def answer(measure: Callable[..., dict[str, Any]]) -> None:
    """The other end of `ask`: measure what was requested, and print it as the last line."""
    print(json.dumps(measure(**json.loads(sys.argv[1]))))


def median(values: Iterable[float]) -> float:
    """The median, as a plain number."""
    return float(statistics.median(values))


def paired_ratio(a: Sequence[float], b: Sequence[float]) -> float:
    """The median of a / b, each pair measured one after the other."""
    return median(x / y for x, y in zip(a, b, strict=True))
