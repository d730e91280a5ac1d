"""The G-buffer: what shading needs to know of the surface behind each foreground pixel."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int, Shaped

from diffshade.arrays import ArrayLike, is_concrete, vector
from diffshade.buckets import are_at_hand, bucket, cut, pad, room_for
from diffshade.errors import BadInput
from diffshade.fusion import Led
from diffshade.geometry.frequency import Spread
from diffshade.geometry.remembered import remembered
from diffshade.geometry.viewer import AbstractViewer, DistantViewer, Eye
from diffshade.vector import Vec3, unit

__all__ = ["GBuffer", "check_lengths"]

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
    def point_count(self) -> int:
        """How many points are shaded: the foreground pixels, or else faces or vertices."""
        return self.normal.x.shape[-1]

    @property
    def mask(self) -> Bool[np.ndarray, "H W"]:
        """Which pixels are foreground: a plain array, of a G-buffer that is not traced."""
        if self.index is None:
            return np.ones(self.shape, bool)
        return _inside(self.index, self.shape[0] * self.shape[1]).reshape(self.shape).copy()

    def in_bucket(self) -> "GBuffer":
        """Its points alone, padded: those of many images have one structure, and one program.

        Raises `BadInput` where planes differ in length, which nobody could tell any more.
        """
        check_lengths(self)
        return dataclasses.replace(
            self,
            shape=(1, bucket(self.pixel_count)),
            normal=pad(self.normal),
            position=pad(self.position),
            index=None,
            slot=None if self.slot is None else jax.device_put(pad(self.slot)),
            spread=pad(self.spread),
        )

    def to_image(self, planes: Planes) -> Shaped[Array, "H W C"]:
        """An image [H, W, C] from one plane a channel over the foreground; background is 0."""
        if are_at_hand((self.index, planes)):
            dtype = jnp.result_type(*planes)
            return self.placed(np.stack([np.asarray(x, dtype) for x in planes], axis=-1))
        rows = jnp.stack(planes, axis=-1)
        if self.index is not None:
            count = self.shape[0] * self.shape[1]
            rows = (
                jnp.zeros((count, len(planes)), rows.dtype)
                .at[self.index]
                .set(rows, unique_indices=True)
            )
        return rows.reshape(*self.shape, len(planes))

    def placed(self, rows: Shaped[Array | np.ndarray, "L C"]) -> Shaped[Array, "H W C"]:
        """An image from one row a foreground pixel, and any after them, without a program for it."""
        channels, own = rows.shape[1], np.asarray(rows)[: self.pixel_count]
        if self.index is not None:
            image = room_for((self.shape[0] * self.shape[1], channels), own.dtype)
            image.fill(0)
            _pixels(image)[_places(self.index, len(image))] = _pixels(own)
            own = image
        return jax.device_put(own.reshape(*self.shape, channels))

    def from_image(self, image: Shaped[Array, "H W C"]) -> Shaped[Array, "C P"]:
        """The foreground of an image [H, W, C], one plane a channel.

        Raises `BadInput` for an image of another size.
        """
        if image.shape[:2] != self.shape:
            raise BadInput(
                f"the image has shape {image.shape}: give [{self.shape[0]}, {self.shape[1]}, C]"
            )
        if are_at_hand((self.index, image)):
            rows = np.ascontiguousarray(image).reshape(-1, image.shape[-1])
            if self.index is not None:
                foreground = _pixels(rows)[_places(self.index, len(rows))]
                rows = foreground.view(rows.dtype).reshape(-1, rows.shape[1])
            return jax.device_put(rows.T.copy())
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

        Of other rasterizers, with vertex positions and normals interpolated in world axes:

        - nvdiffrast: row 0 is the bottom, and channel 3 of `rast` is 0 in the background:
          `from_arrays(position[0].flip(0), normal[0].flip(0), rast[0, ..., 3].flip(0) > 0, eye=eye)`.
        - PyTorch3D: rows and columns run as here, and `pix_to_face` is -1 in the background:
          `from_arrays(position, normal, pix_to_face[0, ..., 0] >= 0, eye=eye)`. Its view axes have x left
          and z forward: times (-1, 1, -1) they are ours about a camera at the origin, `eye=(0, 0, 0)`.

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

        alone = are_at_hand((normals, positions))

        def planes(image: Array) -> Vec3:
            if not alone:
                flat = image.reshape(-1, 3)
                return Vec3.from_array(flat if index is None else flat[index])
            rows = np.asarray(image).reshape(-1, 3)
            rows = rows if index is None else rows[np.asarray(index)]
            return Vec3(*jax.device_put([column.copy() for column in rows.T]))

        n = planes(normals)
        return GBuffer(
            shape=shape,
            normal=cut(_unit.outermost(pad(n)), n.x.size) if alone else _unit(n),
            viewer=DistantViewer(vector("view")(view)) if eye is None else Eye(vector("eye")(eye)),
            position=None if positions is None else planes(positions),
            index=index,
        )


def check_lengths(gbuffer: GBuffer) -> None:
    """Raise `BadInput` where planes differ in length."""

    def lengths(*planes: Any) -> set[int]:
        return {x.shape[-1] for x in jax.tree.leaves(planes) if x.ndim}

    shaded = lengths(gbuffer.normal, gbuffer.position, gbuffer.slot)
    pixels = lengths(gbuffer.spread) if gbuffer.spread is not None else shaded
    if len(shaded) > 1 or not pixels <= {gbuffer.pixel_count}:
        raise BadInput(
            f"the G-buffer has planes of {sorted(shaded | pixels)} points for"
            f" {gbuffer.pixel_count} pixels: give planes of one length"
        )


_unit = Led(unit)


@remembered
def _inside(index: Int[Array, "P"], count: int) -> Bool[np.ndarray, "N"]:
    """Which of the pixels of an image are foreground."""
    inside = np.zeros(count, bool)
    inside[np.asarray(index)] = True
    return inside


def _places(index: Int[Array, "P"], count: int) -> np.ndarray:
    """The same for placing: a mask, which is fast, or else the index itself, where it is in no order."""
    return _inside(index, count) if _ascends(index) else np.asarray(index)


@remembered
def _ascends(index: Int[Array, "P"]) -> bool:
    return bool((np.diff(np.asarray(index)) > 0).all())


def _pixels(rows: Shaped[np.ndarray, "P C"]) -> Shaped[np.ndarray, "P"]:
    """A pixel's channels as one number, which NumPy moves by a mask ten times as fast."""
    return rows.view(np.dtype((np.void, rows.itemsize * rows.shape[1])))[:, 0]


def _image_of_vectors(name: str, value: ArrayLike, shape: tuple[int, int] | None) -> Array:
    # Pixels outside the mask may hold anything, NaN included: they are looked at only inside it.
    if isinstance(value, jax.Array):
        array = value
    else:
        with (
            jax.ensure_compile_time_eval(),  # inside jit too it decides the foreground
            # What is infinite then is looked at as such; a signalling NaN is one like any other
            np.errstate(over="ignore", invalid="ignore"),
        ):
            array = jax.device_put(np.asarray(value, jax.dtypes.canonicalize_dtype(float)))
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
    return None if inside.all() else jax.device_put(np.flatnonzero(inside).astype(np.int32))


def _refuse(bad: Bool[np.ndarray, "H W"], what: str) -> None:
    if bad.any():
        row, column = np.argwhere(bad)[0]
        raise BadInput(
            f"{what} at {bad.sum()} masked pixels, the first in row {row}, column {column}: leave"
            " them out of the mask"
        )
