"""Every singularity of the shading equations, guarded once.

Each function is the textbook one where that is finite, and a stated value with zero derivative where
it is not. The guard is the double ``where``: the argument is made harmless *before* the singular
function sees it, and the result is replaced *after*. A single ``where`` is right forward and NaN in
reverse, because 0 times infinity is NaN; adding an epsilon would change every result a little.

The predicates say where a function is singular, so that NaN, which is nowhere, stays NaN.
"""

import math
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Bool, Float

from diffshade.fusion import Node

__all__ = [
    "log",
    "log_base",
    "log_one_minus",
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


@Node
def reciprocal_sqrt(x: Plane) -> Plane:
    """1/sqrt(x) where x is above the smallest normal number; elsewhere 0 with derivative 0."""
    return _guarded(lambda safe: jnp.sqrt(1 / safe), x, x < _smallest(x))


@reciprocal_sqrt.derivative
def _(y: Plane, planes: Any, tangents: Any) -> Plane:
    return -0.5 * y * (y * (y * tangents[0]))  # y^3 alone would overflow


@Node
def reciprocal(x: Plane) -> Plane:
    """1/x where x != 0; at 0 it is 0 with derivative 0."""
    return _guarded(lambda safe: 1 / safe, x, x == 0)


@reciprocal.derivative
def _(y: Plane, planes: Any, tangents: Any) -> Plane:
    return -y * (y * tangents[0])


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


def _counts_as_zero(x: Plane) -> Bool[Array, "..."]:
    return x <= _smallest(x) ** 0.5


@Node
def log_base(x: Plane) -> Plane:
    """The half of `power` that does not depend on n: log x, and minus infinity where x counts as zero."""
    dark = _counts_as_zero(x)
    return jnp.where(dark, -jnp.inf, jnp.log(jnp.where(dark, 1, x)))


@log_base.derivative
def _(y: Plane, planes: Any, tangents: Any) -> Plane:
    dark = _counts_as_zero(planes[0])
    return jnp.where(dark, 0, tangents[0]) * reciprocal.computed(jnp.where(dark, 1, planes[0]))


@Node
def log_one_minus(q: Plane) -> Plane:
    """log(1 - q) for q >= 0, to rounding however small q is; minus infinity where q >= 1.

    JAX's ``log1p`` is as exact and slower. What rounding takes from 1 - q is known exactly where it
    matters, and is small against it elsewhere.
    """
    rest = 1 - q
    dark = rest <= 0
    lit = jnp.where(dark, 1, rest)
    return jnp.where(dark, -jnp.inf, jnp.log(lit) + ((1 - rest) - q))


@log_one_minus.derivative
def _(y: Plane, planes: Any, tangents: Any) -> Plane:
    rest = 1 - planes[0]
    dark = rest <= 0
    return jnp.where(dark, 0, -tangents[0]) * reciprocal.computed(jnp.where(dark, 1, rest))


@Node
def power_of_log(log_x: Plane, n: Plane) -> Plane:
    """The other half: x**n from `log_base(x)`."""
    dark = log_x == -jnp.inf
    exponent = n * jnp.where(dark, 0, log_x)
    vanishes = dark | (exponent <= math.log(_smallest(log_x)))
    return _guarded(jnp.exp, exponent, vanishes)


@power_of_log.derivative
def _(y: Plane, planes: Any, tangents: Any) -> Plane:
    """d x^n = x^n (n d(log x) + log x dn)."""
    log_x, n = planes
    d_log_x, d_n = tangents
    terms = []
    if not isinstance(d_log_x, SymbolicZero):
        terms.append(n * d_log_x)
    if not isinstance(d_n, SymbolicZero):
        terms.append(jnp.where(log_x == -jnp.inf, 0, log_x) * d_n)
    return y * sum(terms[1:], terms[0])


def _smallest(x: Plane) -> float:
    """The smallest normal number of a type."""
    return float(jnp.finfo(jnp.result_type(x)).tiny)


def _guarded(f: Callable[[Plane], Plane], x: Plane, singular: Bool[Array, "..."]) -> Plane:
    return jnp.where(singular, 0, f(jnp.where(singular, 1, x)))
