"""How the values of an image file relate to light, and the way there and back."""

from enum import Enum
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from diffshade.colour.srgb import from_srgb, to_srgb
from diffshade.errors import BadInput

__all__ = ["Encoding", "decode", "encode_srgb"]

Values = Float[np.ndarray, "..."]


class Encoding(Enum):
    """What a file says about its own values; `UNKNOWN` where it says nothing."""

    LINEAR = "linear"
    """Proportional to radiance."""
    DISPLAY = "display"
    """Meant for a display: sRGB, or a gamma close to it."""
    UNKNOWN = "unknown"
    """The file does not say: the user has to."""


def encode_srgb(linear: ArrayLike) -> Values:
    """Display-referred sRGB values of linear ones, in their precision (float64 for integers).

    Not clipped: what is outside [0, 1] stays outside. Not smooth at 0.0031308.

    >>> encode_srgb([0.0, 0.18, 1.0]).round(4).tolist()
    [0.0, 0.4614, 1.0]
    """
    return to_srgb(_floating(linear))


def decode(values: ArrayLike, encoding: str | float) -> Values:
    """Linear values of encoded ones, full scale 1.

    `encoding` is `"linear"` (unchanged), `"srgb"`, or a gamma g > 0: L = V^g, so 2.2 rather than
    1/2.2, odd in V. Raises `BadInput` for anything else.

    >>> decode([0.0, 0.5, 1.0], 2.0).tolist()
    [0.0, 0.25, 1.0]
    """
    encoded = _floating(values)
    if encoding == "linear":
        return encoded
    if encoding == "srgb":
        return from_srgb(encoded)
    if _is_gamma(encoding):
        return np.asarray(np.copysign(np.abs(encoded) ** float(encoding), encoded))
    raise BadInput(
        f'encoding is {encoding!r}: give "linear", "srgb" or a gamma above 0, such as 2.2'
    )


def _is_gamma(encoding: Any) -> bool:
    is_number = isinstance(encoding, int | float) and not isinstance(encoding, bool)
    return is_number and bool(np.isfinite(encoding)) and encoding > 0


def _floating(values: ArrayLike) -> Values:
    array = np.asarray(values)
    return array if np.issubdtype(array.dtype, np.floating) else array.astype(np.float64)
