"""How the values of an image file relate to light, and the way there and back.

IEC 61966-2-1 (sRGB), with V the display-referred and L the linear value:

    V = 12.92 L                       L <= 0.0031308
    V = 1.055 L^(1/2.4) - 0.055       otherwise
    L = V / 12.92                     V <= 0.04045
    L = ((V + 0.055) / 1.055)^2.4     otherwise

The rounded constants of the standard leave a step of 3e-8 at the switch; both functions are
monotonic. Nothing is clipped: below 0 the linear branch goes on, above 1 the power branch does.
"""

from enum import Enum
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

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
    light = _floating(linear)
    # The power is taken of a value that cannot be negative: np.where evaluates both branches.
    power = 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(light <= 0.0031308, 12.92 * light, power)


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
        power = ((np.maximum(encoded, 0.04045) + 0.055) / 1.055) ** 2.4
        return np.where(encoded <= 0.04045, encoded / 12.92, power)
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
