"""The benchmark suite: every figure beside what is asked of it and beside the committed baseline.

    python -m benchmarks.suite                          all groups
    python -m benchmarks.suite skipping mesh            some
    python -m benchmarks.suite fit-speed:rounds=7,start=random
    python -m benchmarks.suite --update                 and makes what was measured the new baseline

Groups: GROUPS.

Ratios are medians over rounds in which all that is compared takes its turn. The extras `compare` and
`rivals` install the rivals; those that are absent are left out, by name. `trade-offs` and `fit-speed`
draw error against run time (the extra `notebook`). Exit status 1 says that a figure is worse than its
baseline by more than its tolerance; one that does not reach what is asked is marked.
"""

import argparse
import json
import os
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from benchmarks.figures import ROOT, Figure

BASELINES = ROOT / "benchmarks" / "baselines.json"
GROUPS = {
    "rivals": "rivals",
    "scale": "scale",
    "skipping": "skipping",
    "many-lights": "many_lights",
    "memory": "memory",
    "mesh": "mesh",
    "sizes": "sizes",
    "first-call": "first_call",
    "trade-offs": "trade_offs",
    "fit-speed": "fit_speed",
    "fit-truths": "fit_accuracy",
    "fit-noise": "fit_noise",
    "fit-first": "first_fit",
    "fit-memory": "fit_memory",
    "held-out": "held_out",
    "maps": "maps",
    "certificates": "certificates",
}
"""A module of this folder each, with `run` and `figures`."""


def parse(argument: str) -> tuple[str, dict[str, Any]]:
    """A group and the options of its `run`."""
    name, _, rest = argument.partition(":")
    if name not in GROUPS:
        raise argparse.ArgumentTypeError(f"{name!r} is no group: choose from {', '.join(GROUPS)}")
    options = {}
    for pair in filter(None, rest.split(",")):
        key, _, value = pair.partition("=")
        options[key] = int(value) if value.isdigit() else value
    return name, options


def table(figures: list[Figure], before: dict[str, Any]) -> tuple[str, bool]:
    """The figures as Markdown, and whether none is worse than before."""
    lines = ["| figure | measured | before | asked | |", "|---|---|---|---|---|"]
    fine = True
    for figure in figures:
        old = before.get(figure.name)
        remarks = [] if figure.holds is not False else ["**short of what is asked**"]
        if old is not None and is_worse(figure, old["value"]):
            remarks.append("**worse**")
            fine = False
        was = "" if old is None else f"{old['value']:.3g}"
        cells = (figure.name, figure.shown, was, figure.asked, ", ".join(remarks))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines), fine


def is_worse(figure: Figure, before: float) -> bool:
    """By more than the tolerance; NaN is worse than any number."""
    slack = figure.tolerance * abs(before)
    if figure.better == "less":
        return not figure.value <= before + slack
    return not figure.value >= before - slack


def baseline(figure: Figure) -> dict[str, Any]:
    """What is committed of a figure."""
    return {
        "value": float(f"{figure.value:.4g}"),
        "unit": figure.unit,
        "better": figure.better,
        "tolerance": figure.tolerance,
    }


def main() -> None:
    """Measure, print, draw, compare."""
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").replace("GROUPS", ", ".join(GROUPS)),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("groups", nargs="*", type=parse, metavar="group[:option=value,...]")
    parser.add_argument("--update", action="store_true", help="make this the new baseline")
    parser.add_argument("--baselines", type=Path, default=BASELINES, metavar="FILE")
    options = parser.parse_args()
    known = json.loads(options.baselines.read_text()) if options.baselines.exists() else {}
    print(f"{len(os.sched_getaffinity(0))} cores, load {os.getloadavg()[0]:.1f}", flush=True)
    fine = True
    for name, chosen in options.groups or [(name, {}) for name in GROUPS]:
        print(f"measuring {name}", file=sys.stderr)
        module = import_module(f"benchmarks.{GROUPS[name]}")
        results = module.run(**chosen)
        if not results:
            continue
        figures = module.figures(results)
        shown, as_before = table(figures, known.get(name, {}))
        print(f"\n### {name}\n\n{shown}", flush=True)
        fine &= as_before
        draw(name, results)
        if options.update:
            known[name] = {figure.name: baseline(figure) for figure in figures}
            options.baselines.write_text(json.dumps(known, indent=1) + "\n")
    sys.exit(not (fine or options.update))


def draw(name: str, results: dict[str, Any]) -> None:
    """The picture of a group, beside this file."""
    from benchmarks import plots

    if name in plots.DRAWN:
        picture = ROOT / "benchmarks" / f"{name}.png"
        plots.DRAWN[name](results, picture)
        print(f"wrote {picture.relative_to(ROOT)}", file=sys.stderr)


if __name__ == "__main__":
    main()
