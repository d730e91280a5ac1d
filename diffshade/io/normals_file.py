"""Measured normals from a file: MATLAB `.mat` with the key Normal_gt, `.npz`, or `.npy`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from diffshade.errors import BadInput
from diffshade.io.gbuffer import read_arrays
from diffshade.io.matlab import read_matlab
from diffshade.io.npz import read_npy

if TYPE_CHECKING:
    from diffshade.geometry.gbuffer import GBuffer
    from diffshade.geometry.viewer import AbstractViewer

__all__ = ["NormalMap", "normals_gbuffer", "read_normals"]

Mask = Bool[np.ndarray, "H W"]
Vector = Float[np.ndarray, "3"]

_MATLAB_KEY = "Normal_gt"


@dataclass(frozen=True, eq=False)
class NormalMap:
    """Normals over an image, x right, y up, z to the camera, with what else their file holds."""

    path: Path
    normal: Float[np.ndarray, "H W 3"]
    position: Float[np.ndarray, "H W 3"] | None = None
    mask: Mask | None = None
    eye: Vector | None = None
    view: Vector | None = None

    @property
    def known(self) -> Mask:
        """Pixels that have a normal: finite, not zero, and inside the file's own mask."""
        known = np.isfinite(self.normal).all(axis=-1) & (self.normal != 0).any(axis=-1)
        return known if self.mask is None else known & self.mask


def read_normals(path: Path) -> NormalMap:
    """Read a map of normals; the ending of the name says how. Raises `BadInput`."""
    match path.suffix.lower():
        case ".mat":
            normals = NormalMap(path, read_matlab(path, _MATLAB_KEY))
        case ".npy":
            normals = NormalMap(path, read_npy(path))
        case ".npz":
            arrays = read_arrays(path)
            if "slot" in arrays:
                raise BadInput(f"{path}: holds slots, which a map of normals has not; remove them")
            mask = arrays.pop("mask", None)
            normals = NormalMap(path, **arrays, mask=None if mask is None else mask != 0)
        case suffix:
            raise BadInput(
                f"{path}: normals in {suffix or 'a file without an ending'} cannot be"
                " read; give .mat, .npz or .npy"
            )
    shape = normals.normal.shape
    if len(shape) != 3 or shape[2] != 3 or normals.normal.dtype.kind not in "iuf":
        raise BadInput(f"{path}: the normals have shape {shape}; give numbers of shape [H, W, 3]")
    if normals.mask is not None and normals.mask.shape != shape[:2]:
        raise BadInput(f"{path}: mask has shape {normals.mask.shape} where normal is {shape[:2]}")
    return normals


def normals_gbuffer(
    normals: NormalMap, mask: Mask | None = None, viewer: AbstractViewer | None = None
) -> GBuffer:
    """The G-buffer of a map of normals inside a mask, where they are known.

    The viewer is the one given, or the file's own, or far away in the direction (0, 0, 1). Raises
    `BadInput` where a given viewer is not the file's own, and where no pixel is left.
    """
    from dataclasses import replace

    from diffshade.geometry.gbuffer import GBuffer
    from diffshade.geometry.viewer import Eye

    inside = normals.known if mask is None else normals.known & mask
    if not inside.any():
        raise BadInput(f"{normals.path}: no pixel inside the mask has a normal; check both")
    own = {"eye": normals.eye} if normals.eye is not None else {}
    own |= {"view": normals.view} if normals.view is not None else {}
    try:
        gbuffer = GBuffer.from_arrays(normals.position, normals.normal, inside, **own)
    except BadInput as error:
        raise BadInput(f"{normals.path}: {error}") from None
    if isinstance(viewer or gbuffer.viewer, Eye) and normals.position is None:
        raise BadInput(
            f"{normals.path}: holds normals only, and a viewer at a point needs positions; give an"
            " .npz with position, or an orthographic camera"
        )
    if viewer is None:
        return gbuffer
    if own and not _same(viewer, gbuffer.viewer):
        raise BadInput(
            f"{normals.path}: its {next(iter(own))} is not that of the camera; leave out one"
        )
    return replace(gbuffer, viewer=viewer)


def _same(a: AbstractViewer, b: AbstractViewer) -> bool:
    import jax

    return type(a) is type(b) and all(
        np.allclose(x, y, atol=1e-5)
        for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    )
