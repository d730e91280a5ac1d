"""Phong's specular lobe about the mirror direction (Phong 1975)."""

from functools import reduce
from math import pi
from typing import ClassVar

from jaxtyping import Array, Float

from diffshade import guard
from diffshade.bounds import Cone, largest_cosine, reflected
from diffshade.channels import Channels, channels, plus, times
from diffshade.reflectance.lobe import log_cosine
from diffshade.reflectance.power import AbstractPower
from diffshade.vector import Vec3, reflect

__all__ = ["Phong", "blurred", "phong"]

Plane = Float[Array, "..."]


def phong(n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane, shininess: Plane) -> Plane:
    """max(0, r.v)^shininess with r = 2 (n.l) n - l (LIGHT-5, 6, 10), and 0 where n.l <= 0 or v = 0.

    n, l, v are unit vectors away from the surface; shininess >= 0. r.v is 1 - |r - v|^2 / 2, so that
    a narrow lobe loses nothing to rounding; the derivative is that, exact along the unit sphere.
    Not smooth where r.v = 0, where the derivative is taken from the dark side (0), and at the
    terminator n.l = 0, where the lobe jumps to 0.
    """
    return guard.power_of_log(log_cosine(reflect(l, n), v, n_dot_l), shininess)


def blurred(shininess: Plane, order: int) -> tuple[Plane, ...]:
    """By what the lobe max(0, cos)^n multiplies each degree l of the light around it, up to `order`.

        a_l = 2 pi integral from 0 to 1 of t^n P_l(t) dt
        a_0 = 2 pi / (n + 1),   a_1 = 2 pi / (n + 2),   a_l = a_l-2 (n - l + 2) / (n + l + 1)

    by Legendre's recurrence and partial integration (Funk and Hecke's theorem; n = 1 is Lambert's
    2001 table). Rational in n >= 0, and smooth. It falls about like exp(-l (l + 1) / (2 n + 2)) a_0.

    >>> import jax.numpy as jnp
    >>> [round(float(a) / 3.141592653589793, 4) for a in blurred(jnp.asarray(1.0), 4)]
    [1.0, 0.6667, 0.25, 0.0, -0.0417]
    """
    a = [2 * pi / (shininess + 1), 2 * pi / (shininess + 2)]
    for l in range(2, order + 1):
        a.append(a[l - 2] * ((shininess - (l - 2)) / (shininess + (l + 1))))
    return tuple(a[: order + 1])


class Phong(AbstractPower):
    """I_p k_s max(0, r.v)^n (LIGHT-5); has what every `AbstractPower` has: `ks`, `shininess`, a `weight`.

    The exponent of a Blinn-Phong highlight of the same width is about 4 times as large.

    >>> Phong(ks=0.5, shininess=32).shininess.ndim
    0
    """

    kind: ClassVar[str] = "phong"

    def between(self, n: Vec3, l: Vec3, v: Vec3) -> tuple[Vec3, Vec3]:
        return reflect(l, n), v

    def most(self, n: Cone, l: Cone, v: Cone) -> Plane | None:
        """max(0, r.v)^n for the r and v that are nearest, and the least n."""
        if self.weight is not None:
            return None
        return guard.power(largest_cosine(reflected(l, n), v), self.shininess.min())

    def filtered(self, bands: tuple[Channels, ...]) -> Channels | None:
        """The integral of L(w) max(0, r.w)^n: each degree of L times its a_l; None with a weight."""
        if self.weight is not None:
            return None
        factors = zip(*(blurred(n, len(bands) - 1) for n in channels(self.shininess)), strict=True)
        return reduce(plus, map(times, factors, bands))
