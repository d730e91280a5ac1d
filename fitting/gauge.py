"""Attenuation by distance in a gauge where its constants mean something.

c0, c1, c2 share one scale with k_d and k_s: doubling all five leaves the image unchanged. At a
reference distance d0, the geometric mean distance between lights and surface, the scale is fixed by

    1/f(d) = l0 + l1 t + l2 t^2,   t = d / d0,   l >= 0,   l0 + l1 + l2 = 1,   so that f(d0) = 1.

The triangle of (l0, l1, l2) holds no attenuation (1, 0, 0), pure inverse square (0, 0, 1) and all
between. The search moves in the square (reach, bend): l1 = 1 - reach, l0 = reach (1 - bend),
l2 = reach bend, whose edges are the triangle's, with the corner (0, 1, 0), a purely linear fall that no
lamp has, drawn out into the edge reach = 0.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.light.attenuation import AbstractAttenuation
from diffshade.light.base import AbstractLight
from diffshade.light.point import PointLight
from diffshade.scene import Scene

__all__ = ["ReferenceAttenuation", "with_attenuation"]

Number = Float[Array, ""]


class ReferenceAttenuation(AbstractAttenuation):
    """f(d) = gain / (l0 + l1 t + l2 t^2), t = d / distance: `gain` at the reference distance.

    Not clamped. The gain is 1 unless something else fixes the scale.
    """

    reach: Number
    bend: Number
    distance: Number
    gain: Number

    @property
    def shares(self) -> tuple[Number, Number, Number]:
        """(l0, l1, l2), none negative, of sum 1."""
        return self.reach * (1 - self.bend), 1 - self.reach, self.reach * self.bend

    def __call__(self, d: Float[Array, "..."]) -> Float[Array, "..."]:
        l0, l1, l2 = self.shares
        t = d / self.distance
        return self.gain * guard.reciprocal(l0 + t * (l1 + t * l2))

    def constants(self, scale: Number) -> tuple[Number, Number, Number]:
        """c0, c1, c2 of LIGHT-12, times `scale`, which k_d and k_s are to be multiplied by too."""
        l0, l1, l2 = (scale / self.gain * share for share in self.shares)
        return l0, l1 / self.distance, l2 / self.distance**2

    def natural_scale(self, nearest: Number, largest: Number) -> Number:
        """The common scale of c0, c1, c2, k_d and k_s, which no image can tell: a convention.

        It makes c0 = 1 where that can be: where there is an l0, and where no coefficient is pushed
        past its upper bound (`largest` is the largest, over its bound, at f(d0) = 1). Otherwise the
        coefficients grow as far as their bounds; and never so little that LIGHT-12's clamp, which
        was not part of what was fitted, would act at the `nearest` distance.
        """
        l0, l1, l2 = self.shares
        t = nearest / self.distance
        least = guard.reciprocal(l0 + t * (l1 + t * l2))
        wanted = jnp.where(l0 > 0, guard.reciprocal(l0), jnp.inf)
        most = jnp.where(largest > 0, guard.reciprocal(largest), jnp.inf)
        scale = jnp.minimum(wanted, most)
        return jnp.maximum(jnp.where(jnp.isfinite(scale), scale, 1), least)


def with_attenuation(scene: Scene, attenuation: AbstractAttenuation) -> Scene:
    """The scene with one attenuation on all its point lights."""

    def attenuated(light: AbstractLight) -> AbstractLight:
        if not isinstance(light, PointLight):
            return light
        return PointLight(light.position, light.intensity, attenuation)

    return Scene(scene.ambient, tuple(attenuated(light) for light in scene.lights))
