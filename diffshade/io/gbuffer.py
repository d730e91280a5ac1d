"""G-buffers in `.npz` files, as plain arrays over the image.

| array | shape | |
|---|---|---|
| `normal` | [H, W, 3] | world axes; of any length |
| `position` | [H, W, 3] | optional: parallel lights and a constant view need none |
| `mask` | [H, W] | optional; else the foreground is where the normal is finite and not zero |
| `eye` or `view` | [3] | where the viewer is, or the direction to one far away; else (0, 0, 1) |
| `slot` | [H, W] | optional: the number of each pixel's material |

Any `np.savez(path, normal=..., position=...)` is one.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from diffshade.errors import BadInput
from diffshade.io.atomic import replacing
from diffshade.io.npz import read_npz

if TYPE_CHECKING:
    from diffshade.geometry.gbuffer import GBuffer

__all__ = ["ARRAYS", "load_gbuffer", "read_arrays", "save_gbuffer"]

ARRAYS = ("normal", "position", "mask", "eye", "view", "slot")


def save_gbuffer(path: str | os.PathLike[str], gbuffer: GBuffer) -> None:
    """Write a G-buffer to an `.npz` file; background is 0, and slot -1 there. Atomic.

    Raises `BadInput` for one that is shaded a face or a vertex at a time, which has no pixels.

    >>> save_gbuffer("ball.npz", ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(64, 64, 2.4)))
    """
    from diffshade.geometry.viewer import DistantViewer, Eye

    if gbuffer.spread is not None:
        raise BadInput(
            f"{path}: flat and Gouraud shading have no values a pixel to save; make the G-buffer"
            " with PhongShading()"
        )
    arrays = {"normal": _vectors(gbuffer, gbuffer.normal), "mask": np.asarray(gbuffer.mask)}
    if gbuffer.position is not None:
        arrays["position"] = _vectors(gbuffer, gbuffer.position)
    match gbuffer.viewer:
        case Eye(position=eye):
            arrays["eye"] = np.asarray(eye)
        case DistantViewer(view=view):
            arrays["view"] = np.asarray(view)
        case other:
            raise BadInput(
                f"{path}: a {type(other).__name__} cannot be saved; use an eye or a view"
            )
    if gbuffer.slot is not None:
        arrays["slot"] = np.full(gbuffer.shape, -1, np.int32)
        arrays["slot"][arrays["mask"]] = gbuffer.slot
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def load_gbuffer(path: str | os.PathLike[str]) -> GBuffer:
    """Read a G-buffer from an `.npz` file of plain arrays, in the precision JAX is set to.

    Raises `BadInput`, in one line, for what is no such file, arrays of unknown names or of sizes
    that do not match, an empty mask, and masked pixels without a finite normal.

    >>> image = ds.render(load_gbuffer("ball.npz"), scene, material)
    """
    from diffshade.geometry.gbuffer import GBuffer

    arrays = read_arrays(Path(path))
    slot = arrays.pop("slot", None)
    try:
        gbuffer = GBuffer.from_arrays(arrays.pop("position", None), **arrays)
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from None
    if slot is None:
        return gbuffer
    inside = np.asarray(gbuffer.mask)
    if slot.shape != inside.shape or slot.dtype.kind not in "iu" or slot[inside].min() < 0:
        raise BadInput(
            f"{path}: slot holds {slot.dtype} numbers of shape {slot.shape}; give a whole number of"
            f" 0 or more for each masked pixel, shape {inside.shape}"
        )
    import jax.numpy as jnp

    return replace(gbuffer, slot=jnp.asarray(slot[inside], dtype=jnp.int32))


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an `.npz` G-buffer by name; `normal` is there, and not both eye and view."""
    arrays = read_npz(path, ARRAYS)
    if "normal" not in arrays:
        raise BadInput(
            f"{path}: the array 'normal' is missing; the arrays of a G-buffer are {', '.join(ARRAYS)}"
        )
    if "eye" in arrays and "view" in arrays:
        raise BadInput(f"{path}: holds an eye and a view; give one viewer")
    return arrays


def _vectors(gbuffer: GBuffer, planes: object) -> np.ndarray:
    return np.asarray(gbuffer.to_image((planes.x, planes.y, planes.z)))  # type: ignore[attr-defined]
