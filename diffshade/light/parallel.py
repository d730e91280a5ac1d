"""The parallel light: a point light at infinite distance, such as the sun."""

import equinox as eqx
from jaxtyping import Array, Float

from diffshade.arrays import floats, vector
from diffshade.bounds import Ball, Cone
from diffshade.light.base import AbstractRayLight, Incidence, Incoming, share
from diffshade.vector import Vec3, unit

__all__ = ["ParallelLight"]


class ParallelLight(AbstractRayLight):
    """A light of one direction everywhere: l = direction / |direction|.

    `direction` points from the surface to the light and need not be a unit vector; a zero vector
    lights nothing. `intensity` is I_p, one number or one a channel.

    >>> ParallelLight(direction=(0, 0, 1), intensity=1.0).intensity.shape
    ()
    """

    direction: Float[Array, "3"] = eqx.field(  # type: ignore[misc]
        converter=vector("the light's direction")
    )
    intensity: Float[Array, "..."] = eqx.field(
        converter=floats("the light's intensity"), default=1.0
    )
    visible: Float[Array, "..."] | None = eqx.field(converter=share, default=None, kw_only=True)

    def incidence(self, position: Vec3 | None) -> Incidence:
        return Incidence(unit(Vec3.from_array(self.direction)), None)

    def over(self, ball: Ball | None) -> Incoming:
        return Incoming(Cone.ray(unit(Vec3.from_array(self.direction))), None)

    def falloff(self, distance: Float[Array, "..."] | None) -> None:
        return None
