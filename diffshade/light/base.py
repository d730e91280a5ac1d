"""What every light is: an intensity, and what of it arrives at a point."""

from abc import abstractmethod
from typing import NamedTuple

import equinox as eqx
from jaxtyping import Array, Float

from diffshade.vector import Vec3

__all__ = ["AbstractLight", "Incidence"]

Plane = Float[Array, "..."]


class Incidence(NamedTuple):
    """Light arriving at points: the unit vector l towards the source, and the factor on its intensity."""

    l: Vec3
    attenuation: Plane | None


class AbstractLight(eqx.Module):
    """A source of light with an intensity I_p: one number, or one a channel."""

    intensity: eqx.AbstractVar[Float[Array, "..."]]

    @abstractmethod
    def incidence(self, position: Vec3 | None) -> Incidence:
        """What arrives at the points `position` (None where a G-buffer has normals only)."""
