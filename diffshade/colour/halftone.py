"""Many intensities on devices of few: halftone by clustered dots, and ordered dither.

An image of intensities in [0, 1] is given one of n^2 (2^m - 1) + 1 levels by a matrix D of order n, which
holds 0 to n^2 - 1 once each, on a device of m bits a pixel. On host arrays, in NumPy: what a threshold
makes has no derivative.
"""

from itertools import product

import numpy as np
from jaxtyping import Int
from numpy.typing import ArrayLike

from diffshade.errors import BadInput

__all__ = ["clustered_dot", "dispersed_dot", "dither", "halftone", "level_count"]

Matrix = Int[np.ndarray, "n n"]

_THREE = np.array([[6, 8, 4], [1, 0, 3], [5, 2, 7]])


def clustered_dot(order: int) -> Matrix:
    """A matrix whose dot grows from the middle of the cell, for devices that print no single pixel.

    Order 3 is that of Foley and van Dam; the pixels of others come in order of their distance from
    the middle, those of one distance in turn around it.

    >>> clustered_dot(3).tolist()
    [[6, 8, 4], [1, 0, 3], [5, 2, 7]]
    """
    _check_order(order)
    if order == 3:
        return _THREE.copy()
    middle = (order - 1) / 2

    def turn(place: tuple[int, ...]) -> tuple[float, float]:
        y, x = (k - middle for k in place)
        return x * x + y * y, float(np.arctan2(y, x))

    matrix = np.empty((order, order), int)
    for rank, place in enumerate(sorted(product(range(order), repeat=2), key=turn)):
        matrix[place] = rank
    return matrix


def dispersed_dot(order: int) -> Matrix:
    """Bayer's matrix (1973), for screens: D_2n = [[4 D_n, 4 D_n + 2], [4 D_n + 3, 4 D_n + 1]].

    D_2 = [[0, 2], [3, 1]], and `order` is a power of 2; other orders raise `BadInput`.

    >>> dispersed_dot(4).tolist()
    [[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]]
    """
    _check_order(order)
    if order & (order - 1):
        raise BadInput(f"the order of a dispersed dot is {order}: give a power of 2")
    matrix = np.zeros((1, 1), int)
    while len(matrix) < order:
        four = 4 * matrix
        matrix = np.block([[four, four + 2], [four + 3, four + 1]])
    return matrix


def level_count(order: int, bits: int | tuple[int, ...] = 1) -> int:
    """n^2 (2^m - 1) + 1 levels; of a device of several colours (m_R, m_G, m_B) the product of theirs.

    >>> level_count(2, 1), level_count(3, 2), level_count(2, (1, 1, 1))
    (5, 28, 125)
    """
    _check_order(order)
    each = bits if isinstance(bits, tuple) else (bits,)
    if not each or min(each) < 1:
        raise BadInput(f"bits are {bits}: give 1 or more for each colour")
    return int(np.prod([order**2 * (2**m - 1) + 1 for m in each], dtype=object))


def halftone(image: ArrayLike, matrix: Matrix, bits: int = 1) -> Int[np.ndarray, "..."]:
    """Every pixel as a cell of n x n device pixels, of values 0 to 2^bits - 1.

    The mean of a cell is the nearest of the levels. Raises `BadInput` for intensities outside [0, 1],
    and for what is no matrix of thresholds.

    >>> halftone(np.array([[0.5]]), dispersed_dot(2)).tolist()
    [[1, 0], [0, 1]]
    """
    order = len(_thresholds(matrix))
    levels = np.kron(_levels(image, order, bits), np.ones((order, order), int))
    return _printed(levels, matrix)


def dither(image: ArrayLike, matrix: Matrix, bits: int = 1) -> Int[np.ndarray, "H W"]:
    """Every pixel as one device pixel, lit where S(x, y) > D[x mod n, y mod n], S its level.

    The mean over an even region is the nearest of the levels. x is the column, y the row, counted from
    the top left. Raises `BadInput` as `halftone` does.

    >>> dither(np.full((2, 2), 0.5), dispersed_dot(2)).tolist()
    [[1, 0], [0, 1]]
    """
    return _printed(_levels(image, len(_thresholds(matrix)), bits), matrix)


def _printed(levels: Int[np.ndarray, "H W"], matrix: Matrix) -> Int[np.ndarray, "H W"]:
    order = len(matrix)
    y, x = np.indices(levels.shape)
    whole, rest = np.divmod(levels, order**2)
    return whole + (rest > matrix[x % order, y % order])


def _levels(image: ArrayLike, order: int, bits: int) -> Int[np.ndarray, "H W"]:
    values = np.asarray(image, np.float64)
    if values.ndim != 2:
        raise BadInput(f"the image has shape {values.shape}: give intensities [H, W]")
    if not np.all((values >= 0) & (values <= 1)):
        raise BadInput("the image has intensities outside [0, 1]: scale or clip them")
    return np.rint(values * (level_count(order, bits) - 1)).astype(int)


def _thresholds(matrix: Matrix) -> Matrix:
    found = np.asarray(matrix)
    square = found.ndim == 2 and found.shape[0] == found.shape[1]
    if not square or sorted(found.ravel().tolist()) != list(range(found.size)):
        raise BadInput("the matrix of thresholds is not square with 0 to n^2 - 1, once each")
    return found


def _check_order(order: int) -> None:
    if order < 1:
        raise BadInput(f"the order of a matrix is {order}: give 1 or more")
