"""What every surface is: something a camera sees through some pixels, with a position and a normal."""

from abc import abstractmethod
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from diffshade.errors import BadInput
from diffshade.geometry.camera import AbstractCamera, Rays
from diffshade.vector import Vec3

__all__ = ["AbstractSurface", "Crossings", "Visibility"]


class Visibility(eqx.Module):
    """Which pixels see a surface, and where: decided on concrete values, never differentiated.

    `index` numbers the foreground pixels row by row. On a mesh `face` is the triangle that each
    pixel sees and `barycentric` the weights of that triangle's vertices at the point it sees.
    """

    shape: tuple[int, int] = eqx.field(static=True)
    index: Int[Array, "P"]
    face: Int[Array, "P"] | None = None
    barycentric: Vec3 | None = None
    inside: Bool[Array, "P"] | None = None

    def side(self, dtype: np.dtype) -> Float[Array, "P"] | None:
        """1 where the surface is seen from outside, -1 from inside; None if nowhere."""
        return None if self.inside is None else 1 - 2 * self.inside.astype(dtype)

    def on_mesh(self) -> tuple[Int[Array, "P"], Vec3]:
        """The faces and the barycentric coordinates, which the visibility of a mesh has."""
        if self.face is None or self.barycentric is None:
            raise BadInput(
                "this visibility has no faces, so it is not that of a mesh: compute"
                " ds.visibility(mesh, camera)"
            )
        return self.face, self.barycentric


class Crossings(NamedTuple):
    """Where pixels' rays cross a surface: `visibility` has a pixel as often as its ray crosses.

    `distance` is measured along the rays of the camera, in double precision.
    """

    visibility: Visibility
    distance: Float[np.ndarray, "N"]


class AbstractSurface(eqx.Module):
    """A surface that can be seen.

    `follows_rays` says that `points` follows the pixels' rays to it, rather than find their points by
    what is known of the visible pixels.
    """

    follows_rays: eqx.AbstractClassVar[bool]

    @abstractmethod
    def visibility(self, camera: AbstractCamera) -> Visibility:
        """Which pixels see it, from concrete values."""

    @abstractmethod
    def crossings(self, camera: AbstractCamera, count: int | None = None) -> Crossings:
        """Where each pixel's ray crosses it, its first `count` times or always, from concrete values."""

    @abstractmethod
    def points(self, rays: Rays, visibility: Visibility) -> tuple[Vec3, Vec3]:
        """Positions and unit normals where the visible pixels' rays meet it, differentiable in both."""

    @abstractmethod
    def hides(
        self,
        points: Float[np.ndarray, "N 3"],
        towards: Float[np.ndarray, "N 3"],
        distance: Float[np.ndarray, "N"],
        eps: float,
    ) -> Bool[np.ndarray, "N"]:
        """Of which points it stands in the way to a source, `distance` off in a direction `towards` it.

        Directions are unit vectors, a distance may be infinite, and `eps` is the rounding of the points'
        coordinates. A point of the surface itself does not stand in its own way. On concrete values.
        """

    def prepared(self) -> "AbstractSurface":
        """The same surface, with what takes long and every camera needs computed beforehand."""
        return self
