"""Real spherical harmonics: polynomials in x, y, z that are orthonormal over the unit sphere.

    Y_lm = K_lm(z) Re (x + i y)^m  for m >= 0,     K_l|m|(z) Im (x + i y)^|m|  for m < 0,
    K_lm = sqrt((2 - [m = 0]) (2l + 1) / (4 pi) (l - m)! / (l + m)!)  d^m P_l / dz^m

with P_l Legendre's polynomials, and all signs positive: Y_1,-1, Y_1,0 and Y_1,1 are sqrt(3 / 4pi) times
y, z and x (Ramamoorthi and Hanrahan 2001; other texts give odd m the sign of Condon and Shortley). Y_lm
has the number l^2 + l + m. Along a column of one m the recurrence

    K_lm = a_lm (z K_l-1,m - b_lm K_l-2,m),
    a_lm = sqrt((4 l^2 - 1) / (l^2 - m^2)),     b_lm = sqrt(((l - 1)^2 - m^2) / (4 (l - 1)^2 - 1))

is stable upwards (Press et al. 2007, 6.7), and no pole is special. It is written out, for planes, of
which XLA makes one loop: many times faster than a loop over the degrees, whose planes it would store. The
program, and the time to compile it, grow with the square of the order.
"""

from collections.abc import Iterator
from math import isqrt, pi, sqrt

import jax.numpy as jnp
from jaxtyping import Array, Float

from diffshade.channels import Channels
from diffshade.vector import Vec3

__all__ = ["bands", "each_harmonic", "order_of", "spherical_harmonics"]

Plane = Float[Array, "..."]


def order_of(count: int) -> int | None:
    """The order that has so many harmonics, (order + 1)^2; None where there is none."""
    root = isqrt(count)
    return root - 1 if count and root * root == count else None


def each_harmonic(direction: Vec3, order: int) -> Iterator[tuple[int, Plane]]:
    """The Y_lm of degrees up to `order` in a direction, a unit vector, each with its number.

    They come column by column: of m = 0, then of 1 and -1, and so on.
    """
    x, y, z = direction.x, direction.y, direction.z
    real, imaginary, first = jnp.ones_like(z), jnp.zeros_like(z), sqrt(1 / (4 * pi))
    for m in range(order + 1):
        if m:
            real, imaginary = x * real - y * imaginary, x * imaginary + y * real
            first *= sqrt((2 * m + 1) / (2 * m)) * (sqrt(2) if m == 1 else 1)
        before, k = jnp.zeros_like(z), jnp.full_like(z, first)
        for l in range(m, order + 1):
            if l > m:
                a = sqrt((4 * l * l - 1) / (l * l - m * m))
                b = sqrt(((l - 1) ** 2 - m * m) / (4 * (l - 1) ** 2 - 1)) if l > m + 1 else 0
                before, k = k, a * (z * k - b * before)
            yield l * l + l + m, k * real
            if m:
                yield l * l + l - m, k * imaginary


def spherical_harmonics(direction: Vec3, order: int) -> Float[Array, "K ..."]:
    """All of them in the order of their numbers: K = (order + 1)^2.

    >>> d = Vec3(*map(jnp.asarray, (1.0, 0.0, 0.0)))
    >>> [round(float(y), 4) + 0 for y in spherical_harmonics(d, 1)]
    [0.2821, 0.0, 0.0, 0.4886]
    """
    planes = dict(each_harmonic(direction, order))
    return jnp.stack([planes[number] for number in range(len(planes))])


def bands(direction: Vec3, coefficients: Float[Array, "K C"]) -> tuple[Channels, ...]:
    """sum over m of c_lm Y_lm in a direction, degree by degree and channel by channel."""
    order = order_of(len(coefficients))
    assert order is not None
    rows = [tuple(row) for row in coefficients]
    terms: list[list[Channels]] = [[] for _ in range(order + 1)]
    for number, y in each_harmonic(direction, order):
        terms[isqrt(number)].append(tuple(c * y for c in rows[number]))
    return tuple(
        tuple(sum(planes[1:], planes[0]) for planes in zip(*degree, strict=True))
        for degree in terms
    )
