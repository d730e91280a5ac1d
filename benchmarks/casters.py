"""Other casters of a mesh's rays: Open3D and Mitsuba 3, both by Embree, on all cores of the process.

Mesh and rays are in the caster's own form before a call, in single precision, and what a call finds
stays in it. Mitsuba is told to let no ray slip through an edge, as our own bare cast is.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from benchmarks.rivals import threads

__all__ = ["CASTERS", "Caster", "difference"]


class Caster(NamedTuple):
    """A cast of all rays, and how to read what it returns."""

    cast: Callable[[], Any]
    hits: Callable[[Any], tuple[np.ndarray, np.ndarray]]
    """The triangle that each ray hits, or -1, and where [N, 3]."""


def _open3d(
    points: np.ndarray, triangles: np.ndarray, origin: np.ndarray, direction: np.ndarray
) -> Caster:
    """Distances, triangles and where on them, and their normals: Open3D has no less."""
    from open3d.core import Tensor
    from open3d.t.geometry import RaycastingScene

    scene = RaycastingScene()
    scene.add_triangles(Tensor(points), Tensor(triangles.astype(np.uint32)))
    rays = Tensor(np.hstack([origin, direction]))

    def hits(found: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
        face = found["primitive_ids"].numpy().astype(np.int32)  # -1 from 2**32 - 1
        return face, _points(points[triangles[face]], found["primitive_uvs"].numpy())

    return Caster(lambda: scene.cast_rays(rays, nthreads=threads()), hits)


def _mitsuba(
    points: np.ndarray,
    triangles: np.ndarray,
    origin: np.ndarray,
    direction: np.ndarray,
    bare: bool,
) -> Caster:
    """Distances, triangles and where on them; or, not `bare`, the positions and normals there."""
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    dr.set_thread_count(threads())
    mesh = mi.Mesh("mesh", len(points), len(triangles), has_vertex_normals=True)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(points.ravel())
    parameters["faces"] = mi.UInt32(triangles.ravel().astype(np.uint32))
    parameters.update()  # computes the normals
    scene = mi.load_dict({"type": "scene", "embree_use_robust_intersections": True, "mesh": mesh})
    ray = mi.Ray3f(mi.Point3f(origin.T), mi.Vector3f(direction.T))
    dr.make_opaque(ray)

    @dr.freeze
    def found(scene: mi.Scene, ray: mi.Ray3f) -> tuple[Any, ...]:
        if bare:
            hit = scene.ray_intersect_preliminary(ray, coherent=True)
            return hit.is_valid(), hit.prim_index, hit.prim_uv, hit.t
        at = scene.ray_intersect(ray, mi.RayFlags.Minimal | mi.RayFlags.ShadingFrame, True)
        return at.is_valid(), at.prim_index, at.p, at.sh_frame.n

    def cast() -> tuple[Any, ...]:
        result = found(scene, ray)
        dr.eval(result)
        dr.sync_thread()
        return result

    def hits(result: tuple[Any, ...]) -> tuple[np.ndarray, np.ndarray]:
        valid, index, where, _ = result
        face = np.where(valid.numpy(), index.numpy().astype(np.int32), -1)
        where = where.numpy().T
        return face, _points(points[triangles[face]], where) if bare else where

    return Caster(cast, hits)


def _points(corners: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Those of barycentric coordinates, the second and third corners' weights."""
    a, b, c = corners.transpose(1, 0, 2)
    u, v = uv.T[:, :, None]
    return a + u * (b - a) + v * (c - a)


def difference(hits: tuple[np.ndarray, np.ndarray], face: np.ndarray, position: np.ndarray) -> str:
    """In words, how far hits are from each ray's `face`, or -1, and `position`."""
    found, where = hits
    both = (found >= 0) & (face >= 0)
    otherwise = np.mean((found >= 0) != (face >= 0))
    another = np.mean(both & (found != face))
    far = np.linalg.norm(where[both] - position[both], axis=1).max()
    return (
        f"{otherwise:.1e} of the rays hit or miss otherwise, {another:.1e} hit another triangle,"
        f" positions are at most {far:.1e} off"
    )


CASTERS: dict[str, Callable[..., Caster]] = {
    "Open3D's cast": _open3d,
    "Mitsuba's cast": partial(_mitsuba, bare=True),
    "Mitsuba's positions and normals": partial(_mitsuba, bare=False),
}
