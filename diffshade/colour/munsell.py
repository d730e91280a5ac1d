"""Munsell's colours: hue, value and chroma of published samples, by the renotation of 1943.

colour-science has the tables and the way between them (the extra `colour`). Chromaticities are those
under illuminant C, of which `WHITE` is the white. On the host, one colour at a time.
"""

import warnings
from typing import Any

import numpy as np
from jaxtyping import Float

from diffshade.colour.observer import tables
from diffshade.errors import BadInput

__all__ = ["WHITE", "munsell_to_xyy", "xyy_to_munsell"]

WHITE = (0.3101, 0.3162)
"""(x, y) of illuminant C."""


def munsell_to_xyy(notation: str) -> Float[np.ndarray, "3"]:
    """(x, y, Y) of hue value/chroma as in "5YR 6/11", or of a grey as in "N5".

    Raises `BadInput` for other notations, and for colours outside the renotation.

    >>> munsell_to_xyy("5YR 6/11").round(3).tolist()
    [0.506, 0.407, 0.293]
    """
    return np.asarray(_asked(notation, "munsell_colour_to_xyY"), np.float64)


def xyy_to_munsell(xyy: Any) -> str:
    """The notation of three numbers (x, y, Y), Y in [0, 1] and relative to white, to a tenth each.

    Takes a tenth of a second. Raises `BadInput` where the search does not converge, which it does for
    colours outside the renotation.

    >>> xyy_to_munsell([0.506, 0.407, 0.293])
    '5.0YR 6.0/11.0'
    """
    x, y, brightness = np.asarray(xyy, np.float64)
    if not (x > 0 and y > 0 and x + y < 1 and 0 <= brightness <= 1):
        raise BadInput(f"(x, y, Y) is {(x, y, brightness)}: give a chromaticity, and Y in [0, 1]")
    return str(_asked(np.array([x, y, brightness]), "xyY_to_munsell_colour"))


def _asked(given: str | np.ndarray, conversion: str) -> object:
    convert = getattr(tables(), conversion)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return convert(given)
    except RuntimeError:
        raise BadInput(
            f"the search for {given} in Munsell's renotation does not converge"
        ) from None
    except (ArithmeticError, AssertionError, LookupError, ValueError):  # whichever it meets first
        raise BadInput(f"{given} has no place in Munsell's renotation") from None
