"""Every singularity of the shading equations, guarded once.

Each function is the textbook one where that is finite, and a stated value with zero derivative where
it is not. The guard is the double ``where``: the argument is made harmless *before* the singular
function sees it, and the result is replaced *after*. A single ``where`` is right forward and NaN in
reverse, because 0 times infinity is NaN; adding an epsilon would change every result a little.

The predicates say where a function is singular, so that NaN, which is nowhere, stays NaN.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

__all__ = [
    "log",
    "log_base",
    "positive",
    "power",
    "power_of_log",
    "reciprocal",
    "reciprocal_sqrt",
    "sqrt",
]

Plane = Float[Array, "..."]


def positive(x: Plane) -> Plane:
    """max(x, 0), with derivative 0 at the kink x = 0 (JAX's own ``maximum`` takes one half)."""
    return jnp.where(x <= 0, 0, x)


def sqrt(x: Plane) -> Plane:
    """Square root of max(x, 0), with derivative 0 where x <= 0."""
    return _guarded(jnp.sqrt, x, x <= 0)


def reciprocal_sqrt(x: Plane) -> Plane:
    """1/sqrt(x) where x > 0; elsewhere 0 with derivative 0."""
    return _guarded(lambda safe: 1 / jnp.sqrt(safe), x, x <= 0)


def reciprocal(x: Plane) -> Plane:
    """1/x where x != 0; at 0 it is 0 with derivative 0."""
    return _guarded(lambda safe: 1 / safe, x, x == 0)


def log(x: Plane) -> Plane:
    """Natural logarithm where x > 0; elsewhere 0 with derivative 0."""
    return _guarded(jnp.log, x, x <= 0)


def power(x: Plane, n: Plane) -> Plane:
    """max(x, 0)**n for n >= 0: the lobe of Phong (LIGHT-5), zero with zero derivative for x <= 0.

    Below the square root of the smallest normal number (1e-19 in float32) x counts as zero, so that
    the second derivative, which holds 1/x^2, stays finite; for n >= 1 the result is zero there to
    any working precision. Where the power itself underflows, it and its derivatives are zero.
    """
    return power_of_log(log_base(x), n)


def log_base(x: Plane) -> Plane:
    """The half of `power` that does not depend on n: log x, and minus infinity where x counts as zero."""
    dark = x <= float(jnp.finfo(jnp.result_type(x)).tiny) ** 0.5
    return jnp.where(dark, -jnp.inf, jnp.log(jnp.where(dark, 1, x)))


def power_of_log(log_x: Plane, n: Plane) -> Plane:
    """The other half: x**n from `log_base(x)`."""
    dark = log_x == -jnp.inf
    exponent = n * jnp.where(dark, 0, log_x)
    vanishes = dark | (exponent <= np.log(float(jnp.finfo(jnp.result_type(log_x)).tiny)))
    return jnp.where(vanishes, 0, jnp.exp(jnp.where(vanishes, 0, exponent)))


def _guarded(f: Callable[[Plane], Plane], x: Plane, singular: Bool[Array, "..."]) -> Plane:
    return jnp.where(singular, 0, f(jnp.where(singular, 1, x)))
