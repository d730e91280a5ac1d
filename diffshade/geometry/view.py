"""A surface as a camera sees it: which pixels see what of it, and the G-buffer behind them."""

import dataclasses
from contextlib import nullcontext
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from diffshade.arrays import is_concrete, is_outermost
from diffshade.buckets import cut, pad
from diffshade.errors import BadInput
from diffshade.geometry.camera import AbstractCamera, Frame
from diffshade.geometry.frequency import AbstractFrequency, PhongShading, Samples
from diffshade.geometry.gbuffer import GBuffer
from diffshade.geometry.surface import AbstractSurface, Visibility
from diffshade.geometry.viewer import AbstractViewer

__all__ = ["gbuffer", "visibility"]

T = TypeVar("T")


def visibility(geometry: AbstractSurface, camera: AbstractCamera) -> Visibility:
    """Which pixels of a camera see what of a surface, decided on concrete values.

    Returns the foreground pixels and, for a mesh, the face behind each and the barycentric
    coordinates on it. Raises `BadInput` for a surface that cannot be seen (no faces, no radius),
    and when called on the tracers of an enclosing `jit` or `grad`: compute it outside.

    >>> from diffshade.geometry.camera import OrthographicCamera
    >>> from diffshade.geometry.sphere import Sphere
    >>> visibility(Sphere(), OrthographicCamera(4, 4, 2.0)).index.shape
    (12,)
    """
    if not is_concrete((geometry, camera)):
        raise BadInput(
            "visibility was asked for inside jit, grad or vmap, where it cannot be decided: compute"
            " ds.visibility(geometry, camera) outside and pass it to ds.gbuffer"
        )
    # Inside a `jit` what is concrete is computed at once; outside, that would slow the first call.
    with nullcontext() if is_outermost() else jax.ensure_compile_time_eval():
        camera.check()
        return geometry.visibility(camera)


def gbuffer(
    geometry: AbstractSurface,
    camera: AbstractCamera,
    visibility: Visibility | None = None,
    *,
    shading: AbstractFrequency | None = None,
) -> GBuffer:
    """The G-buffer of a surface behind a camera's foreground pixels.

    With `visibility` given it is jittable, and differentiable in the geometry and the camera at
    fixed visibility: the silhouette does not move. `shading` is how often a mesh is shaded:
    `PhongShading()` (a pixel each, the default), `FlatShading()` or `GouraudShading()`. Called
    outermost it is one program for many sizes of image, and geometry that has not changed is not
    cast at again.

    >>> from diffshade.geometry.camera import OrthographicCamera
    >>> from diffshade.geometry.sphere import Sphere
    >>> gbuffer(Sphere(), OrthographicCamera(4, 4, 2.0)).pixel_count
    12
    """
    seen = _visibility(geometry, camera) if visibility is None else visibility
    if seen.shape != (camera.height, camera.width):
        raise BadInput(
            f"the visibility is of {seen.shape[0]} x {seen.shape[1]} pixels, and the camera has"
            f" {camera.height} x {camera.width}: compute it for this camera"
        )
    shading = PhongShading() if shading is None else shading
    alone = is_outermost() and is_concrete((geometry, camera, seen, shading))
    if alone:
        samples, viewer = _in_bucket(geometry, camera, seen, shading)
    else:
        samples, viewer = _sized(geometry, camera, camera.frame, seen, shading)
    everywhere = seen.index.shape[0] == camera.width * camera.height
    return GBuffer(
        shape=seen.shape,
        normal=samples.normal,
        viewer=viewer,
        position=samples.position,
        index=None if everywhere else seen.index,
        slot=samples.slot,
        spread=samples.spread,
    )


_visibility = visibility


def _in_bucket(
    geometry: AbstractSurface,
    camera: AbstractCamera,
    seen: Visibility,
    shading: AbstractFrequency,
) -> tuple[Samples, AbstractViewer]:
    """`_sized`, by a program that serves all images with about as many foreground pixels.

    Rays are followed in double precision, whatever JAX's own is, and what they meet is rounded once:
    where a surface turns away, the last digit of a ray is a hundred times as large in the point.
    """
    count = seen.index.shape[0]
    more = dataclasses.replace(pad(seen), shape=(1, 1))
    given = geometry.prepared(), camera.unframed(), camera.frame, more, shading
    if geometry.follows_rays:
        with jax.enable_x64(True):
            samples, viewer = _in_double(*given)
    else:
        samples, viewer = _sized(*given)
    if samples.spread is None:
        return cut(samples, count), viewer
    spread = cut(samples.spread, count)
    points = dataclasses.replace(samples, spread=None)  # faces or vertices
    points = cut(pad(points), points.normal.x.size)
    return dataclasses.replace(points, spread=spread), viewer


@jax.jit
def _in_double(
    geometry: AbstractSurface,
    camera: AbstractCamera,
    frame: Frame,
    seen: Visibility,
    shading: AbstractFrequency,
) -> tuple[Samples, AbstractViewer]:
    """`_sized` in double precision, rounded to that of what is given."""
    given = geometry, camera, seen
    kinds = (x.dtype for x in jax.tree.leaves(given) if jnp.issubdtype(x.dtype, jnp.floating))
    own = np.result_type(*kinds)
    wide_geometry, wide_camera, wide_seen = _as_floats(given, np.dtype(float))
    return _as_floats(_sized(wide_geometry, wide_camera, frame, wide_seen, shading), own)


def _as_floats(tree: T, dtype: np.dtype) -> T:
    """The same with its floating point numbers of one type."""
    return jax.tree.map(
        lambda x: x.astype(dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x, tree
    )


@jax.jit
def _sized(
    geometry: AbstractSurface,
    camera: AbstractCamera,
    frame: Frame,
    seen: Visibility,
    shading: AbstractFrequency,
) -> tuple[Samples, AbstractViewer]:
    """What is shaded, and the viewer."""
    rays = camera.through(*frame.points(seen.index, camera.up.dtype))
    return shading.samples(geometry, rays, seen), camera.viewer
