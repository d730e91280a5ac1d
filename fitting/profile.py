"""The residual as a function of one lobe's shininess, all linear coefficients fitted anew at each."""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from fitting.project import Problem, cost
from fitting.search import Found
from fitting.sharding import over_devices

__all__ = ["Profile", "profile"]

WHOLE = 48
"""Nodes over the whole range, equally far apart in log n."""
AROUND = np.geomspace(1e-3, 0.5, 16)
"""Steps of log n to either side of the minimum: the valley may be narrow, and is drawn whole."""
BATCH = 16


@dataclass(frozen=True)
class Profile:
    """The relative residual of the best linear coefficients at each shininess, in rising order.

    `lobe` numbers the lobe among the material's. What else was searched, the shininess of other
    lobes and an attenuation, stays as it was found: where there is any, the valley is an upper bound
    of the one in which everything is fitted anew, and touches it at the minimum.
    """

    lobe: int
    shininess: Float[np.ndarray, "N"]
    relative_residual: Float[np.ndarray, "N"]


def profile(
    problem: Problem,
    found: Found,
    box: tuple[Float[Array, "q"], Float[Array, "q"]],
    *,
    which: int = 0,
) -> Profile:
    """The profile of the lobe that is the `which`-th searched, within its bounds.

    Nodes lie over the whole range, and ever closer together towards the minimum, which is one of
    them. The residual is weighted as in the fit, and relative to `problem.norm`.
    """
    low, high = (float(edge[which]) for edge in box)
    best = float(found.u[which])
    steps = np.concatenate([best - AROUND, [best], best + AROUND])
    nodes = np.unique(np.clip(np.concatenate([np.linspace(low, high, WHOLE), steps]), low, high))
    # The same number of nodes for every fit, so that it compiles once
    count = WHOLE + len(steps)
    u = np.tile(np.asarray(found.u), (count, 1))
    u[:, which] = np.append(nodes, np.full(count - len(nodes), best))
    here = replace(
        problem,
        model=replace(problem.model, dependent=found.dependent),
        reference=found.at.k,
        judge=found.judge,
        gains=found.gains,
    )
    costs = np.asarray(_costs(here, jnp.asarray(u)), float)[: len(nodes)]
    residual = np.sqrt(np.maximum(costs, 0)) / float(problem.norm)
    return Profile(problem.model.searched[which], np.exp(nodes), residual)


@over_devices
def _costs(problem: Problem, nodes: Float[Array, "N q"]) -> Float[Array, "N"]:
    return lax.map(lambda u: cost(problem, u)[0], nodes, batch_size=BATCH)
