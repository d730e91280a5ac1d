"""Real spherical harmonics: polynomials in x, y, z that are orthonormal over the unit sphere.

    Y_lm = K_lm(z) Re (x + i y)^m  for m >= 0,     K_l|m|(z) Im (x + i y)^|m|  for m < 0,
    K_lm = sqrt((2 - [m = 0]) (2l + 1) / (4 pi) (l - m)! / (l + m)!)  d^m P_l / dz^m

with P_l Legendre's polynomials, and all signs positive: Y_1,-1, Y_1,0 and Y_1,1 are sqrt(3 / 4pi) times
y, z and x (Ramamoorthi and Hanrahan 2001; other texts give odd m the sign of Condon and Shortley). Y_lm
has the number l^2 + l + m. Along a column of one m the recurrence

    K_lm = a_lm (z K_l-1,m - b_lm K_l-2,m),
    a_lm = sqrt((4 l^2 - 1) / (l^2 - m^2)),     b_lm = sqrt(((l - 1)^2 - m^2) / (4 (l - 1)^2 - 1))

is stable upwards (Press et al. 2007, 6.7), and no pole is special. One step of a loop goes from one
degree l to the next in all columns: the program does not grow with the order.
"""

from collections.abc import Callable
from functools import cache
from math import isqrt, pi
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from diffshade.vector import Vec3

__all__ = ["bands", "order_of", "spherical_harmonics"]

Plane = Float[Array, "..."]


def order_of(count: int) -> int | None:
    """The order that has so many harmonics, (order + 1)^2; None where there is none."""
    root = isqrt(count)
    return root - 1 if count and root * root == count else None


def spherical_harmonics(direction: Vec3, order: int) -> Float[Array, "K ..."]:
    """All Y_lm of degrees up to `order` in a direction, a unit vector: K = (order + 1)^2.

    >>> d = Vec3(*map(jnp.asarray, (1.0, 0.0, 0.0)))
    >>> [round(float(y), 4) + 0 for y in spherical_harmonics(d, 1)]
    [0.2821, 0.0, 0.0, 0.4886]
    """
    degrees = _degree_by_degree(direction, order, lambda y, _: y, None)
    rows = degrees.reshape(-1, *degrees.shape[2:])
    return rows[_table(order).place_of]


def bands(
    direction: Vec3, coefficients: Float[Array, "K C"]
) -> tuple[tuple[Float[Array, "..."], ...], ...]:
    """sum over m of c_lm Y_lm in a direction, degree by degree and channel by channel."""
    count, channels = coefficients.shape
    order = order_of(count)
    assert order is not None
    table = _table(order)
    none = jnp.zeros((1, channels), coefficients.dtype)
    of_degree = jnp.concatenate([coefficients, none])[table.number_at]

    def contracted(y: Float[Array, "M ..."], own: Float[Array, "M C"]) -> Float[Array, "C ..."]:
        return jnp.tensordot(own, y, axes=(0, 0), precision=lax.Precision.HIGHEST)

    found = _degree_by_degree(direction, order, contracted, of_degree)
    return tuple(tuple(found[l, c] for c in range(channels)) for l in range(order + 1))


def _degree_by_degree(
    direction: Vec3, order: int, of_degree: Callable[[Array, Any], Array], more: Any
) -> Float[Array, "L ..."]:
    """`of_degree` of the Y_lm of each l, [2 (order + 1), ...]: m = 0, 1, ..., then -0, -1, ..."""
    x, y, z = jnp.broadcast_arrays(direction.x, direction.y, direction.z)
    real, imaginary = [jnp.ones_like(x)], [jnp.zeros_like(x)]
    for _ in range(order):
        re, im = real[-1], imaginary[-1]
        real.append(x * re - y * im)
        imaginary.append(x * im + y * re)
    around = jnp.stack([*real, *imaginary])
    table = _table(order)
    shape = order + 1, *x.shape
    columns = (order + 1, *(1 for _ in x.shape))

    def step(last: tuple[Array, Array], own: Any) -> tuple[tuple[Array, Array], Array]:
        (k1, k2), (a, ab, start, rest) = last, own
        a, ab, start = (t.reshape(columns) for t in (a, ab, start))
        k = a * (z[None] * k1) - ab * k2 + start
        return (k, k1), of_degree(jnp.concatenate([k, k]) * around, rest)

    nothing = jnp.zeros(shape, x.dtype)
    factors = (jnp.asarray(t, x.dtype) for t in (table.a, table.ab, table.start))
    return lax.scan(step, (nothing, nothing), (*factors, more))[1]


class _Table(NamedTuple):
    """Of the degrees l (rows) and columns m: a, a b, and K_mm, where a column starts.

    `place_of` says where each harmonic is in rows of 2 (order + 1); `number_at` which one is there: the
    number of them where there is none.
    """

    a: Float[np.ndarray, "L M"]
    ab: Float[np.ndarray, "L M"]
    start: Float[np.ndarray, "L M"]
    place_of: Int[np.ndarray, "K"]
    number_at: Int[np.ndarray, "L W"]


@cache
def _table(order: int) -> _Table:
    size = order + 1
    a, ab, start = np.zeros((3, size, size))
    number_at = np.full((size, 2 * size), size * size, np.int32)
    odd_over_even = 1.0
    for m in range(size):
        if m:
            odd_over_even *= (2 * m + 1) / (2 * m)
        start[m, m] = np.sqrt((2 if m else 1) * odd_over_even / (4 * pi))
        for l in range(m, size):
            number_at[l, m] = l * l + l + m
            if m:
                number_at[l, size + m] = l * l + l - m
        for l in range(m + 1, size):
            a[l, m] = np.sqrt((4 * l * l - 1) / (l * l - m * m))
            ab[l, m] = a[l, m] * np.sqrt(((l - 1) ** 2 - m * m) / (4 * (l - 1) ** 2 - 1 or 1))
    flat = number_at.ravel()
    place_of = np.argsort(flat, kind="stable")[: size * size].astype(np.int32)
    return _Table(a, ab, start, place_of, number_at)
