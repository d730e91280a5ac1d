"""Which triangle each pixel of a camera sees, by rays through the pixels' centres (Embree).

Embree works in single precision, so it is only asked *which* triangle a ray meets first, with the
mesh moved and scaled to the unit sphere, and every ray started just in front of that sphere: a mesh
may be tiny, huge or far from the origin. *Where* on the triangle is then computed again in double
precision.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from diffshade.errors import BadInput
from diffshade.geometry.camera import AbstractCamera
from diffshade.geometry.mesh import Mesh
from diffshade.geometry.surface import Visibility
from diffshade.vector import Vec3

__all__ = ["cast"]

BLOCK = 2**16
"""Pixels in flight at once: some 25 MB, whatever the size of the image (larger is not faster)."""


class _Rays(NamedTuple):
    """Rays in the mesh's unit coordinates, and the pixels that they go through."""

    pixel: Int[np.ndarray, "R"]
    origin: Float[np.ndarray, "R 3"]
    direction: Float[np.ndarray, "R 3"]


def cast(mesh: Mesh, camera: AbstractCamera) -> Visibility:
    """The foreground pixels, the face behind each, and the barycentric coordinates on it.

    A camera with a position sees what lies in front of it; an orthographic camera without one sees
    from in front of everything. Both sides of a triangle are seen. Triangles without area, which
    `Mesh.degenerate` names, are left out; a mesh that nothing is seen of gives no pixels.

    Raises `BadInput` where there is nothing to see (no faces, or none with an area), where a face
    has a vertex that is not finite, and where Embree is not installed.
    """
    corners = np.asarray(mesh.vertices, np.float64)[np.asarray(mesh.faces)]
    _check(mesh, corners)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    centre, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    solid = np.flatnonzero(~mesh.degenerate())
    if not solid.size:
        raise BadInput(
            f"none of the mesh's {len(corners)} triangles has an area: there is nothing to see"
        )
    corners = (corners[solid] - centre) / radius
    scene = _embree(corners)

    pixels, faces, weights = [], [], []
    for rays in _rays(camera, centre, radius):
        met = scene.run(rays.origin.astype(np.float32), rays.direction.astype(np.float32))
        hit = np.flatnonzero(met >= 0)
        barycentric, crosses = _barycentric(
            corners[met[hit]], rays.origin[hit], rays.direction[hit]
        )
        pixels.append(rays.pixel[hit][crosses])
        faces.append(solid[met[hit]][crosses])
        weights.append(barycentric[crosses])

    barycentric = np.concatenate(weights).astype(mesh.vertices.dtype)
    return Visibility(
        (camera.height, camera.width),
        index=jnp.asarray(np.concatenate(pixels), jnp.int32),
        face=jnp.asarray(np.concatenate(faces), jnp.int32),
        barycentric=Vec3.from_array(jnp.asarray(barycentric)),
    )


def _check(mesh: Mesh, corners: Float[np.ndarray, "F 3 3"]) -> None:
    if not len(corners):
        raise BadInput(
            f"the mesh has {mesh.vertices.shape[0]} vertices and no faces: give it triangles"
        )
    finite = np.isfinite(corners).all(axis=2)
    if not finite.all():
        vertex = np.asarray(mesh.faces)[~finite]
        raise BadInput(
            f"{np.unique(vertex).size} vertices of the mesh are not finite, the first of them number"
            f" {vertex.min()}: repair them, or leave out the faces that use them"
        )


def _embree(corners: Float[np.ndarray, "F 3 3"]) -> Any:
    """An Embree scene of triangles, built so that no ray slips through an edge that two share."""
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError:
        raise BadInput(
            "a mesh needs the ray caster embreex, which is not installed: pip install embreex (Linux"
            " and Windows on 64-bit Intel or AMD, macOS); spheres and G-buffers from arrays need no"
            " rays"
        ) from None
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, np.ascontiguousarray(corners, np.float32))
    return scene


def _rays(camera: AbstractCamera, centre: Float[np.ndarray, "3"], radius: float) -> Iterator[_Rays]:
    """The rays that meet the mesh's sphere, block by block, each started just in front of it."""
    total = camera.width * camera.height
    count = min(BLOCK, total)
    for start in range(0, total, count):
        pixel = np.arange(start, min(start + count, total))
        origin, direction = (
            np.asarray(vectors, np.float64)[: pixel.size]
            for vectors in _camera_rays(camera, start, count)
        )
        origin = (origin - centre) / radius
        along = -(origin * direction).sum(axis=1)  # where the ray is closest to the centre
        closest = origin + along[:, None] * direction
        first = along - 1.5
        meets = (closest**2).sum(axis=1) < 1 + 1e-6
        if camera.position is not None:
            meets &= along > -1.5
            first = np.maximum(first, 0)
        origin = closest + (first - along)[:, None] * direction
        yield _Rays(pixel[meets], origin[meets], direction[meets])


@jax.jit(static_argnames="count")
def _camera_rays(
    camera: AbstractCamera, start: Int[Array, ""], count: int
) -> tuple[Float[Array, "R 3"], Float[Array, "R 3"]]:
    rays = camera.rays(start + jnp.arange(count))
    origin, direction = (jnp.broadcast_to(vectors.to_array(), (count, 3)) for vectors in rays)
    return origin, direction


def _barycentric(
    corners: Float[np.ndarray, "R 3 3"],
    origin: Float[np.ndarray, "R 3"],
    direction: Float[np.ndarray, "R 3"],
) -> tuple[Float[np.ndarray, "R 3"], Bool[np.ndarray, "R"]]:
    """Where rays cross their triangles' planes, and which of them do (Moeller and Trumbore 1997).

    With edges e1 = b - a, e2 = c - a, s = o - a and det = e1.(d x e2), the weights of b and c are
    s.(d x e2)/det and d.(s x e1)/det. A ray that Embree's rounding took past an edge is put on it:
    weights are at least 0, and their sum is 1.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    across = np.cross(direction, c - a)
    det = ((b - a) * across).sum(axis=1)
    crosses = det != 0  # not in the plane itself
    det = np.where(crosses, det, 1)
    weight_b = ((origin - a) * across).sum(axis=1) / det
    weight_c = (direction * np.cross(origin - a, b - a)).sum(axis=1) / det
    weights = np.stack([1 - weight_b - weight_c, weight_b, weight_c], axis=1).clip(0, None)
    return weights / weights.sum(axis=1, keepdims=True), crosses
