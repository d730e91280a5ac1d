"""Which triangle each pixel of a camera sees, by rays through the pixels' centres (Embree).

Embree works in single precision, so it is only asked *which* triangle a ray meets first, with the
mesh moved and scaled to the unit sphere, and every ray started just in front of that sphere: a mesh
may be tiny, huge or far from the origin. *Where* on the triangle is then computed again in double
precision, whatever JAX's own is.

Every core casts the rays of a block of pixels of its own, made by a program that is the same for all
sizes of image: Embree lets go of Python's lock since embreex 4.4. Before, casts take turns.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from diffshade.buckets import bucket, cut, pad
from diffshade.errors import BadInput
from diffshade.fusion import processors, stored
from diffshade.geometry.camera import AbstractCamera, Frame, Rays
from diffshade.geometry.mesh import Mesh
from diffshade.geometry.remembered import remembered
from diffshade.geometry.surface import Visibility
from diffshade.vector import Vec3, cross, dot

__all__ = ["BLOCK", "Target", "View", "approach", "barycentric_coordinates", "cast", "target_of"]

BLOCK = 2**15
"""Pixels whose rays a thread has in memory at once, whatever the size of the image."""

VIEWS = 4
"""How many cameras' views of a mesh are remembered."""


class Target(NamedTuple):
    """A mesh that rays can be cast at, in its unit coordinates, and the last views of it."""

    scene: Any
    solid: Int[np.ndarray, "S"]
    """The faces that have an area: Embree knows only these."""
    corners: Float[Array, "S 9"]
    centre: Float[Array, "3"]
    radius: Float[Array, ""]
    views: dict[Any, Visibility]


class View(NamedTuple):
    """What the programs know of a camera and of the mesh's sphere, as numbers."""

    camera: AbstractCamera
    frame: Frame
    centre: Float[Array, "3"]
    radius: Float[Array, ""]

    @classmethod
    def of(cls, target: Target, camera: AbstractCamera) -> "View":
        """In double precision."""
        exact = jax.tree.map(partial(np.asarray, dtype=np.float64), camera.unframed())
        return cls(exact, camera.frame, target.centre, target.radius)


def cast(mesh: Mesh, camera: AbstractCamera) -> Visibility:
    """The foreground pixels, the face behind each, and the barycentric coordinates on it.

    A camera with a position sees what lies in front of it; an orthographic camera without one sees
    from in front of everything. Both sides of a triangle are seen. Triangles without area, which
    `Mesh.degenerate` names, are left out; a mesh that nothing is seen of gives no pixels.

    Embree's scene is kept while the mesh's vertices and faces live, and so is what the last cameras
    saw: geometry that has not changed is not cast at again.

    Raises `BadInput` where there is nothing to see (no faces, or none with an area), where a face
    has a vertex that is not finite, and where Embree is not installed.
    """
    target = target_of(mesh)
    leaves, structure = jax.tree.flatten(camera)
    key = structure, *((str(np.asarray(x).dtype), np.asarray(x).tobytes()) for x in leaves)
    seen = target.views.pop(key, None)
    if seen is None:
        seen = _cast(target, camera, mesh.vertices.dtype)
    target.views[key] = seen
    for oldest in list(target.views)[:-VIEWS]:
        target.views.pop(oldest, None)
    return seen


def target_of(mesh: Mesh) -> Target:
    """The mesh as Embree knows it, kept while its vertices and faces live. Raises as `cast` does."""
    return _target(jnp.asarray(mesh.vertices), jnp.asarray(mesh.faces))


@remembered
def _target(vertices: Float[Array, "V 3"], faces: Int[Array, "F 3"]) -> Target:
    points, triangles = np.asarray(vertices, np.float64), np.asarray(faces)
    used = np.zeros(len(points), bool)
    used[triangles] = True  # the other vertices may be anything
    _check(points, triangles, used)
    points, triangles = points[used], (np.cumsum(used) - 1)[triangles]
    solid = np.flatnonzero(~Mesh(vertices, faces).degenerate())
    if not solid.size:
        raise BadInput(
            f"none of the mesh's {len(triangles)} triangles has an area: there is nothing to see"
        )
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = np.linalg.norm(points - centre, axis=1).max()
    points, triangles = (points - centre) / radius, triangles[solid].astype(np.int32)
    scene = _embree(points.astype(np.float32), triangles)
    with jax.enable_x64(True):
        return Target(
            scene,
            solid.astype(np.int32),
            corners=jnp.asarray(points[triangles].reshape(-1, 9)),
            centre=jnp.asarray(centre),
            radius=jnp.asarray(radius),
            views={},
        )


def _check(
    points: Float[np.ndarray, "V 3"], triangles: Int[np.ndarray, "F 3"], used: Bool[np.ndarray, "V"]
) -> None:
    if not len(triangles):
        raise BadInput(f"the mesh has {len(points)} vertices and no faces: give it triangles")
    bad = np.flatnonzero(used & ~np.isfinite(points).all(axis=1))
    if bad.size:
        raise BadInput(
            f"{bad.size} vertices of the mesh are not finite, the first of them number {bad[0]}:"
            " repair them, or leave out the faces that use them"
        )


def _embree(points: Float[np.ndarray, "U 3"], triangles: Int[np.ndarray, "S 3"]) -> Any:
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
    TriangleMesh(scene, points, triangles)
    none = np.zeros((0, 3), np.float32)
    scene.run(none, none)  # builds it, before several threads cast at it
    return scene


def _cast(target: Target, camera: AbstractCamera, dtype: np.dtype) -> Visibility:
    total = camera.width * camera.height
    count = min(BLOCK, bucket(total))
    view = View.of(target, camera)
    with ThreadPoolExecutor(processors()) as threads:
        block = partial(_block, target.scene, view, total, count)
        blocks = threads.map(block, range(0, total, count))
        pixel, met = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    where = pad((pixel, met))
    with jax.enable_x64(True):
        barycentric, crosses = barycentric_coordinates(view, *where, target.corners, dtype)
    seen = (where[0], target.solid.take(where[1]), barycentric)
    kept = np.flatnonzero(np.asarray(crosses)[: pixel.size])
    if kept.size < pixel.size:
        seen = pad(jax.tree.map(lambda plane: np.asarray(plane).take(kept), seen))
    index, face, barycentric = cut(seen, kept.size)
    return Visibility((camera.height, camera.width), index, face, barycentric)


def _block(
    scene: Any, view: View, total: int, count: int, start: int
) -> tuple[Int[np.ndarray, "P"], Int[np.ndarray, "P"]]:
    """Those of a block of pixels that see the mesh, and the triangles that their rays meet.

    A row is a ray's origin and direction: some of the rows are faster to pick than some of six planes.
    """
    with jax.enable_x64(True):
        rows, meets = _rays(view, np.int32(start), count)
    chosen = np.flatnonzero(np.asarray(meets)[: total - start])
    ray = np.asarray(rows).take(chosen, axis=0)
    met = scene.run(ray[:, :3], ray[:, 3:])
    hit = np.flatnonzero(met >= 0)
    return (start + chosen.take(hit)).astype(np.int32), met.take(hit)


@jax.jit(static_argnames="count")
def _rays(
    view: View, start: Int[Array, ""], count: int
) -> tuple[Float[Array, "N 6"], Bool[Array, "N"]]:
    """The rays through pixels, for Embree, and which of them meet the mesh's sphere."""
    (o, d), _, meets = approach(view, start + jnp.arange(count, dtype=jnp.int32))
    d = Vec3(*(jnp.broadcast_to(plane, (count,)) for plane in (d.x, d.y, d.z)))
    rows = jnp.stack([o.x, o.y, o.z, d.x, d.y, d.z], axis=1)
    return rows.astype(jnp.float32), meets


def approach(
    view: View, pixel: Int[Array, "N"]
) -> tuple[Rays, Float[Array, "N"], Bool[Array, "N"]]:
    """Pixels' rays in the mesh's unit coordinates, started just in front of its sphere.

    How far that is along the camera's rays, and which of them meet the sphere.
    """
    camera = view.camera
    origin, direction = camera.through(*view.frame.points(pixel, camera.up.dtype))
    origin = (origin - Vec3.from_array(view.centre)) * (1 / view.radius)
    along = -dot(origin, direction)  # where the ray is closest to the centre
    closest = origin + along * direction
    first = along - 1.5
    meets = dot(closest, closest) < 1 + 1e-6
    if camera.position is not None:
        meets &= along > -1.5
        first = jnp.maximum(first, 0)
    return Rays(closest + (first - along) * direction, direction), first, meets


@jax.jit(static_argnames="dtype")
def barycentric_coordinates(
    view: View,
    pixel: Int[Array, "N"],
    triangle: Int[Array, "N"],
    corners: Float[Array, "S 9"],
    dtype: np.dtype,
) -> tuple[Vec3, Bool[Array, "N"]]:
    """Where pixels' rays cross their triangles' planes, and which do (Moeller and Trumbore 1997).

    With edges e1 = b - a, e2 = c - a, s = o - a and det = e1.(d x e2), the weights of b and c are
    s.(d x e2)/det and d.(s x e1)/det. A ray that Embree's rounding took past an edge is put on it:
    weights are at least 0, and their sum is 1.
    """

    def volumes() -> tuple[Float[Array, "N"], ...]:
        (o, d), _, _ = approach(view, pixel)
        abc = corners.at[triangle].get(mode="promise_in_bounds")
        a, b, c = (Vec3.from_array(abc[:, k : k + 3]) for k in (0, 3, 6))
        s, e1, e2 = o - a, b - a, c - a
        across = cross(d, e2)
        return dot(e1, across), dot(s, across), dot(d, cross(s, e1))

    det, by_b, by_c = stored(volumes)
    crosses = det != 0  # not in the plane itself
    det = jnp.where(crosses, det, 1)
    weight_b, weight_c = by_b / det, by_c / det
    weights = [jnp.maximum(weight, 0) for weight in (1 - weight_b - weight_c, weight_b, weight_c)]
    scale = 1 / (weights[0] + weights[1] + weights[2])
    return Vec3(*((weight * scale).astype(dtype) for weight in weights)), crosses
