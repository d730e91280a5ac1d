"""Blinn's specular lobe about the halfway vector (Blinn 1977)."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.bounds import Cone, largest_cosine, smallest_cosine
from diffshade.reflectance.lobe import log_cosine
from diffshade.reflectance.power import AbstractPower
from diffshade.vector import Vec3, halfway

__all__ = ["BlinnPhong", "blinn_phong"]

Plane = Float[Array, "..."]


def blinn_phong(n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane, shininess: Plane) -> Plane:
    """max(0, n.h)^shininess with h = (l + v)/|l + v|, and 0 where n.l <= 0 or l = -v.

    n, l, v are unit vectors away from the surface; shininess >= 0. n.h is 1 - |n - h|^2 / 2, so that
    a narrow lobe loses nothing to rounding; the derivative is that, exact along the unit sphere.
    Not smooth where n.h = 0, where the derivative is taken from the dark side (0), and at the
    terminator n.l = 0, where the lobe jumps to 0.
    """
    return guard.power_of_log(log_cosine(n, halfway(l, v), n_dot_l), shininess)


class BlinnPhong(AbstractPower):
    """I_p k_s max(0, n.h)^n, the form of OpenGL and of .mtl files; has what every `AbstractPower` has.

    The angle between n and h is half that between r and v when n lies between l and v, so the
    exponent that looks like a Phong lobe's is about 4 times as large.

    >>> BlinnPhong(ks=0.5, shininess=128).ks.ndim
    0
    """

    kind: ClassVar[str] = "blinn_phong"

    def between(self, n: Vec3, l: Vec3, v: Vec3) -> tuple[Vec3, Vec3]:
        return n, halfway(l, v)

    def most(self, n: Cone, l: Cone, v: Cone) -> Plane | None:
        """max(0, n.h)^n with n.h = (n.l + n.v) / |l + v|: largest above, smallest below, the least n."""
        if self.weight is not None:
            return None
        shortest = guard.sqrt(2 + 2 * smallest_cosine(l, v))
        sum_of_cosines = largest_cosine(n, l) + largest_cosine(n, v)
        cosine = jnp.where(
            sum_of_cosines < shortest, sum_of_cosines * guard.reciprocal(shortest), 1
        )
        return guard.power(cosine, self.shininess.min())
