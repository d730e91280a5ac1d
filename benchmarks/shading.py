"""Shading: nanoseconds per pixel and light, forward and with the gradient, beside the error.

    python -m benchmarks.shading                     against NumPy and the commit before
    python -m benchmarks.shading --against v0.1.0    against another version

Every figure is a median over rounds in which all that is compared takes its turn, so that a machine
that slows down slows all alike; ratios are medians of the rounds' own ratios. Float32, on as many
cores as the process may use (`taskset -c 0` for one). Pixels are foreground pixels.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from benchmarks.scenes import Case

ROOT = Path(__file__).resolve().parents[1]
CASES = (
    Case(lights=4, coloured=False),
    Case(lights=4),
    Case(lights=16),
    Case(lights=4, attenuated=False),
    Case(size=2048, lights=4),
)


class Worker:
    """A version of the package in a process of its own."""

    def __init__(self, tree: Path) -> None:
        # The benchmark is this checkout's, whatever version of the package it measures.
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "JAX_ENABLE_X64": "0"}
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "benchmarks.worker", str(tree)],
            cwd=ROOT,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self, what: str, case: Case) -> dict[str, Any]:
        """One measurement."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        print(
            json.dumps({"what": what, "case": case._asdict()}), file=self.process.stdin, flush=True
        )
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit(f"the worker stopped with status {self.process.wait()}")
        return json.loads(line)

    def nanoseconds(self, what: str, case: Case) -> float:
        """Per pixel and light."""
        answer = self.ask(what, case)
        return 1e9 * answer["seconds"] / answer["evaluations"]


def checkout(revision: str, stack: ExitStack) -> Path:
    """A revision's files in a folder that goes away with the stack."""
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "tree"
    subprocess.run(
        ["git", "-C", str(ROOT), "worktree", "add", "--detach", str(folder), revision],
        check=True,
        capture_output=True,
    )
    stack.callback(
        subprocess.run,
        ["git", "-C", str(ROOT), "worktree", "remove", "--force", str(folder)],
        check=True,
    )
    return folder


def measure(case: Case, now: Worker, before: Worker, rounds: int) -> dict[str, Any]:
    """The row of one case."""
    error = now.ask("error", case)
    turns = {
        "forward": (now, "forward"),
        "forward before": (before, "forward"),
        "numpy": (now, "numpy"),
        "gradient": (now, "gradient"),
        "gradient before": (before, "gradient"),
        "squared error": (now, "squared error"),
    }
    if not case.attenuated:  # the gradient is measured in the attenuation's constants too
        turns = {name: turns[name] for name in ("forward", "forward before", "numpy")}
    seen: dict[str, list[float]] = {name: [] for name in turns}
    for _ in range(rounds):
        for name, (worker, what) in turns.items():
            seen[name].append(worker.nanoseconds(what, case))

    def ratio(a: str, b: str) -> float | None:
        if a not in seen:
            return None
        return statistics.median(x / y for x, y in zip(seen[a], seen[b], strict=True))

    return {
        "case": case._asdict(),
        "nanoseconds": {name: statistics.median(times) for name, times in seen.items()},
        "numpy / forward": ratio("numpy", "forward"),
        "before / forward": ratio("forward before", "forward"),
        "before / gradient": ratio("gradient before", "gradient"),
        "error": error,
    }


def table(rows: list[dict[str, Any]]) -> str:
    """The rows as Markdown."""
    head = (
        "| size | lights | forward | numpy | numpy / forward | before / forward | gradient"
        " | before / gradient | by mean_squared_error | error | error of numpy |"
    )
    lines = [head, "|" + "---|" * head.count(" | ") + "---|"]
    for row in rows:
        case, times = row["case"], row["nanoseconds"]
        kind = "RGB" if case["coloured"] else "one colour"
        kind += "" if case["attenuated"] else ", no attenuation"

        def show(value: float | None, form: str = ".2f") -> str:
            return "-" if value is None else format(value, form)

        cells = [
            f"{case['size']} x {case['size']}",
            f"{case['lights']}, {kind}",
            show(times["forward"]),
            show(times["numpy"], ".0f"),
            show(row["numpy / forward"], ".0f"),
            show(row["before / forward"]),
            show(times.get("gradient")),
            show(row["before / gradient"]),
            show(times.get("squared error")),
            show(row["error"]["ours"], ".1e"),
            show(row["error"]["numpy"], ".1e"),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Measure, and print a table (or JSON)."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--against", default="HEAD~1", metavar="REVISION", help="an earlier version"
    )
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    options = parser.parse_args()
    with ExitStack() as stack:
        now, before = Worker(ROOT), Worker(checkout(options.against, stack))
        rows = []
        for case in CASES:
            print(f"measuring {case}", file=sys.stderr)
            rows.append(measure(case, now, before, options.rounds))
    if options.json:
        print(
            json.dumps(
                {"schema": "diffshade.benchmark/1", "against": options.against, "rows": rows}
            )
        )
    else:
        print(
            f"nanoseconds per pixel and light, float32, {len(os.sched_getaffinity(0))} cores;"
            f" before = {options.against}\n"
        )
        print(table(rows))


if __name__ == "__main__":
    main()
