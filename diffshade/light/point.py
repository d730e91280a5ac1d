"""The point light: rays diverge from one position (LIGHT-3)."""

import equinox as eqx
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.arrays import floats, vector
from diffshade.bounds import Ball
from diffshade.errors import BadInput
from diffshade.light.attenuation import AbstractAttenuation, Windowed
from diffshade.light.base import AbstractRayLight, Incidence, Incoming, share
from diffshade.vector import Vec3, dot

__all__ = ["AbstractPointLight", "PointLight"]

Plane = Float[Array, "..."]


class AbstractPointLight(AbstractRayLight):
    """A light at a position, with an attenuation f(d)."""

    position: eqx.AbstractVar[Float[Array, "3"]]
    attenuation: eqx.AbstractVar[AbstractAttenuation | None]

    @property
    def is_finite(self) -> bool:
        return isinstance(self.attenuation, Windowed)

    def incidence(self, position: Vec3 | None) -> Incidence:
        if position is None:
            raise BadInput(
                "a point light needs positions, and this G-buffer has normals only: give"
                " GBuffer.from_arrays a position, or use parallel lights"
            )
        s = Vec3.from_array(self.position) - position
        d_squared = dot(s, s)
        inverse_d = guard.reciprocal_sqrt(d_squared)
        l = s * inverse_d
        return Incidence(l, None if self.attenuation is None else d_squared * inverse_d)

    def over(self, ball: Ball | None) -> Incoming | None:
        if ball is None:
            return None
        position = Vec3.from_array(self.position)
        nearest = None if self.attenuation is None else ball.nearest(position)
        return Incoming(ball.towards(position), nearest)

    def falloff(self, distance: Plane | None) -> Plane | None:
        return None if distance is None or self.attenuation is None else self.attenuation(distance)


class PointLight(AbstractPointLight):
    """A light at a position: s = position - P, d = |s|, l = s / d (LIGHT-3a to 3c).

    `intensity` is I_p, one number or one a channel, in any unit of radiance. `attenuation` is a
    factor f(d) on it; None means f = 1, and the distance is not computed. At a point that coincides
    with the light, up to 5e-7 units of length in float32 and 5e-52 in float64, l is zero: the point
    receives nothing, and every derivative there is 0.

    >>> PointLight(position=(5, 20, 30), intensity=(1, 1, 1)).position.shape
    (3,)
    """

    position: Float[Array, "3"] = eqx.field(  # type: ignore[misc]
        converter=vector("the light's position")
    )
    intensity: Float[Array, "..."] = eqx.field(
        converter=floats("the light's intensity"), default=1.0
    )
    attenuation: AbstractAttenuation | None = None
    visible: Float[Array, "..."] | None = eqx.field(converter=share, default=None, kw_only=True)
