"""What every light is: an intensity, from where it arrives at a point, and how much of it does."""

from abc import abstractmethod
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from diffshade.arrays import floats, is_concrete, optional
from diffshade.bounds import Ball, Cone
from diffshade.errors import BadInput
from diffshade.vector import Vec3

__all__ = ["AbstractLight", "AbstractRayLight", "Incidence", "Incoming", "share"]

Plane = Float[Array, "..."]

_shares = optional(floats("what is visible of a light"))


def share(value: Any) -> Plane | None:
    """The converter of `AbstractLight.visible`."""
    plane = _shares(value)
    if plane is not None and is_concrete(plane):
        numbers = np.asarray(plane)
        if not ((numbers >= 0) & (numbers <= 1)).all():
            raise BadInput(
                f"what is visible of a light is from {numbers.min():g} to {numbers.max():g}: give a"
                " share, 0 to 1"
            )
    return plane


class Incidence(NamedTuple):
    """From where light arrives: the unit vector l towards the source, and the distance to it.

    `distance` is None where the light's intensity does not depend on it. `emission` is a factor on
    the intensity, at most 1, of a light that does not shine the same to all sides; else None.
    """

    l: Vec3
    distance: Plane | None
    emission: Plane | None = None


class Incoming(NamedTuple):
    """The same for all points of a tile: the directions to the source, and the least distance."""

    l: Cone
    nearest: Plane | None


class AbstractLight(eqx.Module):
    """A source of light with an intensity: one number, or one a channel.

    `visible` is the share of it, 0 to 1, that each point of a G-buffer sees, a factor on the intensity
    there: a plane [P], as `shading.shadows` computes it. None, which is not compiled, is all of it.
    """

    intensity: eqx.AbstractVar[Float[Array, "..."]]
    visible: eqx.AbstractVar[Plane | None]

    @property
    def is_finite(self) -> bool:
        """Whether nothing arrives beyond some distance."""
        return False


class AbstractRayLight(AbstractLight):
    """One that reaches a point along one ray, with the intensity I_p."""

    @abstractmethod
    def incidence(self, position: Vec3 | None) -> Incidence:
        """From where light arrives at the points `position` (None of a G-buffer with normals only).

        Written for planes: no `jit`, `vmap` or loop around the functions of `guard` and `vector`.
        """

    def over(self, ball: Ball | None) -> Incoming | None:
        """`incidence` for all points of a ball; None, the default, of a light that is never left out.

        `falloff` must not rise with the distance where this is given. Both are mapped over lights.
        """
        return None

    @abstractmethod
    def falloff(self, distance: Plane | None) -> Plane | None:
        """The factor f on the intensity at the distance of `incidence`; None where it is 1."""
