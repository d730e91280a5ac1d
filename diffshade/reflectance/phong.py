"""Phong's specular lobe about the mirror direction (Phong 1975)."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.arrays import coefficients, positive
from diffshade.bounds import Cone, largest_cosine, reflected
from diffshade.channels import channels
from diffshade.reflectance.lobe import AbstractLobe, log_cosine
from diffshade.vector import Vec3, reflect

__all__ = ["Phong", "phong"]

Plane = Float[Array, "..."]


def phong(n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane, shininess: Plane) -> Plane:
    """max(0, r.v)^shininess with r = 2 (n.l) n - l (LIGHT-5, 6, 10), and 0 where n.l <= 0 or v = 0.

    n, l, v are unit vectors away from the surface; shininess >= 0. r.v is 1 - |r - v|^2 / 2, so that
    a narrow lobe loses nothing to rounding; the derivative is that, exact along the unit sphere.
    Not smooth where r.v = 0, where the derivative is taken from the dark side (0), and at the
    terminator n.l = 0, where the lobe jumps to 0.
    """
    return guard.power_of_log(log_cosine(reflect(l, n), v, n_dot_l), shininess)


class Phong(AbstractLobe):
    """I_p k_s max(0, r.v)^n (LIGHT-5): `ks` in [0, 1], `shininess` n >= 0.

    Each is one number, one a channel [C], or a map over a G-buffer's pixels [C or 1, P].
    The exponent of a Blinn-Phong highlight of the same width is about 4 times as large.

    >>> Phong(ks=0.5, shininess=32).shininess.ndim
    0
    """

    ks: Float[Array, "..."] = eqx.field(converter=coefficients("ks"))
    shininess: Float[Array, "..."] = eqx.field(converter=positive("shininess"))
    kind: ClassVar[str] = "phong"
    convex: ClassVar[bool] = True

    def angles(self, n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane) -> Plane:
        """log(r.v), minus infinity where the lobe is dark."""
        return log_cosine(reflect(l, n), v, n_dot_l)

    def at(self, angles: Plane) -> tuple[Plane, ...]:
        return tuple(guard.power_of_log(angles, exponent) for exponent in channels(self.shininess))

    def most(self, n: Cone, l: Cone, v: Cone) -> Plane:
        """max(0, r.v)^n for the r and v that are nearest, and the least n."""
        return guard.power(largest_cosine(reflected(l, n), v), self.shininess.min())
