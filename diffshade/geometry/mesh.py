"""The triangle mesh."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from diffshade.arrays import floats, is_concrete, optional
from diffshade.errors import BadInput
from diffshade.fusion import stored
from diffshade.geometry.camera import AbstractCamera, Rays
from diffshade.geometry.fields import indices
from diffshade.geometry.normals import Weights, area_weights, plane_normals, vertex_normals
from diffshade.geometry.remembered import remembered
from diffshade.geometry.surface import AbstractSurface, Crossings, Visibility
from diffshade.vector import Vec3, direction, unit

__all__ = ["Mesh"]

NO_AREA = 1e-12
"""A triangle lower than this part of its longest edge has no area to double precision."""


class Mesh(AbstractSurface):
    """Triangles: `vertices` [V, 3] in world axes, `faces` [F, 3] counter-clockwise seen from outside.

    `normals` [V, 3], if given, are the vertex normals of Gouraud and Phong shading; otherwise they
    are means of those of the faces, and move with the vertices. `weights` says by what a face
    counts in a mean: its area, or another of the functions in `geometry.normals`. `slot` [F] numbers
    the material of each face where a mesh has several, and `materials` holds those that its file
    came with. Vertices may be traced by `jit` or `grad`; faces decide shapes and may not.

    Both sides of a triangle are seen, and its normals point to the outside on both: an open or
    inside-out surface seen from behind is dark where the light is on the viewer's side. In `layers`,
    for transparent surfaces, they are turned to the viewer.

    Raises `BadInput` for shapes that do not fit and for indices outside the vertices.

    >>> Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).faces.shape
    (1, 3)
    """

    vertices: Float[Array, "V 3"] = eqx.field(converter=floats("vertices"))
    faces: Int[Array, "F 3"] = eqx.field(converter=indices("faces"))
    normals: Float[Array, "V 3"] | None = eqx.field(
        converter=optional(floats("normals")), default=None
    )
    slot: Int[Array, "F"] | None = eqx.field(converter=optional(indices("slot")), default=None)
    materials: tuple[Any, ...] = ()
    weights: Weights = eqx.field(static=True, kw_only=True, default=area_weights)
    follows_rays: ClassVar[bool] = False

    def __check_init__(self) -> None:
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3:
            raise BadInput(f"vertices has shape {self.vertices.shape}: give [V, 3] coordinates")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3:
            raise BadInput(f"faces has shape {self.faces.shape}: give [F, 3] vertex numbers")
        if self.normals is not None and self.normals.shape != self.vertices.shape:
            raise BadInput(
                f"normals has shape {self.normals.shape} where vertices has {self.vertices.shape}"
            )
        if self.slot is not None and self.slot.shape != self.faces.shape[:1]:
            raise BadInput(f"slot has shape {self.slot.shape} for {self.faces.shape[0]} faces")
        if self.faces.size and is_concrete(self.faces):
            faces = np.asarray(self.faces)  # what JAX computes of it is traced inside jit
            low, high = int(faces.min()), int(faces.max())
            if low < 0 or high >= self.vertices.shape[0]:
                raise BadInput(
                    f"faces refers to vertices {low} to {high} of {self.vertices.shape[0]}:"
                    " numbers run from 0 to one below the count"
                )

    def corners(self) -> tuple[Vec3, Vec3, Vec3]:
        """The three vertices of every face."""
        a, b, c = (Vec3.from_array(self.vertices[self.faces[:, k]]) for k in range(3))
        return a, b, c

    def degenerate(self) -> Bool[np.ndarray, "F"]:
        """Which faces have no area, decided on concrete values: no pixel can see them."""
        corners = np.asarray(self.vertices, np.float64)[np.asarray(self.faces)]
        edges = corners - np.roll(corners, 1, axis=1)
        longest = (edges**2).sum(axis=2).max(axis=1)
        twice_area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        return ~(twice_area > NO_AREA * longest)

    def face_normals(self) -> Vec3:
        """The unit normal of every face's plane; zero for a degenerate face."""
        return plane_normals(*self.corners())

    def vertex_normals(self) -> Vec3:
        """The unit normal of every vertex: those given, or the weighted mean of its faces'.

        Zero where there is none: at a vertex of no face, or whose faces' normals cancel.
        """
        if self.normals is not None:
            return unit(Vec3.from_array(self.normals.astype(self.vertices.dtype)))
        return vertex_normals(self.vertices, self.faces, weights=self.weights)

    def visibility(self, camera: AbstractCamera) -> Visibility:
        from diffshade.geometry.raycast import cast  # the ray caster loads only for a mesh

        return cast(self, camera)

    def crossings(self, camera: AbstractCamera, count: int | None = None) -> Crossings:
        from diffshade.geometry.crossings import crossings

        return crossings(self, camera, count)

    def hides(
        self,
        points: Float[np.ndarray, "N 3"],
        towards: Float[np.ndarray, "N 3"],
        distance: Float[np.ndarray, "N"],
        eps: float,
    ) -> Bool[np.ndarray, "N"]:
        from diffshade.geometry.occlusion import hidden_by_mesh

        return hidden_by_mesh(self, points, towards, distance, eps)

    def prepared(self) -> "Mesh":
        if self.normals is not None:
            return self
        normals = _vertex_normals(jnp.asarray(self.vertices), jnp.asarray(self.faces), self.weights)
        return eqx.tree_at(lambda mesh: mesh.normals, self, normals, is_leaf=lambda x: x is None)

    def points(self, rays: Rays, visibility: Visibility) -> tuple[Vec3, Vec3]:
        face, barycentric = visibility.on_mesh()
        # Position and normal side by side: a vertex's six numbers are found at once, and once only.
        values = jnp.concatenate([self.vertices, self.vertex_normals().to_array()], axis=1)
        mean = stored(_interpolate, values, self.faces[face], barycentric)
        normal, side = direction(Vec3.from_array(mean[:, 3:])), visibility.side(mean.dtype)
        return Vec3.from_array(mean[:, :3]), normal if side is None else normal * side


def _interpolate(
    values: Float[Array, "V C"], corners: Int[Array, "P 3"], weights: Vec3
) -> Float[Array, "P C"]:
    a, b, c = (values[corners[:, k]] for k in range(3))
    return a * weights.x[:, None] + b * weights.y[:, None] + c * weights.z[:, None]


@remembered
@jax.jit(static_argnums=2)
def _vertex_normals(
    vertices: Float[Array, "V 3"], faces: Int[Array, "F 3"], weights: Weights
) -> Float[Array, "V 3"]:
    return vertex_normals(vertices, faces, weights=weights).to_array()
