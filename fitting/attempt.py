"""One model fitted: searched on a sample, its minima finished on all pixels, and the lowest taken."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import jax
import numpy as np

from diffshade.fusion import search_options
from diffshade.kept import Kept
from fitting.basins import APART, Basins, Box, Solver
from fitting.likelihood import Likelihood, rounding
from fitting.limits import Grid, Limits
from fitting.model import Model
from fitting.observation import Group
from fitting.observed import Observed
from fitting.outliers import without_outliers
from fitting.polish import Minimum, polish
from fitting.project import Problem
from fitting.weights import Weighting, is_robust

__all__ = ["Attempt", "attempted", "searched"]

RIVAL = 2.0
"""Times the least that is left of the sample: a minimum of no more could be the best on all pixels.
Where outliers are to lose their weight any could: what leaves least may be a lobe of a few of them."""


@dataclass(frozen=True, eq=False)
class Attempt:
    """One model searched: its limits, the minimum, other minima, and how likely the best is."""

    limit: Limits
    minimum: Minimum
    others: tuple[Minimum, ...]
    likelihood: Likelihood
    steps: int


def searched(
    observed: Observed,
    model: Model,
    limit: Limits,
    weighting: Weighting | None,
    solver: Solver | None,
) -> Basins:
    """The minima of a model within its limits, as a sample has them; NumPy arrays in float64."""
    grid, box = limit.searched(observed.dtype)
    edges = limit.lower.astype(observed.dtype), limit.upper.astype(observed.dtype)
    problem = Problem(model, *edges, np.asarray(observed.norm, observed.dtype))
    basins = _program(solver)(problem, observed.sample, grid, box)
    if weighting is not None and is_robust(weighting):
        # What least squares bends to is taken out, and all is searched anew.
        u, k = basins.u[0], basins.k[0]
        rest = without_outliers(model, observed.sample, weighting, u, k)
        basins = _program(solver)(problem, rest, grid, box)
    return Basins(
        u=np.asarray(basins.u, float),
        k=np.asarray(basins.k, float),
        cost=np.asarray(basins.cost, float),
        converged=np.asarray(basins.converged),
        steps=np.asarray(basins.steps),
    )


def attempted(
    observed: Observed,
    model: Model,
    limit: Limits,
    basins: Basins,
    weighting: Weighting | None,
    gains: bool,
) -> Attempt:
    """Fit a model within its limits, from the minima that a search found."""
    problem = Problem(model, limit.lower, limit.upper, np.asarray(observed.norm))
    ones = np.ones(len(observed.photographs)) if gains else None
    minima = [
        polish(problem, observed, limit.box, basins.u[j], basins.k[j], weighting, ones)
        for j in _worth(basins, np.inf if is_robust(weighting) else RIVAL * float(basins.cost[0]))
    ]
    minima.sort(key=lambda minimum: minimum.left(observed.count))
    best = minima[0]
    parameters = int((~limit.held).sum()) + model.direction_count + 1  # the noise
    parameters += len(observed.photographs) - 1 if gains else 0
    least = rounding(best.square, observed.dtype)
    likelihood = Likelihood.of(best.cost, least, parameters, observed.count)
    steps = int(basins.steps) + sum(found.steps for found in minima)
    return Attempt(limit, best, tuple(minima[1:]), likelihood, steps)


def _searched(
    problem: Problem,
    groups: tuple[Group, ...],
    grid: Grid,
    box: Box,
    solver: Solver | None = None,
) -> tuple[Any, ...]:
    """`search` as a tuple; imported where it is traced, and not before."""
    from fitting.search import search

    found = search(problem, groups, grid, box, solver)
    return found.u, found.k, found.cost, found.converged, found.steps


_search = Kept(_searched, search_options)


@cache
def _program(solver: Solver | None) -> Callable[..., Basins]:
    of_solver = partial(_searched, solver=solver)
    program = _search if solver is None else jax.jit(of_solver, compiler_options=search_options())
    return lambda *arguments: Basins(*program(*arguments))


def _worth(basins: Basins, most: float) -> list[int]:
    """The best, and those that are not the same and leave no more than the `most`."""
    chosen: list[int] = []
    for j, (u, cost) in enumerate(zip(basins.u, basins.cost, strict=True)):
        apart = all(np.abs(u - basins.u[i]).max(initial=0) > APART for i in chosen)
        if not chosen or (cost <= most and apart and np.isfinite(cost)):
            chosen.append(j)
    return chosen
