"""From nothing to the minima near the best: a coarse grid over a sample of the pixels, and descents.

Every local minimum of the grid is followed, up to `BASINS`: the lowest on a sample may not be the lowest
on all pixels, and a second one that is as good as the first is to be known. All of it is one program.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax import lax
from jaxtyping import Bool, Float

from fitting.arrays import Array
from fitting.basins import Basins, Box, Solver
from fitting.coarse import minima
from fitting.columns import Blocks, Images, images_of
from fitting.limits import Grid
from fitting.observation import Group
from fitting.project import (
    Problem,
    best_linear,
    compress,
    gram,
    linearise,
    observed_gram,
)
from fitting.solver import BoundedLevenbergMarquardt

__all__ = ["descend", "search", "tolerance"]

COARSE = 512
"""Points of the sample that are enough to judge the grid by."""
BASINS = 3
MAX_STEPS = 24
AGAIN = 3


def search(
    problem: Problem,
    groups: tuple[Group, ...],
    grid: Grid,
    box: Box,
    solver: Solver | None = None,
) -> Basins:
    """Minimise over u in its box what is left of the groups' images, from the minima of the grid."""
    coarse = tuple(
        group.part(slice(None, None, max(group.weight.shape[1] // COARSE, 1))) for group in groups
    )
    starts, there = minima(problem, images_of(coarse, problem.model.material), grid, BASINS)
    images = images_of(groups, problem.model.material)

    count, least = jnp.sum(there), (tolerance(starts.dtype) * problem.norm) ** 2
    zero, some = jnp.zeros((), int), len(starts)
    nothing = Basins(
        starts,
        jnp.zeros((some, *problem.lower.shape), starts.dtype),
        jnp.full(some, jnp.inf, starts.dtype),
        jnp.zeros(some, bool),
        zero,
    )

    def unfinished(state: tuple[Array, Array, Basins]) -> Bool[Array, ""]:
        # Where all that is left is rounding, nothing can be better.
        j, again, so_far = state
        return (j < count) & ((again > 0) | (jnp.min(so_far.cost) > least))

    def followed(state: tuple[Array, Array, Basins]) -> tuple[Array, Array, Basins]:
        j, again, so_far = state
        start = so_far.u[j]
        u, k, cost, converged, steps = descend(problem, images, start, box, solver)
        found = Basins(
            so_far.u.at[j].set(u),
            so_far.k.at[j].set(k),
            so_far.cost.at[j].set(jnp.where(jnp.isfinite(cost), cost, jnp.inf)),
            so_far.converged.at[j].set(converged),
            so_far.steps + steps,
        )
        # Where what depends on the others reached its bound, it was no bound to the descent.
        moved = problem.model.depends(u) != problem.model.depends(start)
        again = jnp.where(moved & (again < AGAIN), again + 1, 0)
        return jnp.where(again > 0, j, j + 1), again, found

    found = lax.while_loop(unfinished, followed, (zero, zero, nothing))[2]
    order = jnp.argsort(found.cost)
    u, k, cost, converged = (x[order] for x in (found.u, found.k, found.cost, found.converged))
    return Basins(u, k, cost, converged, found.steps)


def tolerance(dtype: jnp.dtype) -> float:
    """To which a search can tell whether it has arrived."""
    eps = float(jnp.finfo(dtype).eps)
    return eps**0.5 if dtype == jnp.float64 else 100 * eps


def descend(
    problem: Problem,
    images: Images | Blocks,
    u: Float[Array, "q"],
    box: Box,
    solver: Solver | None = None,
    *,
    damping: float = 1e-2,
) -> tuple[Array, ...]:
    """From u to the minimum near it: u, k, the cost, whether it converged, and the steps taken."""
    model = problem.model.depending_on(u)
    problem = eqx.tree_at(lambda p: p.model, problem, model, is_leaf=lambda x: x is None)
    lower, upper = (model.coordinates(edge) for edge in box)

    @jax.jit  # one equation to Optimistix, which would else trace and differentiate each, in vain
    def at(y: Float[Array, "m"]) -> tuple[Array, Array, tuple[Array, Array]]:
        u = model.whole(y)
        k, _ = best_linear(problem, images.sum(lambda image: observed_gram(model, u, image)))
        # Without the barrier XLA would solve for k again at every pixel.
        k = lax.optimization_barrier(k)
        one = images.sum(lambda image: gram(model, u, k, image))
        here = linearise(problem, one[None], k)
        return *compress(here, float(jnp.finfo(y.dtype).eps)), (here.k, here.cost)

    def residual(y: Float[Array, "m"], _: None) -> tuple[Array, tuple[Array, Array]]:
        # Ours stays in the box by itself.
        here = lax.stop_gradient(y if solver is None else jnp.clip(y, lower, upper))
        r, jacobian, found = at(here)
        return (r + jacobian @ (y - here)) / problem.norm, found

    y = model.coordinates(u)
    if y.size == 0:
        k, cost = at(y)[2]
        return u, k, cost, jnp.ones((), bool), jnp.zeros((), int)
    small = tolerance(u.dtype)
    ours = BoundedLevenbergMarquardt(small, small, lower, upper, damping=damping)
    solution: Any = optx.least_squares(
        residual,
        ours if solver is None else solver,
        y,
        has_aux=True,
        max_steps=MAX_STEPS,
        throw=False,
    )
    converged = jnp.asarray(solution.result == optx.RESULTS.successful)
    # What depends on others is not bounded by the search: the step to its bound is the shorter one.
    u = jnp.clip(model.whole(jnp.clip(solution.value, lower, upper)), box[0], box[1])
    k, cost = solution.aux
    return u, k, cost, converged & jnp.isfinite(cost), solution.stats["num_steps"]
