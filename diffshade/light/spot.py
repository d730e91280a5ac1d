"""The spot light: a point light that shines one way (Warn 1983)."""

from math import pi
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.arrays import floats, is_concrete, optional, positive, vector
from diffshade.errors import BadInput
from diffshade.light.attenuation import AbstractAttenuation
from diffshade.light.base import Incidence, share
from diffshade.light.point import AbstractPointLight
from diffshade.vector import Vec3, dot, unit

__all__ = ["SpotLight"]


def _cutoff(value: Any) -> Float[Array, "..."]:
    angle = positive("the light's cutoff")(value)
    if is_concrete(angle) and np.any(np.asarray(angle) > 0.5 * pi + 1e-6):
        raise BadInput(
            f"the light's cutoff is {float(angle):g}: give an angle in radians, up to pi/2"
        )
    return angle


class SpotLight(AbstractPointLight):
    """A light of intensity I_p max(0, cos)^e, the angle between its `direction` and the ray to a point.

    `direction` is where it shines, from the light, and need not be a unit vector; a zero vector shines
    nowhere. `exponent` e >= 0 says how narrow the cone is; 1 is a surface element that glows evenly
    (Lambert's cosine law). Beyond the angle `cutoff`, in radians up to pi/2, there is no light; None
    is none but the right angle. `position`, `intensity` and `attenuation` are those of a `PointLight`.
    Not smooth at the cutoff, where the light jumps to 0 (at a right angle it does not, for e > 0).

    >>> SpotLight((0, 0, 3), direction=(0, 0, -1), exponent=8).intensity.ndim
    0
    """

    position: Float[Array, "3"] = eqx.field(  # type: ignore[misc]
        converter=vector("the light's position")
    )
    direction: Float[Array, "3"] = eqx.field(  # type: ignore[misc]
        converter=vector("the light's direction")
    )
    intensity: Float[Array, "..."] = eqx.field(
        converter=floats("the light's intensity"), default=1.0
    )
    exponent: Float[Array, ""] = eqx.field(converter=positive("the light's exponent"), default=1.0)
    cutoff: Float[Array, ""] | None = eqx.field(converter=optional(_cutoff), default=None)
    attenuation: AbstractAttenuation | None = None
    visible: Float[Array, "..."] | None = eqx.field(converter=share, default=None, kw_only=True)

    def incidence(self, position: Vec3 | None) -> Incidence:
        arriving = super().incidence(position)
        cosine = -dot(arriving.l, unit(Vec3.from_array(self.direction)))
        shining = guard.power(cosine, self.exponent)
        if self.cutoff is not None:
            edge = jnp.cos(jnp.minimum(self.cutoff, 0.5 * pi))
            shining = jnp.where(cosine < edge, 0, shining)
        return arriving._replace(emission=shining)
