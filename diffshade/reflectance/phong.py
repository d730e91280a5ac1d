"""Phong's specular lobe about the mirror direction (Phong 1975)."""

from typing import ClassVar

from jaxtyping import Array, Float

from diffshade import guard
from diffshade.bounds import Cone, largest_cosine, reflected
from diffshade.reflectance.lobe import log_cosine
from diffshade.reflectance.power import AbstractPower
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
