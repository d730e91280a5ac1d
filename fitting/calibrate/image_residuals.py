"""Least squares over whole images: the minimum, and what each image says of it.

A residual is a function of the unknowns, [K, C, P] over images, channels and pixels; what it is of beside
them is bound to it by `equinox.Partial`, so that one program serves all values of that.
"""

from collections.abc import Callable
from typing import Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from fitting.solver import BoundedLevenbergMarquardt

__all__ = ["descended", "grams"]

Residual: TypeAlias = Callable[[Float[Array, "m"]], Float[Array, "K C P"]]


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
def grams(residual: Residual, theta: Float[Array, "m"]) -> tuple[Array, Array, Array]:
    """Of each image J'J, J'r and r'r."""
    left, push = jax.linearize(residual, theta)
    jacobian = jax.vmap(push)(jnp.eye(theta.size, dtype=theta.dtype))
    hessians = jnp.einsum("mkcp,nkcp->kmn", jacobian, jacobian)
    gradients = jnp.einsum("mkcp,kcp->km", jacobian, left)
    return hessians, gradients, jnp.einsum("kcp,kcp->k", left, left)
