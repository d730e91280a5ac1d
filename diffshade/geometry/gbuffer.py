"""The G-buffer: what shading needs to know of the surface behind each foreground pixel."""

import dataclasses
from contextlib import nullcontext

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from diffshade.arrays import ArrayLike, is_concrete, is_outermost, vector
from diffshade.buckets import bucket, cut, pad
from diffshade.errors import BadInput
from diffshade.geometry.camera import AbstractCamera, Frame
from diffshade.geometry.frequency import AbstractFrequency, PhongShading, Samples, Spread
from diffshade.geometry.surface import AbstractSurface, Visibility
from diffshade.geometry.viewer import AbstractViewer, DistantViewer, Eye
from diffshade.vector import Vec3, unit

__all__ = ["GBuffer", "gbuffer", "visibility"]

Planes = tuple[Shaped[Array, "P"], ...]


class GBuffer(eqx.Module):
    """Foreground points as planes, with an index back to the image; background is not stored.

    `position` is None where only normals are known, which is enough for parallel lights seen from
    afar. `index` is None where every pixel is foreground. `slot` numbers the material of each
    pixel of an object that has several. With `spread` the points are not pixels but the faces or
    vertices of a mesh, shaded once each and spread over the pixels (flat and Gouraud shading).
    """

    shape: tuple[int, int] = eqx.field(static=True)
    normal: Vec3
    viewer: AbstractViewer
    position: Vec3 | None = None
    index: Int[Array, "P"] | None = None
    slot: Int[Array, "P"] | None = None
    spread: Spread | None = None

    @property
    def pixel_count(self) -> int:
        """How many foreground pixels there are."""
        return self.shape[0] * self.shape[1] if self.index is None else self.index.shape[0]

    @property
    def mask(self) -> Bool[np.ndarray, "H W"]:
        """Which pixels are foreground: a plain array, of a G-buffer that is not traced."""
        inside = np.zeros(self.shape, bool)
        inside.flat[slice(None) if self.index is None else np.asarray(self.index)] = True
        return inside

    def to_image(self, planes: Planes) -> Shaped[Array, "H W C"]:
        """An image [H, W, C] from one plane a channel over the foreground; background is 0."""
        rows = jnp.stack(planes, axis=-1)
        if self.index is not None:
            count = self.shape[0] * self.shape[1]
            rows = (
                jnp.zeros((count, len(planes)), rows.dtype)
                .at[self.index]
                .set(rows, unique_indices=True, indices_are_sorted=True)
            )
        return rows.reshape(*self.shape, len(planes))

    def from_image(self, image: Float[Array, "H W C"]) -> Float[Array, "C P"]:
        """The foreground of an image [H, W, C], one plane a channel."""
        planes = image.reshape(-1, image.shape[-1]).T
        return planes if self.index is None else planes[:, self.index]

    @staticmethod
    def from_arrays(
        position: ArrayLike | None,
        normal: ArrayLike,
        mask: ArrayLike | None = None,
        *,
        eye: ArrayLike | None = None,
        view: ArrayLike = (0.0, 0.0, 1.0),
    ) -> "GBuffer":
        """A G-buffer from [H, W, 3] arrays in world axes (x right, y up, z to the viewer).

        Normals need not have unit length. `position` may be None where lights are parallel and the
        view is constant. `mask` [H, W] says which pixels are foreground; without it, those whose
        normal is finite and not zero. The viewer is at the point `eye`, or else in the one
        direction `view` from everywhere. Arrays may be traced by `jit` or `grad`, the mask may not;
        traced normals without a mask make every pixel foreground, as nothing can tell otherwise.

        Raises `BadInput` for shapes that do not match, an empty mask, masked pixels with no finite
        position or normal, and an eye without positions.

        >>> GBuffer.from_arrays(None, np.ones((4, 5, 3))).pixel_count
        20
        """
        normals = _image_of_vectors("normal", normal, None)
        height, width, _ = normals.shape
        shape = (height, width)
        positions = None if position is None else _image_of_vectors("position", position, shape)
        if positions is not None:
            positions = positions.astype(normals.dtype)
        elif eye is not None:
            raise BadInput("an eye needs positions: give them, or a constant view direction")
        index = _foreground(normals, positions, mask, shape)

        def planes(image: Array) -> Vec3:
            flat = image.reshape(-1, 3)
            return Vec3.from_array(flat if index is None else flat[index])

        return GBuffer(
            shape=shape,
            normal=unit(planes(normals)),
            viewer=DistantViewer(vector("view")(view)) if eye is None else Eye(vector("eye")(eye)),
            position=None if positions is None else planes(positions),
            index=index,
        )


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
    samples, viewer = (_in_bucket if alone else _samples)(geometry, camera, seen, shading)
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
    """`_samples`, by a program that serves all images with about as many foreground pixels."""
    count = seen.index.shape[0]
    more = dataclasses.replace(pad(seen, bucket(count)), shape=(1, 1))
    samples, viewer = _sized(geometry.prepared(), camera.unframed(), camera.frame, more, shading)
    if samples.spread is None:
        return cut(samples, count), viewer
    spread = cut(samples.spread, count)  # the samples are faces or vertices
    return dataclasses.replace(samples, spread=spread), viewer


def _samples(
    geometry: AbstractSurface,
    camera: AbstractCamera,
    seen: Visibility,
    shading: AbstractFrequency,
) -> tuple[Samples, AbstractViewer]:
    """What is shaded, and the viewer."""
    return _sized(geometry, camera, camera.frame, seen, shading)


@jax.jit
def _sized(
    geometry: AbstractSurface,
    camera: AbstractCamera,
    frame: Frame,
    seen: Visibility,
    shading: AbstractFrequency,
) -> tuple[Samples, AbstractViewer]:
    rays = camera.through(*frame.points(seen.index, camera.up.dtype))
    return shading.samples(geometry, rays, seen), camera.viewer


def _image_of_vectors(name: str, value: ArrayLike, shape: tuple[int, int] | None) -> Array:
    # Pixels outside the mask may hold anything, NaN included: they are looked at only inside it.
    if isinstance(value, jax.Array):
        array = value
    else:
        with jax.ensure_compile_time_eval():  # inside jit too it decides the foreground
            array = jnp.asarray(np.asarray(value), float)
    if not jnp.issubdtype(array.dtype, jnp.floating):
        array = array.astype(float)
    if array.ndim != 3 or array.shape[2] != 3:
        raise BadInput(f"{name} has shape {array.shape}: give an array of shape [H, W, 3]")
    if shape is not None and array.shape[:2] != shape:
        raise BadInput(
            f"{name} is {array.shape[:2]} pixels where normal is {shape}: sizes must match"
        )
    return array


def _foreground(
    normal: Array, position: Array | None, mask: ArrayLike | None, shape: tuple[int, int]
) -> Int[Array, "P"] | None:
    if mask is None:
        if not is_concrete(normal):
            return None
        inside = np.isfinite(normal).all(-1) & (np.asarray(normal) != 0).any(-1)
    else:
        if not is_concrete(mask):
            raise BadInput(
                "mask is traced by jit, grad or vmap: it decides shapes, so give a plain array"
            )
        inside = np.asarray(mask) != 0
        if inside.shape != shape:
            raise BadInput(
                f"mask has shape {inside.shape} where normal is {shape} pixels: sizes must match"
            )
    if not inside.any():
        raise BadInput(
            "the mask is empty: no pixel is foreground, so there is nothing to shade or fit"
        )
    for name, image in (("normal", normal), ("position", position)):
        if image is not None and is_concrete(image):
            _refuse(~np.isfinite(image).all(-1) & inside, f"{name} is not finite")
    if is_concrete(normal):
        _refuse((np.asarray(normal) == 0).all(-1) & inside, "normal is zero")
    return None if inside.all() else jnp.asarray(np.flatnonzero(inside).astype(np.int32))


def _refuse(bad: Bool[np.ndarray, "H W"], what: str) -> None:
    if bad.any():
        row, column = np.argwhere(bad)[0]
        raise BadInput(
            f"{what} at {bad.sum()} masked pixels, the first in row {row}, column {column}: leave"
            " them out of the mask"
        )
