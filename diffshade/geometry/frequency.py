"""How often a surface is shaded: once a face (flat), a vertex (Gouraud) or a pixel (Phong).

A frequency chooses the points that are shaded and, where these are not the pixels, how intensities
spread from them over the pixels. Shading itself never knows.
"""

from abc import abstractmethod

import equinox as eqx
from jaxtyping import Array, Float, Int

from diffshade.errors import BadInput
from diffshade.geometry.camera import Rays
from diffshade.geometry.mesh import Mesh
from diffshade.geometry.surface import AbstractSurface, Visibility
from diffshade.vector import Vec3

__all__ = [
    "AbstractFrequency",
    "FlatShading",
    "GouraudShading",
    "PhongShading",
    "Samples",
    "Spread",
]

Plane = Float[Array, "..."]


class Spread(eqx.Module):
    """How the intensities of shaded points reach the pixels."""

    @abstractmethod
    def __call__(self, plane: Float[Array, "S"]) -> Float[Array, "P"]:
        """From one value a shaded point to one a pixel."""


class PerFace(Spread):
    """Every pixel has the intensity of its face."""

    face: Int[Array, "P"]

    def __call__(self, plane: Float[Array, "S"]) -> Float[Array, "P"]:
        return plane[self.face]


class PerVertex(Spread):
    """Linear interpolation of the intensities at a face's three vertices (text B)."""

    corners: tuple[Int[Array, "P"], Int[Array, "P"], Int[Array, "P"]]
    barycentric: Vec3

    def __call__(self, plane: Float[Array, "S"]) -> Float[Array, "P"]:
        a, b, c = self.corners
        w = self.barycentric
        return w.x * plane[a] + w.y * plane[b] + w.z * plane[c]


class Samples(eqx.Module):
    """The points that are shaded."""

    position: Vec3
    normal: Vec3
    slot: Int[Array, "S"] | None = None
    spread: Spread | None = None


class AbstractFrequency(eqx.Module):
    """A choice of the points that are shaded."""

    @abstractmethod
    def samples(self, geometry: AbstractSurface, rays: Rays, visibility: Visibility) -> Samples:
        """The points, differentiable in the geometry and the visible pixels' rays."""


class PhongShading(AbstractFrequency):
    """Every pixel is shaded, with the interpolated and renormalised normal (text B)."""

    def samples(self, geometry: AbstractSurface, rays: Rays, visibility: Visibility) -> Samples:
        position, normal = geometry.points(rays, visibility)
        slot = None
        if isinstance(geometry, Mesh) and geometry.slot is not None:
            slot = geometry.slot[visibility.on_mesh()[0]]
        return Samples(position, normal, slot)


class FlatShading(AbstractFrequency):
    """Every face is shaded once, at its centroid with its plane's normal (text B).

    It is adequate where light and viewer are far from the mesh.
    """

    def samples(self, geometry: AbstractSurface, rays: Rays, visibility: Visibility) -> Samples:
        mesh = _mesh(geometry, self)
        face, _ = visibility.on_mesh()
        a, b, c = mesh.corners()
        centroid, normal = (a + b + c) * (1 / 3), mesh.face_normals()
        side = visibility.side(normal.x.dtype)
        if mesh.slot is not None or side is not None:
            # Coefficients or sides differ from pixel to pixel: spread the faces first
            turned = normal[face] if side is None else normal[face] * side
            return Samples(centroid[face], turned, None if mesh.slot is None else mesh.slot[face])
        return Samples(centroid, normal, None, PerFace(face))


class GouraudShading(AbstractFrequency):
    """Every vertex is shaded once, and intensities are interpolated linearly over faces (text B).

    Highlights that fall between vertices are lost; that is the method, not an error.
    """

    def samples(self, geometry: AbstractSurface, rays: Rays, visibility: Visibility) -> Samples:
        mesh = _mesh(geometry, self)
        if mesh.slot is not None:
            raise BadInput(
                "Gouraud shading of a mesh with slots: a vertex between two materials has no one"
                " colour; use PhongShading() or FlatShading(), or give each material its own mesh"
            )
        if visibility.inside is not None:
            raise BadInput(
                "Gouraud shading of a layer: a vertex that is seen from both sides has no one"
                " intensity; use PhongShading() or FlatShading()"
            )
        face, barycentric = visibility.on_mesh()
        a, b, c = mesh.faces[face].T
        spread = PerVertex((a, b, c), barycentric)
        return Samples(Vec3.from_array(mesh.vertices), mesh.vertex_normals(), None, spread)


def _mesh(geometry: AbstractSurface, frequency: AbstractFrequency) -> Mesh:
    if not isinstance(geometry, Mesh):
        raise BadInput(
            f"{type(frequency).__name__} of a {type(geometry).__name__}, which has no faces: use a"
            " mesh, or PhongShading()"
        )
    return geometry
