"""Many cases for every public function: are values and derivatives finite?

    cd tests && python -m fuzz.functions --cases 100000

Every function is compiled once for each precision, and given `--batch` cases at a draw of Hypothesis's.
Functions whose names hold a word of `--only` are tried alone. Prints a table and each function's smallest
failure; exits with 1 if there was one.
"""

import argparse
import sys
import time
from typing import Any

import jax
import numpy as np
from contract import CONTRACT, Contract, failure, finite
from hypothesis import HealthCheck, given, settings
from strategies import Deck, decks

__all__ = ["tried"]


class NotFinite(Exception):
    """One case."""


def tried(contract: Contract, dtype: Any, cases: int, batch: int) -> tuple[int, str | None]:
    """How many cases were tried, and the first that failed, as small as Hypothesis makes it."""
    program = finite(contract)
    count = 0

    @given(decks(batch, dtype))
    @settings(
        max_examples=-(-cases // batch),
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    def draw(deck: Deck) -> None:
        nonlocal count
        drawn = contract.cases(deck)
        fine = np.asarray(program(drawn))
        count += batch
        if found := failure(drawn, fine):
            raise NotFinite(found)

    try:
        draw()
    except NotFinite as error:
        return count, str(error)
    return count, None


def main() -> int:
    """Try them all."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--cases", type=int, default=100_000, help="for each function and precision"
    )
    parser.add_argument("--batch", type=int, default=1000, help="cases at a draw")
    parser.add_argument("--precision", choices=("32", "64", "both"), default="both")
    parser.add_argument("--only", nargs="*", default=[""], metavar="WORD")
    options = parser.parse_args()
    jax.config.update("jax_numpy_dtype_promotion", "strict")
    jax.config.update("jax_numpy_rank_promotion", "raise")
    failures = []
    print("| function | precision | cases | seconds | |\n|---|---|---|---|---|")
    for names, contract in CONTRACT.items():
        name = ", ".join(names)
        if not any(word in name for word in options.only):
            continue
        for bits in (32, 64) if options.precision == "both" else (int(options.precision),):
            start = time.perf_counter()
            with jax.enable_x64(bits == 64):
                dtype = np.dtype(f"float{bits}")
                count, found = tried(contract, dtype, options.cases, options.batch)
            seconds = time.perf_counter() - start
            said = "finite" if found is None else "NOT FINITE"
            print(f"| {name} | {bits} | {count} | {seconds:.0f} | {said} |", flush=True)
            if found is not None:
                failures.append(f"{name}, float{bits}: {found}")
    print("", *failures, sep="\n")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
