"""All surfaces of a mesh that each pixel's ray crosses, one behind the other (Embree).

Embree tells the first triangle that a ray meets. What is behind it a second ray meets, which starts
just beyond the first crossing, and so on. Embree works in single precision, and may meet the same
triangle again, or its neighbour at the edge that they share. *Where* a ray crosses a triangle's plane is
therefore computed in double precision, and a crossing counts only if it lies more than `APART` behind
the last. If it does not, the ray starts farther and farther on until it meets another one: at grazing
angles rounding is as much longer along the ray as the surfaces there are farther apart.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from diffshade.buckets import bucket
from diffshade.fusion import processors
from diffshade.geometry import raycast
from diffshade.geometry.camera import AbstractCamera
from diffshade.geometry.mesh import Mesh
from diffshade.geometry.raycast import Target, View, approach, barycentric_coordinates
from diffshade.geometry.surface import Crossings, Visibility
from diffshade.vector import Vec3, cross, dot

__all__ = ["APART", "crossings"]

APART = 2.0**-21
"""Crossings that are nearer to each other along a ray are one, in radii of the mesh: four roundings of
single precision."""


class _Crossed(NamedTuple):
    """Crossings of rays and triangles."""

    pixel: Int[np.ndarray, "N"]
    triangle: Int[np.ndarray, "N"]
    weights: Float[np.ndarray, "N 3"]
    inside: Bool[np.ndarray, "N"]
    along: Float[np.ndarray, "N"]
    """How far from where the ray approaches the mesh, in its radii."""
    distance: Float[np.ndarray, "N"]
    """How far from where the camera's ray starts, in world units."""


def crossings(mesh: Mesh, camera: AbstractCamera, count: int | None = None) -> Crossings:
    """What each pixel sees of a mesh, and behind it, up to `count` times; None is all.

    The first is what `raycast.cast` gives. Triangles that coincide, to single precision of the mesh's
    extent, count as one. Raises `BadInput` as `cast` does.
    """
    nearest = raycast.cast(mesh, camera)
    target = raycast.target_of(mesh)
    pixel = np.asarray(nearest.index)
    first = np.searchsorted(target.solid, np.asarray(nearest.face)).astype(np.int32)
    size = min(raycast.BLOCK, bucket(camera.width * camera.height))
    parts = [slice(start, start + size) for start in range(0, max(pixel.size, 1), size)]
    block = _Block(target, View.of(target, camera), size, mesh.vertices.dtype)
    with ThreadPoolExecutor(processors()) as threads:
        given = ([plane[part] for part in parts] for plane in (pixel, first))
        blocks = threads.map(partial(_peeled, block, count), *given)
        found = _Crossed(*map(np.concatenate, zip(*blocks, strict=True)))
    index, face, inside, *weights = jax.device_put(
        (found.pixel, target.solid.take(found.triangle), found.inside, *found.weights.T.copy())
    )
    seen = Visibility(nearest.shape, index, face, Vec3(*weights), inside)
    return Crossings(seen, found.distance)


class _Block(NamedTuple):
    """What the rays of a block meet, and how many there are at most."""

    target: Target
    view: View
    size: int
    dtype: np.dtype

    def filled(self, plane: np.ndarray) -> np.ndarray:
        """A plane of the block's size: one program serves all blocks, however few rays are left."""
        filled = np.zeros(self.size, plane.dtype)
        filled[: plane.size] = plane
        return filled


def _peeled(
    block: _Block, count: int | None, pixel: Int[np.ndarray, "N"], met: Int[np.ndarray, "N"]
) -> _Crossed:
    """All crossings of a block's rays, whose first triangles are `met`."""
    last, start = np.full(pixel.size, -np.inf), np.zeros(pixel.size)
    step, seen = np.full(pixel.size, APART), np.zeros(pixel.size, int)
    found = []
    while True:
        here = _crossed(block, pixel, met)
        new = np.isfinite(here.along) & (here.along > last + APART)
        found.append(_Crossed(*(plane[new] for plane in here)))
        last = np.where(new, here.along, last)
        step = np.where(new, APART, 2 * step)
        start = np.where(new, here.along, start) + step
        seen += new
        wanted = np.full(pixel.size, True) if count is None else seen < count
        met = np.full(pixel.size, -1, np.int32)
        met[wanted] = _next(block, pixel[wanted], start[wanted])
        going = met >= 0
        if not going.any():
            return _Crossed(*map(np.concatenate, zip(*found, strict=True)))
        pixel, met, last, start, step, seen = (
            plane[going] for plane in (pixel, met, last, start, step, seen)
        )


def _next(
    block: _Block, pixel: Int[np.ndarray, "N"], start: Float[np.ndarray, "N"]
) -> Int[np.ndarray, "N"]:
    """The first triangle that each ray meets beyond its start, or -1."""
    with jax.enable_x64(True):
        rows = _restarted(block.view, block.filled(pixel), block.filled(start))
    ray = np.asarray(rows)[: pixel.size]
    return block.target.scene.run(ray[:, :3], ray[:, 3:]).astype(np.int32)


def _crossed(
    block: _Block, pixel: Int[np.ndarray, "N"], triangle: Int[np.ndarray, "N"]
) -> _Crossed:
    """Where each ray crosses its triangle's plane: infinitely far, or nowhere, if it lies in it."""
    with jax.enable_x64(True):
        given = block.filled(pixel), block.filled(triangle)
        planes = _planes(block.view, *given, block.target.corners, block.dtype)
    height, slope, first, weights = (np.asarray(plane)[: pixel.size] for plane in planes)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = height / slope
    distance = (first + along) * np.asarray(block.view.radius)
    return _Crossed(pixel, triangle, weights, slope > 0, along, distance)


@jax.jit
def _restarted(view: View, pixel: Int[Array, "N"], start: Float[Array, "N"]) -> Float[Array, "N 6"]:
    """Rays for Embree from so far along those that `approach` the mesh."""
    (o, d), _, _ = approach(view, pixel)
    o = o + start * d
    planes = (jnp.broadcast_to(x, start.shape) for x in (o.x, o.y, o.z, d.x, d.y, d.z))
    return jnp.stack(list(planes), axis=1).astype(jnp.float32)


@jax.jit(static_argnames="dtype")
def _planes(
    view: View,
    pixel: Int[Array, "N"],
    triangle: Int[Array, "N"],
    corners: Float[Array, "S 9"],
    dtype: np.dtype,
) -> tuple[Float[Array, "N"], Float[Array, "N"], Float[Array, "N"], Float[Array, "N 3"]]:
    """(a - o).n and d.n of a triangle's plane, n = (b - a) x (c - a); where the ray starts; weights."""
    (o, d), first, _ = approach(view, pixel)
    abc = corners.at[triangle].get(mode="promise_in_bounds")
    a, b, c = (Vec3.from_array(abc[:, k : k + 3]) for k in (0, 3, 6))
    n = cross(b - a, c - a)
    weights, _ = barycentric_coordinates(view, pixel, triangle, corners, dtype)
    return dot(a - o, n), dot(d, n), first, weights.to_array()
