"""Which pixels a sensor clipped, from the values as the file encodes them.

A pixel is clipped if any channel reaches 0.98 of full scale. Full scale is that of the encoding,
not the file's own maximum, or `white` where the sensor clips lower. A sensor that does so unknown
to the user leaves a plateau: many pixels that share exactly the image's maximum. That is reported,
not acted upon, since a surface may be that flat.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

__all__ = ["CLIPPED_AT", "Plateau", "clipped", "plateau"]

Pixels = Float[np.ndarray, "H W C"]
Mask = Bool[np.ndarray, "H W"]

CLIPPED_AT = 0.98
"""The part of full scale from which a value counts as clipped."""

_FEWEST = 20
"""Pixels that make a plateau."""
_LEVELS = 10
"""Levels below the maximum that a plateau is compared with."""
_EXCESS = 5
"""How many times the most common of these levels a plateau exceeds. A smooth peak has about equally
many pixels on each of its uppermost levels."""


class Plateau(NamedTuple):
    """A level, in encoded values, at which many pixels of one channel stop."""

    level: float
    pixels: int


def clipped(encoded: Pixels, white: float | None) -> Mask:
    """Pixels with any channel at or above 0.98 `white`; none where full scale is unknown (None)."""
    if white is None:
        return np.zeros(encoded.shape[:2], bool)
    saturated: Mask = np.any(encoded >= CLIPPED_AT * white, axis=-1)
    return saturated


def plateau(encoded: Pixels, inside: Mask, white: float | None) -> Plateau | None:
    """The lowest level below 0.98 `white` at which a channel stops, or None."""
    found = [_channel_plateau(channel[inside]) for channel in np.moveaxis(encoded, -1, 0)]
    below = [p for p in found if p and (white is None or p.level < CLIPPED_AT * white)]
    return min(below, default=None)


def _channel_plateau(values: Float[np.ndarray, "P"]) -> Plateau | None:
    values = values[np.isfinite(values)]
    top = values.max(initial=0)
    pixels = int(np.count_nonzero(values == top))
    if top <= 0 or pixels < _FEWEST:
        return None
    lower, counts = np.unique(values[values < top], return_counts=True)
    if not lower.size or pixels < _EXCESS * counts[-_LEVELS:].max():
        return None
    return Plateau(float(top), pixels)
