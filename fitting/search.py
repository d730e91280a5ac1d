"""From nothing to the minimum: a coarse grid on few pixels, refined on more, finished on all.

Every local minimum of the grid is followed, up to `BASINS`: the lowest on a sample may not be the lowest
on all pixels, and a second one that is as good as the first is to be known. All of it is one program.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from fitting.limits import Grid
from fitting.project import Linearised, Problem, compressed_residual, cost, linearise, predict
from fitting.sharding import over_devices
from fitting.solver import BoundedLevenbergMarquardt
from fitting.stream import Block, sum_over_blocks
from fitting.weights import Judge, robust_scale

__all__ = ["ALL", "APART", "Found", "minimise", "search"]

SAMPLE = 512
"""Pixels of each image that the grid is judged by."""
BATCH = 16
"""Nodes of the grid that are judged at once."""
ALL = np.iinfo(np.int32).max
"""Blocks: the first refinement looks at one, the last at all."""
BASINS = 3
APART = 0.02
"""Of u: minima that are no further from each other are one."""
MAX_STEPS = 64
MAX_ROUNDS = 4
MIN_ROUNDS, MAX_JUDGED = 5, 60
"""Of weights and gains that follow the solution."""

Solver = optx.AbstractLeastSquaresSolver
T = TypeVar("T")


class Found(eqx.Module):
    """The minimum: u, which of it is dependent, the fit around it, the steps taken.

    `basins` are the minima that were followed, and `costs` what is left at each: on all pixels
    where it could be the best, else infinite.
    """

    u: Float[Array, "q"]
    dependent: Bool[Array, "q"] | None
    at: Linearised
    steps: Int[Array, ""]
    converged: Bool[Array, ""]
    basins: Float[Array, "M q"]
    costs: Float[Array, "M"]
    judge: Judge | None
    gains: Float[Array, "K"] | None


def search(problem: Problem, grid: Grid, box: tuple[Array, Array], solver: Solver | None) -> Found:
    """Minimise over u in its box, from the basins of the grid, compiled for the platform."""
    return _program(solver)(problem, grid, box)


@cache
def _program(solver: Solver | None) -> Callable[..., Found]:
    return over_devices(partial(minimise, solver=solver))


class _State(NamedTuple):
    """What is known of each basin, and of the best one; `job` counts refinements."""

    u: Float[Array, "M q"]
    k: Float[Array, "M C p"]
    sampled: Float[Array, "M"]
    finished: Float[Array, "M"]
    best: Found
    judge: Judge | None
    gains: Float[Array, "K"] | None
    job: Int[Array, ""]
    round: Int[Array, ""]
    steps: Int[Array, ""]


def minimise(
    problem: Problem, grid: Grid, box: tuple[Array, Array], solver: Solver | None = None
) -> Found:
    """Minimise over u in its box, from the basins of the grid; to be traced.

    First every basin is refined on one block. Then the best, and those that might be as good, are
    finished on all pixels: again where another l has become the largest, for where this one reached
    0 it was no bound to it; where k moved far from the reference that residuals are taken from; and
    until weights and gains stand still, where they follow the solution.
    """
    starts, k, count = _basins(problem, grid)
    follows = problem.judge is not None or problem.gains is not None

    def refined(state: _State) -> _State:
        sampling = state.job < count
        order = jnp.argsort(state.sampled)
        j = jnp.where(sampling, state.job, order[jnp.maximum(state.job - count, 0)])
        u = state.u[j]
        model = problem.model.depending_on(u)
        part = replace(
            problem,
            model=model,
            reference=state.k[j],
            most_blocks=jnp.where(sampling, 1, ALL),
            judge=state.judge,
            gains=state.gains,
        )
        u, at, steps, converged = _descend(part, u, box, sampling, solver)
        left = jnp.where(jnp.isfinite(at.cost), at.cost, jnp.inf)
        # Rounding takes about eps of the reference's cost from the cost.
        settled = 1e3 * jnp.finfo(u.dtype).eps * at.reference_cost <= at.cost
        moved = jnp.max(jnp.abs(at.k - part.reference), initial=0)
        close = min(1e-3, 10 * float(jnp.finfo(u.dtype).eps) ** 0.5)
        settled |= moved <= close * jnp.max(jnp.abs(at.k), initial=0)
        if model.dependent is not None:
            settled &= jnp.all(problem.model.depending_on(u).dependent == model.dependent)
        judge, gains = problem.judge, problem.gains
        if follows:
            still = 10 * _tolerance(u.dtype)
            settled = (state.round >= MIN_ROUNDS) & (moved <= still * jnp.max(at.k, initial=0))
            settled &= jnp.max(jnp.abs(u - state.u[j]), initial=0) <= still
        if judge is not None:
            scale = _noise(part, u, at.k)
            judge = Judge(judge.weighting, u, at.k, scale, (state.round + 1).astype(u.dtype))
        if gains is not None:
            assert at.gains is not None
            assert state.gains is not None
            gains = jnp.where(sampling, gains, at.gains.best)
            settled &= jnp.max(jnp.abs(gains - state.gains)) <= still
        settled |= sampling | (state.round + 1 >= (MAX_JUDGED if follows else MAX_ROUNDS))
        finished = jnp.where(sampling, state.finished, state.finished.at[j].set(left))
        here = Found(
            u, model.dependent, at, steps, converged, state.u, state.finished, judge, gains
        )
        better = ~sampling & (left <= jnp.min(finished))
        return _State(
            u=state.u.at[j].set(u),
            k=state.k.at[j].set(at.k),
            sampled=jnp.where(sampling, state.sampled.at[j].set(left), state.sampled),
            finished=finished,
            best=_where(better, here, state.best),
            # What follows the solution starts anew with each job.
            judge=_where(settled, problem.judge, judge),
            gains=_where(settled, problem.gains, gains),
            job=state.job + settled.astype(int),
            round=jnp.where(settled, 0, state.round + 1),
            steps=state.steps + steps,
        )

    def unfinished(state: _State) -> Bool[Array, ""]:
        best = jnp.argmin(state.sampled)
        rival = state.sampled <= 2 * state.sampled[best]
        apart = jnp.any(jnp.abs(state.u - state.u[best][None]) > APART, axis=-1)
        return state.job < count + 1 + jnp.sum(rival & apart)

    state = lax.while_loop(unfinished, refined, _nothing(problem, starts, k))
    return replace(state.best, steps=state.steps, basins=state.u, costs=state.finished)


def _basins(
    problem: Problem, grid: Grid
) -> tuple[Float[Array, "M q"], Float[Array, "M C p"], Int[Array, ""]]:
    """The local minima of the grid, the lowest first, with their k; and how many of them are any."""
    sample = replace(
        problem,
        groups=tuple(group.sample(SAMPLE) for group in problem.groups),
    )
    nodes = grid.nodes
    costs, k = lax.map(lambda u: cost(sample, u), nodes, batch_size=min(BATCH, len(nodes)))
    costs = jnp.where(jnp.isfinite(costs), costs, jnp.finfo(costs.dtype).max)
    lowest = jnp.all(costs[:, None] <= jnp.where(grid.adjacent, costs[None], jnp.inf), axis=1)
    order = jnp.argsort(jnp.where(lowest, costs, jnp.inf))[:BASINS]
    return nodes[order], k[order], jnp.minimum(jnp.sum(lowest), len(order))


def _nothing(problem: Problem, starts: Float[Array, "M q"], k: Float[Array, "M C p"]) -> _State:
    """The state before any refinement: the basins' starts."""
    infinite = jnp.full(len(starts), jnp.inf, starts.dtype)
    model = problem.model.depending_on(starts[0])
    shape = jax.eval_shape(linearise, replace(problem, model=model), starts[0])
    at = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shape)
    zero = jnp.zeros((), int)
    return _State(
        u=starts,
        k=k,
        sampled=infinite,
        finished=infinite,
        best=Found(
            u=starts[0],
            dependent=model.dependent,
            at=at,
            steps=zero,
            converged=jnp.zeros((), bool),
            basins=starts,
            costs=infinite,
            judge=problem.judge,
            gains=problem.gains,
        ),
        judge=problem.judge,
        gains=problem.gains,
        job=zero,
        round=zero,
        steps=zero,
    )


def _noise(problem: Problem, u: Float[Array, "q"], k: Float[Array, "C p"]) -> Float[Array, ""]:
    """The noise level at u and k, whatever outliers there are, from a sample of all images."""
    assert problem.judge is not None
    weighting = problem.judge.weighting
    residuals, used = [], []
    for group, gains in problem.each_group():
        sample = group.sample(max(SAMPLE, 8192 // len(group.weight)))

        def of_block(block: Block, gain: Float[Array, ""] | None) -> tuple[Array, Array]:
            predicted = predict(problem.model.columns(u, block, gain), k)
            residual = weighting.standardised(predicted, block.observed)
            known = jnp.broadcast_to(block.weight[None] > 0, residual.shape)
            return residual, known if block.clipped is None else known & ~block.clipped

        # Of one block the sum is the block itself.
        r, known = sum_over_blocks(sample, of_block, jnp.ones((), jnp.int32), gains)
        residuals.append(r.ravel())
        used.append(known.ravel())
    return robust_scale(jnp.concatenate(residuals), jnp.concatenate(used))


def _where(condition: Bool[Array, ""], new: T, old: T) -> T:
    """Leaf by leaf."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)


def _tolerance(dtype: jnp.dtype) -> float:
    """To which a search can tell whether it has arrived."""
    eps = float(jnp.finfo(dtype).eps)
    return eps**0.5 if dtype == jnp.float64 else 100 * eps


def _descend(
    problem: Problem,
    u: Float[Array, "q"],
    box: tuple[Float[Array, "q"], Float[Array, "q"]],
    sampling: Bool[Array, ""],
    solver: Solver | None,
) -> tuple[Float[Array, "q"], Linearised, Int[Array, ""], Bool[Array, ""]]:
    """From u to the minimum near it; on a sample not further than a sample can tell."""
    lower, upper = box
    if u.size == 0:
        return u, linearise(problem, u), jnp.zeros((), int), jnp.ones((), bool)
    tolerance: Any = jnp.where(sampling, 1e-4, _tolerance(u.dtype)).astype(u.dtype)

    # What a sample found is close: Gauss and Newton's own step, along valleys too.
    damping: Any = jnp.where(sampling, 1e-2, 1e-9).astype(u.dtype)
    ours = BoundedLevenbergMarquardt(tolerance, tolerance, lower, upper, damping=damping)

    def residual(u: Float[Array, "q"], problem: Problem) -> tuple[Array, Linearised]:
        # Ours stays in the box by itself.
        return compressed_residual(u if solver is None else jnp.clip(u, lower, upper), problem)

    solution: Any = optx.least_squares(
        residual,  # type: ignore[arg-type]
        ours if solver is None else solver,
        u,
        args=problem,
        has_aux=True,
        max_steps=MAX_STEPS,
        throw=False,
    )
    converged = jnp.asarray(solution.result == optx.RESULTS.successful)
    u = jnp.maximum(problem.model.whole(jnp.clip(solution.value, lower, upper)), lower)
    return u, solution.aux, solution.stats["num_steps"], converged & jnp.isfinite(solution.aux.cost)
