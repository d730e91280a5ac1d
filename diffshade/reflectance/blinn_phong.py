"""Blinn's specular lobe about the halfway vector (Blinn 1977)."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.arrays import coefficients, positive
from diffshade.bounds import Cone, largest_cosine, smallest_cosine
from diffshade.channels import channels
from diffshade.reflectance.lobe import AbstractLobe, log_cosine
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


class BlinnPhong(AbstractLobe):
    """I_p k_s max(0, n.h)^n: `ks` in [0, 1], `shininess` n >= 0, the form of OpenGL and of .mtl files.

    Each is one number, one a channel [C], or a map over a G-buffer's pixels [C or 1, P].
    The angle between n and h is half that between r and v when n lies between l and v, so the
    exponent that looks like a Phong lobe's is about 4 times as large.

    >>> BlinnPhong(ks=0.5, shininess=128).ks.ndim
    0
    """

    ks: Float[Array, "..."] = eqx.field(converter=coefficients("ks"))
    shininess: Float[Array, "..."] = eqx.field(converter=positive("shininess"))
    kind: ClassVar[str] = "blinn_phong"
    convex: ClassVar[bool] = True

    def angles(self, n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane) -> Plane:
        """log(n.h), minus infinity where the lobe is dark."""
        return log_cosine(n, halfway(l, v), n_dot_l)

    def at(self, angles: Plane) -> tuple[Plane, ...]:
        return tuple(guard.power_of_log(angles, exponent) for exponent in channels(self.shininess))

    def most(self, n: Cone, l: Cone, v: Cone) -> Plane:
        """max(0, n.h)^n with n.h = (n.l + n.v) / |l + v|: largest above, smallest below, the least n."""
        shortest = guard.sqrt(2 + 2 * smallest_cosine(l, v))
        sum_of_cosines = largest_cosine(n, l) + largest_cosine(n, v)
        cosine = jnp.where(
            sum_of_cosines < shortest, sum_of_cosines * guard.reciprocal(shortest), 1
        )
        return guard.power(cosine, self.shininess.min())
