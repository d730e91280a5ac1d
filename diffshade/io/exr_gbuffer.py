"""G-buffers in multi-layer EXR files, by the names that Blender and Mitsuba give their layers.

| | Blender's passes | Mitsuba's `aov`, by the user's names |
|---|---|---|
| position | `ViewLayer.Position.X .Y .Z` | `position`: `name.X .Y .Z` |
| normal | `ViewLayer.Normal.X .Y .Z` | `sh_normal`, `geo_normal`: `name.X .Y .Z` |
| index | `ViewLayer.IndexOB.X`, in newer versions `ViewLayer.Object Index.X` | `shape_index`: `name.I` |

All are in world axes. Background has the normal 0. Where the filter of an image is wider than a pixel,
or a pixel has samples of several objects, an index is a mean of several, and no index: such pixels are
left out, and a box filter with one sample a pixel has none.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from diffshade.errors import BadInput, naming
from diffshade.io.atomic import replacing
from diffshade.io.contents import read_bytes, refusing
from diffshade.io.exr import SIGNATURE, by_layer, listed, read_channels, write_channels

if TYPE_CHECKING:
    from diffshade.geometry.gbuffer import GBuffer

__all__ = ["ExrGBuffer", "load_exr_gbuffer", "save_exr_gbuffer"]

POSITION = ("position", "pos", "pp")
NORMAL = ("normal", "normals", "sh_normal", "shading_normal", "nn", "geo_normal")
INDEX = ("indexob", "object index", "shape_index", "index", "id", "idx")
"""The last part of a layer's name, in any case of letters; the first that is there counts."""
LARGEST = 2**24
"""Indices up to it are whole in float32."""


class ExrGBuffer(NamedTuple):
    """What a file holds."""

    gbuffer: GBuffer
    """Its `slot`, where there are indices, numbers those that occur, from the least up."""
    indices: tuple[int, ...]
    """The index of each slot in the file."""
    notes: tuple[str, ...]
    """What was left out."""


def load_exr_gbuffer(
    path: str | os.PathLike[str],
    *,
    eye: Any = None,
    view: Any = (0.0, 0.0, 1.0),
    position: str | None = None,
    normal: str | None = None,
    index: str | None = None,
) -> ExrGBuffer:
    """Read positions, normals and indices; the viewer, whom no file knows, is at `eye`, or far off in the
    direction `view`. `position`, `normal` and `index` name layers whose names are not the usual ones.

    Raises `BadInput`, with the layers that there are, where there is none with normals.

    >>> found = load_exr_gbuffer("frame.exr", eye=(0, -5, 2))
    >>> image = ds.render(found.gbuffer, scene, (red, green))
    """
    from diffshade.geometry.gbuffer import GBuffer

    path = Path(path)
    if not read_bytes(path).startswith(SIGNATURE):
        raise BadInput(f"{path}: is not an EXR file; render one with layers of normals")
    with refusing(path, "damaged OpenEXR", "copy or export it again"):
        layers = by_layer(read_channels(path))
    normals = _vectors(path, layers, "normal", normal, NORMAL)
    if normals is None:
        raise BadInput(f"{path}: has no layer of normals; name it, of: {listed(layers)}")
    positions = _vectors(path, layers, "position", position, POSITION)
    inside = np.isfinite(normals).all(axis=-1) & (normals != 0).any(axis=-1)
    if positions is not None:
        inside &= np.isfinite(positions).all(axis=-1)
    notes: tuple[str, ...] = ()
    slots: np.ndarray | None = None
    indices: tuple[int, ...] = ()
    numbers = _numbers(path, layers, index)
    if numbers is not None:
        whole = (numbers == np.floor(numbers)) & (numbers >= 0) & (numbers <= LARGEST)
        if mixed := int(np.count_nonzero(inside & ~whole)):
            notes = (
                f"{mixed} pixels whose index is a mean of several: left out; render with a box filter",
            )
        inside &= whole
        found, slots = np.unique(numbers[inside].astype(np.int64), return_inverse=True)
        indices = tuple(found.tolist())
        if indices != tuple(range(len(indices))):
            some = ", ".join(map(str, indices[:8])) + ", ..." * (len(indices) > 8)
            notes += (
                f"the indices {some} are slots 0 to {len(indices) - 1} here: give materials in this"
                " order",
            )
    with naming(path):
        gbuffer = GBuffer.from_arrays(positions, normals, inside, eye=eye, view=view)
    if slots is not None:
        import jax.numpy as jnp

        gbuffer = replace(gbuffer, slot=jnp.asarray(slots.reshape(-1), dtype=jnp.int32))
    return ExrGBuffer(gbuffer, indices, notes)


def save_exr_gbuffer(
    path: str | os.PathLike[str], gbuffer: GBuffer, *, view_layer: str = "ViewLayer"
) -> None:
    """Write positions, normals and slots as Blender names its passes, float32; background is 0. Atomic.

    Raises `BadInput` for one that is shaded a face or a vertex at a time, which has no pixels.

    >>> save_exr_gbuffer("ball.exr", ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(64, 64, 2.4)))
    """
    if gbuffer.spread is not None:
        raise BadInput(
            f"{path}: flat and Gouraud shading have no values a pixel to save; make the G-buffer"
            " with PhongShading()"
        )
    channels: dict[str, np.ndarray] = {}
    for name, planes in (("Normal", gbuffer.normal), ("Position", gbuffer.position)):
        if planes is not None:
            image = np.asarray(gbuffer.to_image((planes.x, planes.y, planes.z)), np.float32)
            channels |= {
                f"{view_layer}.{name}.{axis}": image[..., k] for k, axis in enumerate("XYZ")
            }
    if gbuffer.slot is not None:
        slots = np.zeros(gbuffer.shape, np.float32)
        slots[np.asarray(gbuffer.mask)] = np.asarray(gbuffer.slot)
        channels[f"{view_layer}.IndexOB.X"] = slots
    with replacing(path) as temporary:
        write_channels(temporary, channels)


Layers = dict[str, dict[str, np.ndarray]]


def _layer(
    path: Path, layers: Layers, what: str, name: str | None, usual: tuple[str, ...], has: set[str]
) -> dict[str, np.ndarray] | None:
    """The layer of this name, or the first of a usual one, that has these channels."""
    if name is not None:
        if has <= set(layers.get(name, {})):
            return layers[name]
        raise BadInput(
            f"{path}: has no layer {name!r} with {' '.join(sorted(has))} for the {what}; its layers are"
            f" {', '.join(map(repr, layers))}"
        )
    for own in usual:
        for full, channels in layers.items():
            if full.rpartition(".")[2].lower() == own and has <= set(channels):
                return channels
    return None


def _vectors(
    path: Path, layers: Layers, what: str, name: str | None, usual: tuple[str, ...]
) -> np.ndarray | None:
    channels = _layer(path, layers, what, name, usual, {"X", "Y", "Z"})
    if channels is None:
        return None
    return np.stack([channels[axis].astype(np.float32) for axis in "XYZ"], axis=-1)


def _numbers(path: Path, layers: Layers, name: str | None) -> np.ndarray | None:
    for axis in ("I", "X"):
        if name is None or {axis} <= set(layers.get(name, {})):
            channels = _layer(path, layers, "index", name, INDEX, {axis})
            if channels is not None:
                return channels[axis].astype(np.float64)
    if name is not None:
        _layer(path, layers, "index", name, INDEX, {"X"})  # raises
    return None
