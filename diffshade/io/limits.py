"""How much one file may claim to hold, checked by its header before memory is taken for it.

A file of a hundred bytes may claim 100,000 x 100,000 pixels, and one of a megabyte unpack to a
terabyte. At most `DIFFSHADE_MAX_VALUES` numbers are read from one file: 2^29 (536,870,912: an RGB image
of 13,000 x 13,000 pixels) unless the environment variable of this name says otherwise.
"""

import math
import os
from collections.abc import Iterable

from diffshade.errors import BadInput

__all__ = ["FARTHEST", "VARIABLE", "check_size", "largest"]

VARIABLE = "DIFFSHADE_MAX_VALUES"
_LARGEST = 2**29

FARTHEST = 1e18
"""No coordinate of a mesh reaches so far: squares of those below are finite in float32."""


def largest() -> int:
    """The most values that are read from one file."""
    given = os.environ.get(VARIABLE, "")
    if not given:
        return _LARGEST
    if not (given.isascii() and given.isdecimal() and len(given) < 19):
        raise BadInput(f"{VARIABLE} is {given!r}: give a whole number of values")
    return int(given)


def check_size(claimed: Iterable[int]) -> None:
    """Refuse a file that claims arrays of this shape; the message does not name the file.

    >>> check_size((1080, 1920, 3))
    >>> check_size((100_000, 100_000, 3))
    Traceback (most recent call last):
    diffshade.errors.BadInput: claims 100000 x 100000 x 3 values, more than the 536870912 ...
    """
    shape = tuple(claimed)
    if math.prod(shape) > (limit := largest()):
        raise BadInput(
            f"claims {' x '.join(map(_count, shape))} values, more than the {limit} that are read"
            f" from one file; if it is right, set {VARIABLE} to more"
        )


def _count(number: int) -> str:
    return str(number) if number < 10**18 else "10^18 or more"
