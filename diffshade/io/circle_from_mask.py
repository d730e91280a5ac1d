"""The circle of a ball's outline, from a mask alone."""

import numpy as np
from jaxtyping import Bool, Float

from diffshade.errors import BadInput
from diffshade.io.circle import Circle

__all__ = ["circle_from_mask"]

Mask = Bool[np.ndarray, "H W"]
Points = Float[np.ndarray, "N 2"]

_SCATTER = 0.5
"""The scatter of a pixelated outline about the true one, in pixels."""


def circle_from_mask(mask: Mask) -> Circle:
    """The circle that fits most of a mask's outline best, robust to a stand or a hole in it.

    A mask drawn by hand or by a threshold may be off by some tenths of a pixel: on the ball of
    DiLiGenT its circle is larger than the circle of the published normals by 0.15 pixels, and smaller
    than the outline in the photographs by 0.6 (`fitting.calibrate.circle_from_images`). Where the mask
    meets the image's edge there is no outline, so a ball may be cut off.

    Raises `BadInput`, without the file's name, where less than half the outline lies on one circle,
    or less than 0.3 of that circle on the outline.
    """
    from scipy.optimize import least_squares

    points = _outline(mask)
    if len(points) < 8:
        raise BadInput("the mask has no outline inside the image; give a circle")

    def distances(circle: Float[np.ndarray, "3"]) -> Float[np.ndarray, "N"]:
        return np.hypot(*(points - circle[:2]).T) - circle[2]

    fits = [
        least_squares(distances, start, loss="cauchy", f_scale=_SCATTER)
        for start in (_algebraic(points), _of_equal_area(mask))
    ]
    best = min(fits, key=lambda fit: fit.cost).x
    near = np.abs(distances(best)) < np.clip(2 * _SCATTER, best[2] / 100, best[2] / 10)
    around = np.unique(np.arctan2(*(points[near] - best[:2]).T) // (np.pi / 18)).size / 36
    if near.mean() < 0.5 or around < 0.3 or best[2] <= 0:
        raise BadInput(
            f"the mask is not the outline of a ball ({near.mean():.0%} of it lies on the best"
            f" circle, and {around:.0%} of that circle on it); give Normal_gt.mat, sphere.json or"
            " --circle"
        )
    return Circle(*(float(x) for x in best))


def _outline(mask: Mask) -> Points:
    """Points (x, y) half way between neighbouring pixels of which one is inside."""
    row, column = np.nonzero(mask[:, :-1] != mask[:, 1:])
    beside = np.stack([column + 1.0, row + 0.5], axis=-1)
    row, column = np.nonzero(mask[:-1] != mask[1:])
    below = np.stack([column + 0.5, row + 1.0], axis=-1)
    return np.concatenate([beside, below])


def _algebraic(points: Points) -> Float[np.ndarray, "3"]:
    """Kasa's circle: x^2 + y^2 = 2 a x + 2 b y + c by linear least squares."""
    centre = points.mean(axis=0)
    x, y = (points - centre).T
    a, b, c = np.linalg.lstsq(
        np.stack([2 * x, 2 * y, np.ones_like(x)], axis=-1), x**2 + y**2, rcond=None
    )[0]
    return np.array([centre[0] + a, centre[1] + b, np.sqrt(c + a**2 + b**2)])


def _of_equal_area(mask: Mask) -> Float[np.ndarray, "3"]:
    row, column = np.nonzero(mask)
    return np.array([column.mean() + 0.5, row.mean() + 0.5, np.sqrt(len(row) / np.pi)])
