"""The residual as a function of one shape, all linear coefficients fitted anew at each value."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Float

from fitting.arrays import Array
from fitting.columns import Photo, photos, scenery
from fitting.model import Model
from fitting.observation import Group
from fitting.observed import Observed
from fitting.polish import Minimum
from fitting.project import best_linear, observed_gram
from fitting.weights import Judge

__all__ = ["Profile", "profile"]

WHOLE = 48
"""Nodes over the whole range, equally far apart on the logarithm."""
AROUND = np.geomspace(1e-3, 0.5, 16)
"""Steps of the logarithm to either side of the minimum: the valley may be narrow, and is drawn whole."""


@dataclass(frozen=True)
class Profile:
    """The relative residual of the best linear coefficients at each value, in rising order.

    `names` are those of the coefficient: "specular.0.shininess", or several that are one number. What
    else was searched, other shapes and an attenuation, stays as it was found: where there is any, the
    valley is an upper bound of the one in which everything is fitted anew, and touches it at the
    minimum.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, "N"]
    relative_residual: Float[np.ndarray, "N"]


def profile(
    observed: Observed,
    minimum: Minimum,
    box: tuple[Float[np.ndarray, "q"], Float[np.ndarray, "q"]],
    *,
    which: int = 0,
) -> Profile:
    """The profile of the shape that is the `which`-th searched, within its bounds.

    Nodes lie over the whole range, and ever closer together towards the minimum, which is one of
    them. The residual is weighted as in the fit, and relative to the norm of what was observed.
    """
    low, high = (float(edge[which]) for edge in box)
    best = float(minimum.u[which])
    steps = np.concatenate([best - AROUND, [best], best + AROUND])
    nodes = np.unique(np.clip(np.concatenate([np.linspace(low, high, WHOLE), steps]), low, high))
    # The same number of nodes for every fit, so that it compiles once
    count = WHOLE + len(steps)
    u = np.tile(minimum.u, (count, 1))
    u[:, which] = np.append(nodes, np.full(count - len(nodes), best))
    problem = minimum.problem
    grams, _ = observed.pages.total(_grams, minimum.gains, problem.model, u, minimum.judge)
    costs = best_linear(problem, grams.sum(axis=0))[1][: len(nodes)]
    residual = np.sqrt(np.maximum(costs, 0) / (minimum.square or 1.0))
    return Profile(problem.model.searched[which], np.exp(nodes), residual)


def _grams(
    group: Group,
    gains: Float[Array, "K"] | None,
    model: Model,
    nodes: Float[Array, "N q"],
    judge: Judge | None,
) -> tuple[Float[Array, "K N C n n"], Float[Array, ""]]:
    """Of the rows [A, y] of every image, at each node."""

    def of_image(photo: Photo) -> Float[Array, "N C n n"]:
        at = scenery(photo, group.surface, model.material)
        return lax.map(lambda u: observed_gram(model, u, at, judge), nodes)

    return lax.map(of_image, photos(group, gains)), jnp.zeros(())
