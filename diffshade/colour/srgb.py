"""The transfer curve of sRGB (IEC 61966-2-1), there and back.

With V the display-referred and L the linear value:

    V = 12.92 L                       L <= 0.0031308
    V = 1.055 L^(1/2.4) - 0.055       otherwise
    L = V / 12.92                     V <= 0.04045
    L = ((V + 0.055) / 1.055)^2.4     otherwise

The rounded constants of the standard leave a step of 3e-8 at the switch; both functions are monotonic.
Nothing is clipped: below 0 the linear branch goes on, above 1 the power branch does. For arrays of NumPy
and of JAX, whose precision is kept; derivatives are those of the branches.
"""

from typing import Any

from jaxtyping import Float

__all__ = ["from_srgb", "to_srgb"]

Values = Float[Any, "..."]


def to_srgb(linear: Values) -> Values:
    """V of L. Not smooth at 0.0031308.

    >>> import numpy as np
    >>> to_srgb(np.array([0.0, 0.18, 1.0])).round(4).tolist()
    [0.0, 0.4614, 1.0]
    """
    xp = linear.__array_namespace__()
    # The power is taken of a value that is not negative: both branches are evaluated.
    power = 1.055 * xp.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return xp.where(linear <= 0.0031308, 12.92 * linear, power)


def from_srgb(encoded: Values) -> Values:
    """L of V. Not smooth at 0.04045.

    >>> import numpy as np
    >>> from_srgb(np.array([0.0, 0.5, 1.0])).round(4).tolist()
    [0.0, 0.214, 1.0]
    """
    xp = encoded.__array_namespace__()
    power = ((xp.maximum(encoded, 0.04045) + 0.055) / 1.055) ** 2.4
    return xp.where(encoded <= 0.04045, encoded / 12.92, power)
