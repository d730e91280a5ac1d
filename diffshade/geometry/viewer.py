"""Where the observer is: at a point, or so far away that every direction to it is the same."""

from abc import abstractmethod

import equinox as eqx
from jaxtyping import Array, Float

from diffshade.arrays import vector
from diffshade.bounds import Ball, Cone
from diffshade.errors import BadInput
from diffshade.vector import Vec3, direction, unit

__all__ = ["AbstractViewer", "DistantViewer", "Eye"]


class AbstractViewer(eqx.Module):
    """The observer of a surface."""

    @abstractmethod
    def direction(self, position: Vec3 | None) -> Vec3:
        """v, the unit vector from the surface to the observer (LIGHT-7)."""

    @abstractmethod
    def over(self, ball: Ball | None) -> Cone:
        """v for all points of a ball."""


class Eye(AbstractViewer):
    """An observer at a point: v = (eye - P) / |eye - P| (LIGHT-7a, 7b)."""

    position: Float[Array, "3"] = eqx.field(converter=vector("eye"))

    def direction(self, position: Vec3 | None) -> Vec3:
        if position is None:
            raise BadInput(
                "an eye needs positions, and this G-buffer has normals only: give"
                " GBuffer.from_arrays a position, or a constant view direction"
            )
        return direction(Vec3.from_array(self.position) - position)

    def over(self, ball: Ball | None) -> Cone:
        if ball is None:
            raise BadInput("an eye needs positions, and this G-buffer has normals only")
        return ball.towards(Vec3.from_array(self.position))


class DistantViewer(AbstractViewer):
    """An observer at infinity, as an orthographic camera has it: v is one constant direction."""

    view: Float[Array, "3"] = eqx.field(converter=vector("view"))

    def direction(self, position: Vec3 | None) -> Vec3:
        return unit(Vec3.from_array(self.view))

    def over(self, ball: Ball | None) -> Cone:
        return Cone.ray(self.direction(None))
