"""The geometry of a folder of photographs: the first that is there of

1. `Normal_gt.mat`, measured normals;
2. a given circle, the outline of a ball: the caller's, or `sphere.json`;
3. a circle found from `mask.png`.

`mask.png` confines each of them. The view is along -z from afar.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool

from diffshade.errors import BadInput
from diffshade.io.circle import Circle, ball_gbuffer, read_circle
from diffshade.io.circle_from_mask import circle_from_mask
from diffshade.io.contents import within
from diffshade.io.foreground import lost_pixels
from diffshade.io.image import read_mask
from diffshade.io.normals_file import normals_gbuffer, read_normals
from diffshade.io.photographs import size

if TYPE_CHECKING:
    from diffshade.geometry.gbuffer import GBuffer

__all__ = ["Geometry", "folder_geometry", "read_mask_of"]

Mask = Bool[np.ndarray, "H W"]


class Geometry(NamedTuple):
    """A G-buffer, notes on where it comes from, and the outline of the ball where it is one."""

    gbuffer: GBuffer
    notes: tuple[str, ...]
    circle: Circle | None


def folder_geometry(
    folder: Path,
    image: Path,
    shape: tuple[int, int],
    circle: tuple[float, float, float] | None,
    *,
    allow_outside: bool = False,
) -> Geometry:
    """The geometry for photographs like `image`, of `shape`."""
    outline: Circle | None = None
    mask_file, normals_file, sphere_file = (
        within(folder, name, allow_outside=allow_outside)
        for name in ("mask.png", "Normal_gt.mat", "sphere.json")
    )
    mask = read_mask_of(mask_file, image, shape) if mask_file.exists() else None
    if normals_file.exists():
        normals = read_normals(normals_file)
        if normals.normal.shape[:2] != shape:
            raise BadInput(
                f"{normals_file}: {size(normals.normal[..., 0])} where {image} is"
                f" {size(np.empty(shape))}; both must have one size"
            )
        gbuffer = normals_gbuffer(normals, mask)
        notes = [f"geometry from {normals_file.name}"]
        if circle is not None:
            notes.append(f"the given circle was not used: {normals_file.name} goes before it")
    elif circle is not None:
        outline = given = Circle(*circle).checked("--circle")
        gbuffer, notes = _ball(given, shape, mask, "--circle"), [f"geometry from {_words(given)}"]
    elif sphere_file.exists():
        outline = given = read_circle(sphere_file)
        gbuffer = _ball(given, shape, mask, str(sphere_file))
        notes = [f"geometry from sphere.json: {_words(given)}"]
    elif mask is not None:
        try:
            outline = found = circle_from_mask(mask)
        except BadInput as error:
            raise BadInput(f"{mask_file}: {error}") from None
        gbuffer = _ball(found, shape, mask, str(mask_file))
        notes = [
            f"geometry from mask.png: {_words(found)}; a circle found from a mask alone tends to be"
            " too large, by some tenths of a pixel: give sphere.json or --circle if you know better"
        ]
    else:
        raise BadInput(
            f"{folder}: no geometry; add Normal_gt.mat, sphere.json or mask.png, or give --circle"
        )
    return Geometry(gbuffer, (*notes, *lost_pixels(mask, gbuffer)), outline)


def read_mask_of(path: Path, image: Path, shape: tuple[int, int]) -> Mask:
    """Read the mask of photographs like `image`; its size must be theirs."""
    mask = read_mask(path)
    if mask.shape != shape:
        raise BadInput(
            f"{path}: {size(mask)} where {image} is {size(np.empty(shape))}; a mask must have the"
            " size of the images"
        )
    return mask


def _ball(circle: Circle, shape: tuple[int, int], mask: Mask | None, where: str) -> GBuffer:
    try:
        return ball_gbuffer(circle, shape, mask)
    except BadInput:
        raise BadInput(
            f"{where}: {_words(circle)} has no pixel inside the mask and the image; correct it"
        ) from None


def _words(circle: Circle) -> str:
    return f"a circle of radius {circle.radius:.2f} about ({circle.cx:.2f}, {circle.cy:.2f}) pixels"
