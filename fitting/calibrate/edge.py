"""Where a ball ends, to some hundredths of a pixel, by a model of its blurred edge.

The steepest change lies inside the outline or outside it, as the rim darkens and the picture is blurred.
Here it is part of a model. At the depth t inside the outline of a ball of R pixels n.v is
sqrt(2 t/R) nearly, so that any smooth shading starts as

    b(t) = c0 + c1 sqrt(t) + c2 t    for t > 0,    and the background for t < 0.

A pixel takes the mean of its area, and the picture is blurred; both together are a Gauss of the standard
deviation s. With z = d / s at the depth d, and N normal, what is seen of t^p is

    E[max(d + s N, 0)^p] = s^p Gamma(p + 1) / sqrt(2 pi) exp(-z^2 / 4) D_{-p-1}(-z)

(D the parabolic cylinder function, DLMF 12.5.1), which for p = 0 is how much of the pixel is covered.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares
from scipy.special import gamma, ndtr, pbdv

from diffshade.io.circle import Circle
from fitting.weights import MAD

__all__ = ["circle_of_edge"]

Plane = Float[np.ndarray, "H W"]
Some = Float[np.ndarray, "N"]
Unknowns = Float[np.ndarray, "m"]

WINDOWS = 36
"""Pieces of the outline that are looked at one by one, all round."""
ANGLES = np.arange(WINDOWS) * (2 * np.pi / WINDOWS)
HALF = (4.0, 8.0)
"""Half the length of a piece in pixels: that of 1/36 of the outline, but within these."""
INSIDE, OUTSIDE = 5.0, 3.0
"""Pixels that are looked at, by their distance to the outline."""
FARTHEST = 2.0
"""Pixels by which the outline may be off."""
SHARPEST = 12**-0.5
"""The standard deviation of a pixel's own area across an edge, in pixels."""
WIDEST = 1.5
"""The most that s may be: what is blurred more, the pixels looked at do not show whole."""
UNCERTAIN = 0.3
"""Pixels by which a piece's place may be uncertain at the most, and by which places may scatter."""
UNEXPLAINED = 0.1
"""The most that a piece's residual may be, of its contrast."""
SCATTER = 0.05
"""Of true outlines about a circle, in pixels."""


class _Piece(NamedTuple):
    """What a piece of the outline says: how far outside the circle it is, how sure that is, and s."""

    offset: float
    error: float
    blur: float
    good: bool


def circle_of_edge(plane: Plane, circle: Circle) -> Circle | None:
    """The circle of a ball's outline in an image, from one that is within two pixels of it.

    Each of 36 pieces of the outline has its own brightness, background and place, by least squares;
    the circle lies as most of them do, weighted by how sure they are. A piece is left out where its
    place is uncertain by more than 0.3 pixels (no light reaches it), where the model leaves more than
    a tenth of its contrast (a stand, a shadow), or where pixels are clipped. None where less than half
    the pieces are left, they scatter by more than 0.3 pixels (an ellipse of strong perspective), s is
    above 1.5 pixels, or the radius below 10.

    The image is linear in the light. What is darkest at the rim, so that its brightness is steep in
    n.v there (a glossy plastic by Fresnel's law), is found too small by about 0.1 pixels; so is a ball
    whose shadow begins within some pixels of the rim.

    >>> y, x = np.mgrid[:60, :60] + 0.5
    >>> ball = ndtr((20 - np.hypot(x - 30.2, y - 29.6)) / 0.6)
    >>> [round(v, 1) for v in circle_of_edge(ball, Circle(30, 30, 20.5))]
    [30.2, 29.6, 20.0]
    """
    if circle.radius < 2 * INSIDE:
        return None
    plane = np.asarray(plane, float)
    clipped = plane >= plane.max()
    blur: float | None = None
    for _ in range(3):
        pieces = [_piece(plane, clipped, circle, angle, blur) for angle in ANGLES]
        good = np.array([piece.good for piece in pieces])
        if np.count_nonzero(good) < WINDOWS / 2:
            return None
        circle, off = _moved(circle, pieces, good)
        if blur is None:
            blur = float(np.median([piece.blur for piece in pieces if piece.good]))
        if blur > WIDEST:
            return None
    return circle if MAD * np.median(np.abs(off[good])) < UNCERTAIN else None


def _piece(
    plane: Plane, clipped: Bool[np.ndarray, "H W"], circle: Circle, angle: float, blur: float | None
) -> _Piece:
    """The place of the outline at an angle, with a blur that is known, or is unknown too."""
    depth, along, (row, column) = _window(plane.shape, circle, angle)
    unknown = 9 + (blur is None)
    if len(depth) < 2 * unknown or np.count_nonzero(clipped[row, column]) > 1:
        return _Piece(0.0, 0.0, 0.0, False)
    seen = plane[row, column]

    def predicted(theta: Unknowns) -> Some:
        s = theta[1] if blur is None else blur
        columns = _edge(depth + theta[0], along, float(s), circle.radius)
        return columns @ np.linalg.lstsq(columns, seen, rcond=None)[0]

    def left(theta: Unknowns) -> Some:
        return seen - predicted(theta)

    start, low, high = [0.0, 0.5], [-FARTHEST, SHARPEST], [FARTHEST, 2 * WIDEST]
    free = 2 if blur is None else 1
    found = least_squares(
        left, start[:free], bounds=(low[:free], high[:free]), xtol=1e-4, ftol=1e-6, max_nfev=30
    )
    rms = np.sqrt(2 * found.cost / (len(depth) - unknown))
    error = rms * np.sqrt(np.linalg.pinv(found.jac.T @ found.jac)[0, 0])
    good = found.success and error < UNCERTAIN and abs(found.x[0]) < 0.99 * FARTHEST
    good &= rms < UNEXPLAINED * np.ptp(predicted(found.x))
    good &= error > 0 or rms == 0
    return _Piece(float(found.x[0]), float(error), float(found.x[-1]), bool(good))


def _window(
    shape: tuple[int, ...], circle: Circle, angle: float
) -> tuple[Some, Some, tuple[np.ndarray, np.ndarray]]:
    """Pixels about a point of the outline: how deep inside it they are, where along it, and which."""
    half = float(np.clip(np.pi / WINDOWS * circle.radius, *HALF))
    at = np.array([np.sin(angle), np.cos(angle)]) * circle.radius + [circle.cy, circle.cx]
    reach = half + INSIDE
    low = np.maximum(np.floor(at - reach).astype(int), 0)
    high = np.minimum(np.ceil(at + reach).astype(int), shape)
    row, column = np.mgrid[low[0] : max(low[0], high[0]), low[1] : max(low[1], high[1])]
    y, x = row + 0.5 - circle.cy, column + 0.5 - circle.cx
    depth = circle.radius - np.hypot(x, y)
    turn = np.arctan2(y, x) - angle
    along = (turn - 2 * np.pi * np.round(turn / (2 * np.pi))) * circle.radius / half
    near = (depth < INSIDE) & (depth > -OUTSIDE) & (np.abs(along) < 1)
    return depth[near], along[near], (row[near], column[near])


def _edge(depth: Some, along: Some, s: float, radius: float) -> Float[np.ndarray, "N 8"]:
    """What is seen of 1, sqrt(t), t and the background, each with its slope along the outline."""
    z = (depth - s**2 / (2 * radius)) / s  # a blurred edge is covered by less where it bends away
    covered = ndtr(z)
    root = gamma(1.5) * np.exp(-(z**2) / 4) * pbdv(-1.5, -z)[0]
    ramp = z * covered + np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi)
    columns = np.stack([covered, root, ramp, 1 - covered], axis=-1)
    return np.concatenate([columns, columns * along[:, None]], axis=-1)


def _moved(circle: Circle, pieces: list[_Piece], good: np.ndarray) -> tuple[Circle, Some]:
    """The circle that most of the pieces lie on (Cauchy's loss), and how far they are off it."""
    moves = np.stack([np.cos(ANGLES), np.sin(ANGLES), np.ones(WINDOWS)], axis=-1)
    offset = np.array([piece.offset for piece in pieces])
    weight = good / np.hypot([piece.error for piece in pieces], SCATTER)
    start = np.array([0.0, 0.0, np.median(offset[good])])
    move = least_squares(
        lambda m: (moves @ m - offset) * weight, start, loss="cauchy", f_scale=2.0
    ).x
    return Circle(*(np.array(circle) + move).tolist()), moves @ move - offset
