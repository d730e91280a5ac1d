"""A fair sample of the pixels of photographs, where fewer tell as much."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer

__all__ = ["Sample", "sampled"]


class Sample(NamedTuple):
    """Photographs of one row, a pixel each of those that are looked at."""

    images: tuple[Float[np.ndarray, "1 P C"], ...]
    gbuffer: GBuffer
    valid: tuple[Bool[np.ndarray, "1 P"], ...]


def sampled(
    images: Sequence[Float[np.ndarray, "H W C"]],
    gbuffer: GBuffer,
    valid: Sequence[Bool[np.ndarray, "H W"]] | None,
    most: int,
) -> Sample:
    """Every n-th pixel of the foreground, so that pixels times images are about `most` at most.

    Raises `BadInput` for a G-buffer that is shaded by faces or vertices.

    >>> from diffshade.io.circle import Circle, ball_gbuffer
    >>> ball = ball_gbuffer(Circle(8, 8, 7), (16, 16))
    >>> sampled([np.ones((16, 16, 3))], ball, None, 50).images[0].shape
    (1, 52, 3)
    """
    if gbuffer.spread is not None:
        raise BadInput("the G-buffer is shaded by faces or vertices: give one of its pixels")
    every = max(gbuffer.pixel_count * len(images) // most, 1)
    normal, position = jax.tree.map(
        lambda plane: plane[::every], (gbuffer.normal, gbuffer.position)
    )
    at = np.flatnonzero(gbuffer.mask)[::every]
    rows = tuple(np.asarray(image).reshape(-1, image.shape[2])[None, at] for image in images)
    used = [np.ones(gbuffer.shape, bool)] * len(images) if valid is None else valid
    return Sample(
        rows,
        GBuffer((1, len(at)), normal, gbuffer.viewer, position),
        tuple(np.asarray(v).reshape(-1)[None, at] for v in used),
    )
