"""Least squares over whole images: the minimum, and what each image says of it.

A residual is a function of the unknowns, [K, C, P] over images, channels and pixels; what it is of beside
them is bound to it by `equinox.Partial`, so that one program serves all values of that.
"""

from collections.abc import Callable
from typing import Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, Int

from fitting.solver import BoundedLevenbergMarquardt

__all__ = ["Linear", "descended", "grams", "linearised", "rounding"]

Residual: TypeAlias = Callable[[Float[Array, "m"]], Float[Array, "K C P"]]
Linear: TypeAlias = tuple[Float[Array, "K C P"], Float[Array, "m K C P"]]


@eqx.filter_jit
def descended(
    residual: Residual,
    start: Float[Array, "m"],
    lower: Float[Array, "m"],
    upper: Float[Array, "m"],
    max_steps: int,
) -> tuple[Array, Array]:
    """The minimum near the start within bounds, and whether it converged."""

    def left(theta: Float[Array, "m"], _: None) -> Float[Array, "n"]:
        return residual(theta).reshape(-1)

    eps = float(jnp.finfo(start.dtype).eps)
    solver = BoundedLevenbergMarquardt(eps**0.5, eps**0.5, lower, upper)
    found: Any = optx.least_squares(left, solver, start, max_steps=max_steps, throw=False)
    return found.value, jnp.asarray(found.result == optx.RESULTS.successful)


@eqx.filter_jit
def linearised(residual: Residual, theta: Float[Array, "m"]) -> Linear:
    """The residual and its Jacobian."""
    left, push = jax.linearize(residual, theta)
    return left, jax.vmap(push)(jnp.eye(theta.size, dtype=theta.dtype))


def grams(
    linear: Linear, group: Int[np.ndarray, "K P"] | None = None
) -> tuple[Float[np.ndarray, "b m m"], Float[np.ndarray, "b m"], Float[np.ndarray, "b"]]:
    """J'J, J'r and r'r of each image, or of each group, numbered from 0, that its pixels are in.

    Summed in float64 whatever the Jacobian is in: many pixels that say the same would in float32 add up
    to more than a null space's zero.
    """
    left, jacobian = (np.moveaxis(np.asarray(x), -2, -1) for x in linear)
    size = len(jacobian)
    if group is None:
        group = np.broadcast_to(np.arange(left.shape[0])[:, None], left.shape[:2])
    count = int(group.max()) + 1
    hessians, gradients = np.zeros((count, size, size)), np.zeros((count, size))
    squares = np.zeros(count)
    for number in range(count):
        own = group == number
        rows = jacobian[:, own].reshape(size, -1).astype(float)
        rest = left[own].reshape(-1).astype(float)
        hessians[number], gradients[number], squares[number] = (
            rows @ rows.T,
            rows @ rest,
            rest @ rest,
        )
    return hessians, gradients, squares


def rounding(dtype: np.dtype, count: float) -> float:
    """Of `grams` beside their size: that of the Jacobian, or of a sum of so many numbers in float64,
    which grows as the root of that (Higham 2002, section 4.2).
    """
    return max(float(np.finfo(dtype).eps), float(np.finfo(float).eps * np.sqrt(count)))
