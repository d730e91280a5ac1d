"""Attenuation by distance in a gauge where its constants mean something.

c0, c1, c2 share one scale with k_d and k_s: doubling all five leaves the image unchanged. At a
reference distance d0, the geometric mean distance between lights and surface, the scale is fixed by

    1/f(d) = l0 + l1 t + l2 t^2,   t = d / d0,   l >= 0,   l0 + l1 + l2 = 1,   so that f(d0) = 1.

The triangle of (l0, l1, l2) holds no attenuation (1, 0, 0), pure inverse square (0, 0, 1) and all
between. The search moves two of the three, each bounded by 0; the third, the largest, makes up the sum,
so that no edge or corner of the triangle is special. Where k_d or a k_s is held the scale is no longer
free, the sum is f(d0)^-1, and all three move.
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
    """f(d) = 1 / (l0 + l1 t + l2 t^2), t = d / distance, with l >= 0; not clamped."""

    l0: Number
    l1: Number
    l2: Number
    distance: Number

    @property
    def gain(self) -> Number:
        """f at the reference distance."""
        return guard.reciprocal(self.l0 + self.l1 + self.l2)

    @property
    def shares(self) -> tuple[Number, Number, Number]:
        """l0, l1, l2 as parts of their sum."""
        return self.l0 * self.gain, self.l1 * self.gain, self.l2 * self.gain

    def __call__(self, d: Float[Array, "..."]) -> Float[Array, "..."]:
        t = d / self.distance
        return guard.reciprocal(self.l0 + t * (self.l1 + t * self.l2))

    def constants(self, scale: Number) -> tuple[Number, Number, Number]:
        """c0, c1, c2 of LIGHT-12, times `scale`, which k_d and k_s are to be multiplied by too."""
        d = self.distance
        return scale * self.l0, scale * self.l1 / d, scale * self.l2 / (d * d)

    def natural_scale(self, nearest: Number, largest: Number) -> Number:
        """The common scale of c0, c1, c2, k_d and k_s, which no image can tell: a convention.

        It makes c0 = 1 where that can be: where there is an l0, and where no coefficient is pushed
        past its upper bound (`largest` is the largest, over its bound, before scaling). Otherwise
        the coefficients grow as far as their bounds; and never so little that LIGHT-12's clamp,
        which was not part of what was fitted, would act at the `nearest` distance.
        """
        least = self(nearest)
        wanted = jnp.where(self.l0 > 0, guard.reciprocal(self.l0), jnp.inf)
        most = jnp.where(largest > 0, guard.reciprocal(largest), jnp.inf)
        scale = jnp.minimum(wanted, most)
        return jnp.maximum(jnp.where(jnp.isfinite(scale), scale, self.gain), least)


def with_attenuation(scene: Scene, attenuation: AbstractAttenuation) -> Scene:
    """The scene with one attenuation on all its point lights."""

    def attenuated(light: AbstractLight) -> AbstractLight:
        if not isinstance(light, PointLight):
            return light
        return PointLight(light.position, light.intensity, attenuation)

    return Scene(scene.ambient, tuple(attenuated(light) for light in scene.lights))
