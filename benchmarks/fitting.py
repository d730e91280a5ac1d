"""Fitting: every figure that it must show, side by side with the rivals and with its bounds.

    python -m benchmarks.fitting all
    python -m benchmarks.fitting speed --rounds 7 --start random
    python -m benchmarks.fitting plots

Each command prints a table, and puts what it measured into one JSON file, from which `plots` draws a
picture beside it and `table` prints all again. Times are medians over rounds in which all methods take
their turn, ratios medians of the rounds' own ratios. `speed` needs the extra `compare`, `plots` the
extra `notebook`. Exit status 1 says that a bound is not kept.
"""

import argparse
import json
import os
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.figures import ROOT, table

RESULTS = ROOT / "benchmarks" / "fitting.json"


class Command(NamedTuple):
    """A module of this folder with `run` and `figures`, and the options that its `run` takes."""

    module: str
    options: Callable[[argparse.Namespace], dict[str, Any]]


COMMANDS = {
    "speed": Command(
        "fit_speed", lambda o: {"truths": o.truths, "rounds": o.rounds, "start": o.start}
    ),
    "truths": Command("fit_accuracy", lambda o: {"count": o.count, "size": o.size}),
    "noise": Command("fit_noise", lambda o: {"draws": o.draws, "kinds": tuple(o.kinds)}),
    "first": Command("first_fit", lambda o: {"rounds": o.rounds}),
    "held-out": Command("held_out", lambda o: {"folder": o.data}),
    "memory": Command("fit_memory", lambda o: {}),
}


def parse() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("command", choices=(*COMMANDS, "plots", "table", "all"))
    parser.add_argument("--results", type=Path, default=RESULTS, help="the JSON file")
    parser.add_argument("--rounds", type=int, default=5, help="speed, first")
    parser.add_argument("--truths", type=int, default=5, help="speed: how many")
    parser.add_argument(
        "--start",
        choices=("guess", "random"),
        default="guess",
        help="speed: where the rivals start; ours needs no start",
    )
    parser.add_argument("--count", type=int, default=200, help="truths: how many")
    parser.add_argument("--size", type=int, default=128, help="truths: pixels across")
    parser.add_argument("--draws", type=int, default=1000, help="noise: how many of each kind")
    parser.add_argument(
        "--kinds",
        nargs="+",
        choices=("gaussian", "outliers", "clipped"),
        default=("gaussian", "outliers", "clipped"),
        help="noise",
    )
    parser.add_argument(
        "--data",
        type=Path,
        default=ROOT.parent / "shared" / "data" / "diligent_ball",
        help="held-out: the photographs",
    )
    return parser.parse_args()


def main() -> None:
    """Measure, keep, print."""
    options = parse()
    results = json.loads(options.results.read_text()) if options.results.exists() else {}
    chosen = (
        tuple(COMMANDS)
        if options.command == "all"
        else tuple(name for name in (options.command,) if name in COMMANDS)
    )
    for name in chosen:
        print(f"measuring {name}", file=sys.stderr)
        command = COMMANDS[name]
        run = import_module(f"benchmarks.{command.module}").run
        results[name] = run(**command.options(options))
        options.results.write_text(json.dumps(results, indent=1) + "\n")
    if options.command in ("plots", "all"):
        from benchmarks.plots import run_time_against_error

        picture = options.results.with_suffix(".png")
        run_time_against_error(results["speed"], picture)
        print(f"wrote {picture}", file=sys.stderr)
    shown = tuple(name for name in COMMANDS if name in results)
    if options.command in COMMANDS:
        shown = chosen
    if options.command == "plots":
        return
    print(f"{len(os.sched_getaffinity(0))} cores\n")
    rows = [
        figure
        for name in shown
        if results[name]
        for figure in import_module(f"benchmarks.{COMMANDS[name].module}").figures(results[name])
    ]
    print(table(rows))
    sys.exit(any(figure.holds is False for figure in rows))


if __name__ == "__main__":
    main()
