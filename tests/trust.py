"""The trust report: what was tried to break the package, and what broke.

    PYTHONPATH=tests:. python -m trust                      an hour and a half on two cores
    PYTHONPATH=tests:. python -m trust --cases 2000 --fits 500 --only functions errors

- functions: finite values and derivatives of every public function (`contract`), in both precisions
- parsers: every parser under damaged files (`fuzz.parsers`)
- errors: every formula against 50 digits, renders in float32 against float64 (`benchmarks.errors`)
- scenes: hard scenes to render and to fit (`stress.score`)
- malformed: malformed files of every format and class, refused in one line (`malformed`)
- kills: a fit of maps killed at random moments and resumed, bit for bit (`kills`)
- soak: many fits in one process (`stress.soak`)

Exit status 1 says that something failed; each failure stands below its part.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import jax
import numpy as np

TESTS = Path(__file__).parent
sys.path += [str(TESTS / name) for name in ("io", "geometry", "fitting")]  # as pytest has them

__all__ = ["PARTS", "Options", "main"]

Options = argparse.Namespace
Lines = Iterator[tuple[str, list[str]]]
"""Lines of a report, each with the failures that it stands for."""


def functions(options: Options) -> Lines:
    """Of every public function."""
    from contract import CONTRACT, NO_FLOATS
    from fuzz.functions import tried

    total = 0
    for bits in (32, 64):
        dtype = np.dtype(f"float{bits}")
        with jax.enable_x64(bits == 64):
            for names, contract in CONTRACT.items():
                count, failure = tried(contract, dtype, options.cases, min(options.cases, 1000))
                total += count
                name = f"{', '.join(names)}, float{bits}"
                if failure is not None:
                    yield f"{name}: not finite", [f"{name}: {failure}"]
    rest = f"{len(NO_FLOATS)} more have nothing to differentiate"
    yield f"{sum(map(len, CONTRACT))} public names covered ({rest}), {total} cases tried", []


def parsers(options: Options) -> Lines:
    """Of every format."""
    from fuzz.parsers import GUIDED, fuzz
    from malformed.cases import formats

    yield "guided by coverage" if GUIDED else "by random damage: no atheris here", []
    for form in formats():
        found = fuzz(form.name, options.cases, options.seed, options.keep)
        row = f"{form.name}: {found.cases} files, {found.read} read, {found.refused} refused"
        yield row, list(found.findings)


def errors(options: Options) -> Lines:
    """Of every formula, and of renders."""
    from benchmarks.errors import COUNT, HEADS, rows
    from benchmarks.renders import figures

    yield ", ".join(HEADS), []
    for row in rows(COUNT):
        said = ", ".join(row.cells)
        yield said, [] if row.holds else [said]
    for figure in figures():
        said = f"{figure.name}: {figure.shown}, {figure.asked or 'no bound'}"
        yield said, [said] if figure.holds is False else []


def scenes(options: Options) -> Lines:
    """To render and to fit."""
    from stress.score import results

    passed = tried = 0
    for result in results(large=options.large):
        tried, passed = tried + 1, passed + result.passed
        if not result.passed:
            kind, detail, _ = result.verdict
            row = f"{result.task} {result.scene.name}, float{result.bits}: {kind}, {detail}"
            yield row, [row]
    yield f"{passed} of {tried} as they are due", []


def malformed(options: Options) -> Lines:
    """By class, and by format."""
    from malformed.case import CLASSES
    from malformed.cases import cases, formats, refusal

    every = list(cases())
    failures = []
    for case in every:
        with tempfile.TemporaryDirectory() as folder:
            try:
                refusal(case, Path(folder))
            except AssertionError as error:
                failures.append(f"{case.format.name}, {case.kind}, {case.name}: {error}")
    kinds = Counter(case.kind for case in every)
    yield ", ".join(f"{kind} {kinds[kind]}" for kind in CLASSES), []
    by_format = Counter(case.format.name for case in every)
    yield ", ".join(f"{form.name} {by_format[form.name]}" for form in formats()), []
    yield f"{len(every) - len(failures)} of {len(every)} refused", failures


def kills(options: Options) -> Lines:
    """Of one fit."""
    from kills import kills_survived

    with tempfile.TemporaryDirectory() as folder:
        survived = kills_survived(options.kills, options.seed, Path(folder))
    row = f"{survived} of {options.kills} kills survived"
    yield row, [] if survived == options.kills else [row]


def soak(options: Options) -> Lines:
    """In a process of their own, whose memory is theirs alone."""
    words = ["-m", "stress.soak", "--fits", str(options.fits), "--seed", str(options.seed)]
    path = os.pathsep.join(sys.path)
    with subprocess.Popen(
        [sys.executable, *words],
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            yield line.strip(), []
    yield "steady" if not process.returncode else "not steady", ["soak"] * bool(process.returncode)


PARTS: dict[str, Callable[[Options], Lines]] = {
    part.__name__: part for part in (functions, parsers, errors, scenes, malformed, kills, soak)
}


def guarded(part: Callable[[Options], Lines], options: Options) -> Lines:
    """A part, whose exception is a failure, after which the others follow."""
    try:
        yield from part(options)
    except Exception as error:
        traceback.print_exc()
        yield "not finished", [f"{type(error).__name__}: {error}"]


def main() -> int:
    """Print the parts, and what failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=10_000, help="for each function and parser")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--fits", type=int, default=10_000, help="of the soak")
    parser.add_argument("--large", action="store_true", help="hard scenes of gigabytes as well")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=Path("fuzz-findings"))
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    options = parser.parse_args()
    jax.config.update("jax_numpy_dtype_promotion", "strict")
    jax.config.update("jax_numpy_rank_promotion", "raise")
    failures = 0
    for name in options.only:
        print(f"\n## {name}", flush=True)
        for line, broken in guarded(PARTS[name], options):
            print("-", line, *(f"\n  FAILED: {each}" for each in broken), flush=True)
            failures += len(broken)
    print(f"\n{failures} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
