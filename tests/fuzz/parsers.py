"""Tries to break every parser with bytes that no program would write.

    PYTHONPATH=tests python -m fuzz.parsers --cases 100000 [--only png obj] [--seed 1] [--keep FOLDER]

Coverage-guided by `atheris` (the extra `fuzz`) where it is installed, and by random damage alone, which
is said, where it is not. Each parser has a process of its own, so that a crash of a library, an endless
loop (60 seconds) or a hunger for memory (4 GiB) is a finding like any other. What breaks a parser is kept
in a file; exit status 1 says that there is one.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

__all__ = ["Outcome", "fuzz", "main"]

TESTS = Path(__file__).parents[1]
sys.path += [str(TESTS / name) for name in ("", "io", "geometry", "fitting")]  # as pytest has them
SECONDS, MEGABYTES = 60, 4096
GUIDED = find_spec("atheris") is not None


class Outcome(NamedTuple):
    """How one parser fared."""

    parser: str
    cases: int
    read: int
    refused: int
    seconds: float
    findings: tuple[str, ...]
    """What was said of each input that broke it, and where it is kept."""


def fuzz(parser: str, cases: int, seed: int, keep: Path) -> Outcome:
    """So many cases for one parser, in a process of its own."""
    keep.mkdir(parents=True, exist_ok=True)
    before = set(keep.iterdir())
    words = [parser, str(cases), str(seed), str(keep)]
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-m", "fuzz.one_parser", *words, folder],
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            env={**os.environ, "JAX_PLATFORMS": "cpu", "PYTHONPATH": os.pathsep.join(sys.path)},
        )
    seconds = time.perf_counter() - started
    counts = [line.split() for line in done.stderr.splitlines() if line.startswith("counts ")]
    read, refused = map(int, counts[-1][1:]) if counts else (0, 0)
    said = [line for line in done.stderr.splitlines() if "Error" in line or "ERROR" in line]
    findings = [f"{path}: {said[-1] if said else ''}" for path in set(keep.iterdir()) - before]
    if done.returncode and not findings:
        findings = [f"status {done.returncode}: {done.stderr[-500:]}"]
    return Outcome(parser, read + refused, read, refused, seconds, tuple(findings))


def main() -> int:
    """Fuzz every parser and print a table."""
    from malformed.cases import formats

    names = [format.name for format in formats()]
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("--cases", type=int, default=100_000, help="for each parser")
    words.add_argument("--seed", type=int, default=1)
    words.add_argument("--only", nargs="+", choices=names, default=names)
    words.add_argument("--keep", type=Path, default=Path("fuzz-findings"))
    given = words.parse_args()
    print("guided by coverage (atheris)" if GUIDED else "random damage alone: no atheris here")
    print(f"{'parser':22} {'cases':>8} {'read':>8} {'refused':>8} {'s':>6}  findings")
    broken = 0
    for name in given.only:
        outcome = fuzz(name, given.cases, given.seed, given.keep)
        print(
            f"{name:22} {outcome.cases:8} {outcome.read:8} {outcome.refused:8}"
            f" {outcome.seconds:6.0f}  {len(outcome.findings)}",
            *outcome.findings,
            sep="\n  " if outcome.findings else "",
            flush=True,
        )
        broken += len(outcome.findings)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
