"""What a material makes of one light, as a function of directions alone."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.channels import Channels, channels, plus, times
from diffshade.light.parallel import ParallelLight
from diffshade.reflectance.material import Material
from diffshade.shading.one_light import Angles, unlit
from diffshade.vector import Vec3

__all__ = ["AbstractResponse", "Exact", "upright"]

Plane = Float[Array, "P"]

_STRAIGHT: Any = (0.0, 0.0, 1.0)
_UNIT: Any = 1.0


class AbstractResponse(eqx.Module):
    """The radiance towards v of a surface of normal (0, 0, 1) in light from l with I_p = 1.

    Of nothing else: no attenuation, no ambient light.
    """

    @abstractmethod
    def __call__(self, l: Vec3, v: Vec3) -> Channels:
        """One plane, or one a channel, for unit vectors l and v."""


class Exact(AbstractResponse):
    """k_d O_d n.l + k_s O_s s(n, l, v), of a material whose coefficients are no maps.

    >>> straight = Vec3(*(jnp.asarray([x]) for x in (0.0, 0.0, 1.0)))
    >>> float(Exact(Material(kd=0.5))(straight, straight)[0][0])
    0.5
    """

    material: Material

    def __call__(self, l: Vec3, v: Vec3) -> Channels:
        own = self.material
        n, n_dot_l = upright(l), l.z
        lobes = tuple(lobe.angles(n, l, v, n_dot_l) for lobe in own.specular)
        seen = Angles(n_dot_l, lobes, None, guard.positive(v.z))
        diffuse, specular = unlit(seen, ParallelLight(_STRAIGHT, _UNIT), own)
        found: Channels = (jnp.zeros_like(n_dot_l),)
        if diffuse is not None and own.kd is not None:
            found = times(_coloured(own.kd, own.od), diffuse)
        for lobe, shape in zip(own.specular, specular, strict=True):
            found = plus(found, times(_coloured(lobe.ks, own.os), shape))
        return found


def upright(like: Vec3) -> Vec3:
    """The normal (0, 0, 1) at each point."""
    nothing = jnp.zeros_like(like.z)
    return Vec3(nothing, nothing, jnp.ones_like(like.z))


def _coloured(k: Float[Array, "..."], colour: Float[Array, "..."] | None) -> Channels:
    return channels(k) if colour is None else times(channels(k), channels(colour))
