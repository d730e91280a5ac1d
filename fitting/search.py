"""From nothing to the minimum: a coarse grid on few pixels, refined there, finished on all."""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from fitting.model import Model
from fitting.project import Linearised, Problem, compressed_residual, cost, linearise
from fitting.solver import BoundedLevenbergMarquardt

__all__ = ["Found", "search"]

SHARES = (0.0, 1.0)
"""Of the blocks: one for the grid and the first refinement, all for the last."""
MAX_STEPS = 64


@dataclass(frozen=True)
class Found:
    """The minimum: u, its model, the fit around it, the steps taken, and whether it converged."""

    u: Float[Array, "q"]
    model: Model
    at: Linearised
    steps: int
    converged: bool


def search(
    problem: Problem,
    nodes: Float[np.ndarray, "N q"],
    lower: Float[np.ndarray, "q"],
    upper: Float[np.ndarray, "q"],
) -> Found:
    """Minimise over u in its box, from the best of the nodes."""
    dtype = problem.norm.dtype
    if nodes.shape[1] == 0:
        u = jnp.zeros(0, dtype)
        return Found(u, problem.model, _linearise(problem, u), 0, True)
    low, high = jnp.asarray(lower, dtype), jnp.asarray(upper, dtype)
    coarse = _on(problem, SHARES[0], problem.model)
    u = _best_node(coarse, jnp.asarray(np.clip(nodes, lower, upper), dtype))
    model, steps = problem.model.depending_on(np.asarray(u)), 0
    for share in SHARES:
        u, at, count, converged = _refine(_on(problem, share, model), u, low, high)
        steps += int(count)
        if not eqx.tree_equal(model, better := problem.model.depending_on(np.asarray(u))):
            # Another l has become the largest: where this one reached 0 it was no bound to it.
            model = better
            u, at, count, converged = _refine(_on(problem, share, model), u, low, high)
            steps += int(count)
    return Found(u, model, at, steps, bool(converged) and bool(jnp.isfinite(at.cost)))


def _on(problem: Problem, share: float, model: Model) -> Problem:
    """The problem on a share of the blocks, with the model's dependent entry."""
    part = np.asarray(share, problem.norm.dtype)
    return eqx.tree_at(lambda p: (p.block_share, p.model), problem, (part, model))


@jax.jit
def _best_node(problem: Problem, nodes: Float[Array, "N q"]) -> Float[Array, "q"]:
    costs = jax.lax.map(lambda u: cost(problem, u), nodes)
    return nodes[jnp.argmin(jnp.where(jnp.isfinite(costs), costs, jnp.inf))]


@jax.jit
def _refine(
    problem: Problem, u: Float[Array, "q"], lower: Float[Array, "q"], upper: Float[Array, "q"]
) -> tuple[Float[Array, "q"], Linearised, Int[Array, ""], Bool[Array, ""]]:
    eps = float(jnp.finfo(u.dtype).eps)
    tolerance = eps**0.5 if u.dtype == jnp.float64 else 100 * eps
    solver = BoundedLevenbergMarquardt(tolerance, tolerance, lower, upper)
    residual: Any = compressed_residual  # Optimistix's annotation allows no auxiliary output
    solution: Any = optx.least_squares(
        residual,
        solver,
        u,
        args=problem,
        has_aux=True,
        max_steps=MAX_STEPS,
        throw=False,
    )
    converged = jnp.asarray(solution.result == optx.RESULTS.successful)
    u = jnp.maximum(problem.model.whole(solution.value), lower)
    return u, solution.aux, solution.stats["num_steps"], converged


_linearise = jax.jit(linearise)
