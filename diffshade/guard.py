"""Every singularity of the shading equations, guarded once.

Each function is the textbook one where that is finite, and a stated value with zero derivative where
it is not. The guard is double: the argument is made harmless *before* the singular function sees it,
and the result is replaced *after*. A guard after alone is right forward and NaN in reverse, because 0
times infinity is NaN; adding an epsilon would change every result a little. What makes an argument
harmless is a maximum, where it has one sign: XLA may compute it twice, in loops that round differently,
and a ``where`` that asks the one would let the other through.

The predicates say where a function is singular, so that NaN, which is nowhere, stays NaN.

Singular is also what is so near that a second derivative would leave the range of the type. Values
and derivatives up to the second are then finite, forward and in reverse, for all input of these ranges:

| quantity | float32 | float64 |
|---|---|---|
| coordinates, in units of length: positions, eyes, vertices | up to 1e6 | up to 1e40 |
| distances from light and eye, of camera and target: what is less counts as 0 | 5e-7 | 5e-52 |
| directions and normals that are not 0 | 1e-6 to 1e6 long | 1e-40 to 1e40 long |
| radius, extent, reach | 1e-6 to 1e6 | 1e-40 to 1e40 |
| intensities, of either sign | up to 1e3 | up to 1e20 |
| coefficients and colours, of either sign | up to 10 | up to 1e20 |
| shininess | 0 to 1e5 | 0 to 1e5 |
| roughness alpha of microfacets | 1e-3 to 2 | 1e-3 to 2 |
| index of refraction | 0.1 to 10 | 0.1 to 10 |
| extinction; reflectance f0 | 0 to 10; 0 to 1 | 0 to 10; 0 to 1 |
| constants of attenuations | 0 to 1e6 | 0 to 1e40 |
| denominators of linear attenuations, if not 0 | 1e-6 and more | 1e-40 and more |
| temperatures of black bodies, in kelvin | 1 to 1e6 | 1 to 1e6 |
| edges of faces under `sphere_weights`, if not 0 | 1e-6 and more | 1e-40 and more |

What is beyond them is computed all the same, and may overflow, or count as 0 where it is less.
"""

import math
from typing import Any

import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from diffshade.fusion import Node

__all__ = [
    "log_base",
    "log_one_minus",
    "positive",
    "power",
    "power_of_log",
    "ratio",
    "reciprocal",
    "reciprocal_sqrt",
    "shortest",
    "sqrt",
]

Plane = Float[Array, "..."]


def positive(x: Plane) -> Plane:
    """max(x, 0), with derivative 0 at the kink x = 0 (JAX's own ``maximum`` takes one half)."""
    return jnp.where(x <= 0, 0, x)


def sqrt(x: Plane) -> Plane:
    """sqrt(x) above the square root of the smallest normal number; elsewhere 0 with derivative 0.

    That is 1e-19 in float32. The second derivative, x^(-3/2), is 3e28 there.
    """
    least = _smallest(x) ** 0.5
    return jnp.where(x <= least, 0, jnp.sqrt(jnp.maximum(x, least)))


@Node
def reciprocal_sqrt(x: Plane) -> Plane:
    """1/sqrt(x) above the cube root of the smallest normal number; elsewhere 0 with derivative 0.

    That is 2e-13 in float32. The second derivative, x^(-5/2), is 4e31 there.
    """
    least = shortest(x)
    return jnp.where(x <= least, 0, jnp.sqrt(1 / jnp.maximum(x, least)))


@reciprocal_sqrt.derivative
def _(y: Plane, planes: Any, tangents: Any) -> Plane:
    return -0.5 * y * (y * (y * tangents[0]))  # y^3 alone would overflow


@Node
def reciprocal(x: Plane) -> Plane:
    """1/x where |x| is above 4e-29 in float32 and 2e-231 in float64; elsewhere 0 with derivative 0.

    That is the smallest normal number to the power 3/4: what is left of the range is for products.
    """
    tiny = jnp.abs(x) < _smallest(x) ** 0.75
    return jnp.where(tiny, 0, 1 / jnp.where(tiny, 1, x))


@reciprocal.derivative
def _(y: Plane, planes: Any, tangents: Any) -> Plane:
    return -y * (y * tangents[0])


def ratio(part: Plane, whole: Plane) -> Plane:
    """part / whole; 0 with derivative 0 where |whole| is at most `shortest`: no colour, no share.

    The second derivative, part / whole^3, is finite for parts that are not larger than the whole.
    """
    return part * reciprocal(jnp.where(jnp.abs(whole) <= shortest(whole), 0, whole))


def power(x: Plane, n: Plane) -> Plane:
    """max(x, 0)**n for n >= 0: the lobe of Phong (LIGHT-5), zero with zero derivative for x <= 0.

    Below the rounding of a cosine (3e-8 in float32) x counts as zero, so that the second derivative,
    which holds 1/x^2, stays finite.
    """
    return power_of_log(log_base(x), n)


def _dimmest(x: Plane) -> float:
    """A base up to that counts as zero: half of the least that 1 - q can be, if not 0."""
    return float(jnp.finfo(jnp.result_type(x)).eps) / 4


@Node
def log_base(x: Plane) -> Plane:
    """The half of `power` that does not depend on n: log x, and minus infinity where x counts as zero."""
    least = _dimmest(x)
    return jnp.where(x <= least, -jnp.inf, jnp.log(jnp.maximum(x, least)))


@log_base.derivative
def _(y: Plane, planes: Any, tangents: Any) -> Plane:
    # Where x counts as zero, `power_of_log` multiplies by 0 what is any finite number here.
    x = planes[0]
    return tangents[0] * reciprocal.computed(jnp.maximum(x, _dimmest(x)))


@Node
def log_one_minus(q: Plane) -> Plane:
    """log(1 - q) for q >= 0, to rounding however small q is; minus infinity where q >= 1.

    JAX's ``log1p`` is as exact and slower. What rounding takes from 1 - q is known exactly where it
    matters, and is small against it elsewhere.
    """
    rest = 1 - q
    logarithm = jnp.log(jnp.maximum(rest, _dimmest(rest))) + ((1 - rest) - q)
    return jnp.where(rest <= 0, -jnp.inf, logarithm)


@log_one_minus.derivative
def _(y: Plane, planes: Any, tangents: Any) -> Plane:
    rest = 1 - planes[0]
    return jnp.where(rest <= 0, 0, -tangents[0]) * reciprocal.computed(rest)


@Node
def power_of_log(log_x: Plane, n: Plane) -> Plane:
    """The other half: x**n from `log_base(x)`."""
    return jnp.where(log_x == -jnp.inf, 0, jnp.exp(n * _lit(log_x)))


@power_of_log.derivative
def _(y: Plane, planes: Any, tangents: Any) -> Plane:
    """d x^n = x^n (n d(log x) + log x dn)."""
    log_x, n = planes
    d_log_x, d_n = tangents
    terms = []
    if not isinstance(d_log_x, SymbolicZero):
        terms.append(n * d_log_x)
    if not isinstance(d_n, SymbolicZero):
        terms.append(_lit(log_x) * d_n)
    return y * sum(terms[1:], terms[0])


def _lit(log_x: Plane) -> Plane:
    return jnp.maximum(log_x, math.log(_dimmest(log_x)))


def shortest(x: Plane) -> float:
    """Vectors that are shorter count as zero: the cube root of the smallest normal number of a type."""
    return _smallest(x) ** (1 / 3)


def _smallest(x: Plane) -> float:
    """The smallest normal number of a type."""
    return float(jnp.finfo(jnp.result_type(x)).tiny)
