"""Does every guard of the package have a test that fails without it?

    cd tests && python -m fuzz.without_guards

Takes one guard after the other out of a copy of the package, and runs the tests that hold it. Prints a
table; exits with 1 if a guard survives, or if one is not in the list.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from fuzz.guards import GUARDS, PACKAGE, unlisted, without

__all__ = ["failing"]

ROOT = PACKAGE.parent


def failing(tests: Iterable[str], copy: Path) -> str | None:
    """The first of some tests that fails in a copy of the repository."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "--tb=no", *tests]
    done = subprocess.run(command, cwd=copy, capture_output=True, text=True)
    if done.returncode == 0:
        return None
    failed = re.search(r"^FAILED (.+?)(?: - .*)?$", done.stdout, re.MULTILINE)
    if done.returncode != 1 or failed is None:  # no test said so
        raise RuntimeError(f"{' '.join(command)}: {done.stdout}{done.stderr}")
    return failed[1]


def main() -> int:
    """Try them all."""
    for place in (missing := unlisted()):
        print(f"{place}: this guard is in no list")
    survivors = 0
    print("| guard | fails without it |\n|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for name in (PACKAGE.name, "fitting", "tests"):
            shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "pyproject.toml", copy)
        if test := failing(sorted({test for guard in GUARDS for test in guard.tests}), copy):
            print(f"{test} fails with all guards in place")
            return 1
        for guard in GUARDS:
            with without(guard, copy / PACKAGE.name):
                test = failing(guard.tests, copy)
            survivors += test is None
            print(f"| {guard.name} | {test or 'NONE: it survives'} |", flush=True)
    return 1 if survivors or missing else 0


if __name__ == "__main__":
    sys.exit(main())
