"""Known error: every formula against 50 digits, and rendering in float32 against float64.

    python -m benchmarks.errors                 the formulas, the renders, and the forms of a lobe
    python -m benchmarks.errors --only renders

Errors of formulas are the largest over so many inputs a stratum, in units in the last place (see
`benchmarks.formulas`); those of renders parts of the image's maximum. The forms of a lobe are timed in
turn, in CPU time (`taskset -c 1` for one core), and a ratio is the median of the rounds' own.
"""

import argparse
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, NamedTuple

import jax
import numpy as np
from mpmath import mp, mpf

from benchmarks import lobe_forms, renders
from benchmarks.formulas import FORMULAS, Formula, Stratum

__all__ = ["COUNT", "HEADS", "Errors", "Row", "measure", "rows"]

COUNT = 300
"""Inputs a stratum."""
STEP = mpf(10) ** -20
"""Of a difference quotient in 50 digits, whose error is its square."""


class Errors(NamedTuple):
    """The largest errors over a stratum's inputs, in units in the last place."""

    value: float
    derivative: float | None


def measure(
    formula: Formula, stratum: Stratum, dtype: Any, count: int, *, derivatives: bool = True
) -> Errors:
    """Ours against 50 digits, at `count` inputs that are exact in a precision."""
    planes = stratum.draw(np.random.default_rng(0), count)
    planes = [np.asarray(plane, dtype) for plane in planes]
    points = [[mpf(float(x)) for x in point] for point in zip(*planes, strict=True)]
    known = [_flat(formula.exact(*point)) for point in points]
    with jax.enable_x64(dtype == np.float64):
        ours = _compiled(formula.ours) if formula.traced else formula.ours
        value = _worst(_rows(ours(*planes), count), known, formula.floor, dtype)
        if stratum.derivative is None or not derivatives:
            return Errors(value, None)
        rows = _rows(_slopes_of(formula.ours, len(planes))(*planes), count)
    known = [_slopes(formula, point) for point in points]
    return Errors(value, _worst(rows, known, formula.floor, dtype))


@cache
def _compiled(ours: Callable[..., Any]) -> Callable[..., Any]:
    """A formula of planes, one program for all strata."""
    return jax.jit(jax.vmap(ours))


@cache
def _slopes_of(ours: Callable[..., Any], inputs: int) -> Callable[..., Any]:
    """Its derivatives in every input."""
    return jax.jit(jax.vmap(jax.jacfwd(ours, range(inputs))))


def _flat(x: Any) -> list[mpf]:
    return [y for part in x for y in _flat(part)] if isinstance(x, list | tuple) else [mpf(x)]


def _rows(tree: Any, count: int) -> np.ndarray:
    """A point's numbers, side by side."""
    leaves = [np.asarray(leaf).reshape(count, -1) for leaf in jax.tree.leaves(tree)]
    return np.concatenate(leaves, axis=1)


def _slopes(formula: Formula, point: list[mpf]) -> list[mpf]:
    """All partial derivatives, in the order of `jacfwd`'s leaves: output by output."""

    def moved(k: int, by: mpf) -> list[mpf]:
        return _flat(formula.exact(*point[:k], point[k] + by, *point[k + 1 :]))

    def quotients(k: int) -> list[mpf]:
        step = STEP * max(abs(point[k]), mpf(1))
        pairs = zip(moved(k, step), moved(k, -step), strict=True)
        return [(after - before) / (2 * step) for after, before in pairs]

    by_input = [quotients(k) for k in range(len(point))]
    return [by[output] for output in range(len(by_input[0])) for by in by_input]


def _worst(found: np.ndarray, known: list[list[mpf]], floor: float, dtype: Any) -> float:
    """The largest difference, in units in the last place of a point's largest number, or the floor."""
    if not np.isfinite(found).all():
        return float("inf")
    errors = []
    for row, exact in zip(found, known, strict=True):
        scale = max(*map(abs, exact), mpf(floor))
        unit = float(np.finfo(dtype).eps) * mpf(2) ** (mp.frexp(scale)[1] - 1)
        pairs = zip(row, exact, strict=True)
        errors.append(float(max(abs(mpf(float(a)) - b) for a, b in pairs) / unit))
    return max(errors)


class Row(NamedTuple):
    """The errors of a formula over a stratum, in both precisions."""

    formula: Formula
    stratum: Stratum
    single: Errors
    double: Errors

    @property
    def cells(self) -> list[str]:
        """Names, values with their bound, derivatives with theirs."""
        single, double, stratum = self.single, self.double, self.stratum
        numbers = (
            *(single.value, double.value, stratum.value),
            *(single.derivative, double.derivative, stratum.derivative),
        )
        return [
            self.formula.name,
            stratum.name,
            *("" if x is None else f"{x:.3g}" for x in numbers),
        ]

    @property
    def holds(self) -> bool:
        """Whether no error is larger than its bound."""
        pairs = [(each.value, self.stratum.value) for each in (self.single, self.double)]
        pairs += [(each.derivative, self.stratum.derivative) for each in (self.single, self.double)]
        return all(x <= bound for x, bound in pairs if x is not None and bound is not None)


HEADS = (
    *("formula", "inputs", "float32", "float64", "at most"),
    *("derivative, float32", "float64", "at most"),
)


def rows(count: int) -> Iterator[Row]:
    """Of every formula and stratum, at so many inputs."""
    for formula in FORMULAS:
        for stratum in formula.strata:
            found = (measure(formula, stratum, t, count) for t in (np.float32, np.float64))
            yield Row(formula, stratum, *found)


def formulas(count: int) -> str:
    """The table of formulas, as Markdown."""
    lines = [HEADS, ("---",) * len(HEADS), *(row.cells for row in rows(count))]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> None:
    """Measure, and print tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    tables = {
        "formulas": lambda: formulas(options.count),
        "renders": renders.table,
        "lobes": lambda: lobe_forms.table(options.rounds),
    }
    parser.add_argument("--only", choices=tables, help="one of the tables")
    parser.add_argument("--count", type=int, default=COUNT, help="inputs a stratum")
    parser.add_argument("--rounds", type=int, default=15, help="of timing")
    options = parser.parse_args()
    for name, table in tables.items():
        if options.only in (None, name):
            print(f"{name}\n\n{table()}\n", flush=True)


if __name__ == "__main__":
    main()
