"""Lobes that are a power of a cosine: Phong's and Blinn's."""

from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.arrays import coefficients, positive
from diffshade.channels import Channels, channels, times
from diffshade.reflectance.fresnel import AbstractFresnel
from diffshade.reflectance.lobe import AbstractLobe, log_cosine
from diffshade.vector import Vec3

__all__ = ["AbstractPower"]

Plane = Float[Array, "..."]


class AbstractPower(AbstractLobe):
    """I_p k_s W(theta) max(0, a.b)^n: `ks` in [0, 1], `shininess` n >= 0.

    Each is one number, one a channel [C], or a map over a G-buffer's pixels [C or 1, P]. The
    `weight` W of text C is a function of the angle of incidence theta, of cosine n.l: `Schlick`,
    `Dielectric`, or any `AbstractFresnel`; None is 1, as in text A, and is not computed.
    """

    ks: Float[Array, "..."] = eqx.field(converter=coefficients("ks"))
    shininess: Float[Array, "..."] = eqx.field(converter=positive("shininess"))
    weight: AbstractFresnel | None = None
    convex: ClassVar[bool] = True

    @abstractmethod
    def between(self, n: Vec3, l: Vec3, v: Vec3) -> tuple[Vec3, Vec3]:
        """The unit vectors a and b."""

    def angles(self, n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane) -> Any:
        """log(a.b), minus infinity where the lobe is dark; and n.l, for a weight."""
        logarithm = log_cosine(*self.between(n, l, v), n_dot_l)
        return logarithm if self.weight is None else (logarithm, guard.positive(n_dot_l))

    def at(self, angles: Any) -> Channels:
        if self.weight is None:
            return self._powers(angles)
        logarithm, n_dot_l = angles
        return times(self._powers(logarithm), self.weight.reflected(n_dot_l))

    def _powers(self, logarithm: Plane) -> Channels:
        return tuple(guard.power_of_log(logarithm, n) for n in channels(self.shininess))
