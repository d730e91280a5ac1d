"""G-buffers that are confined to a mask."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool

from diffshade.errors import BadInput

if TYPE_CHECKING:
    from diffshade.geometry.camera import AbstractCamera
    from diffshade.geometry.frequency import AbstractFrequency
    from diffshade.geometry.gbuffer import GBuffer
    from diffshade.geometry.surface import AbstractSurface

__all__ = ["lost_pixels", "masked_gbuffer"]

Mask = Bool[np.ndarray, "H W"]


def masked_gbuffer(
    geometry: AbstractSurface,
    camera: AbstractCamera,
    mask: Mask | None,
    *,
    shading: AbstractFrequency | None = None,
) -> GBuffer:
    """The G-buffer of a surface where a camera sees it inside the mask; `BadInput` if nowhere."""
    import jax

    from diffshade.geometry.view import gbuffer, visibility

    seen = visibility(geometry, camera)
    keep = np.arange(seen.index.shape[0])
    if mask is not None:
        keep = np.flatnonzero(mask.reshape(-1)[np.asarray(seen.index)])
    if not keep.size:
        where = "" if mask is None else " inside the mask"
        raise BadInput(f"the camera sees nothing of the surface{where}; check geometry and camera")
    if mask is not None:
        # On the host: a program would be one for that number of pixels.
        seen = jax.tree.map(lambda values: jax.device_put(np.asarray(values)[keep]), seen)
    return gbuffer(geometry, camera, seen, shading=shading)


def lost_pixels(mask: Mask | None, gbuffer: GBuffer) -> tuple[str, ...]:
    """A note on the pixels of a mask that lie outside a G-buffer, if any do."""
    if mask is None or not (lost := int(np.count_nonzero(mask & ~np.asarray(gbuffer.mask)))):
        return ()
    return (f"{lost} of the mask's {np.count_nonzero(mask)} pixels have no geometry: left out",)
