"""The outline of a ball in photographs without a mask, from the maximum over all lights.

One light leaves a part of the rim in the dark, and a circle through the rest may be anywhere. The
maximum over all of them shows the rim all round. Where it ends is found to a part of a pixel along
lines through the centre; a stand, a shadow or what else disturbs a part of it is given no weight. A
model of the edge (`fitting.calibrate.edge`) then says it better, where it holds.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy import ndimage
from scipy.optimize import least_squares

from diffshade.errors import BadInput
from diffshade.io.circle import Circle
from fitting.calibrate.edge import circle_of_edge

__all__ = ["brightest", "circle_from_images", "outline_points"]

Plane = Float[np.ndarray, "H W"]
Points = Float[np.ndarray, "N 2"]

SMOOTHING = 1.5
"""Standard deviation in pixels of the Gauss that edges are sought behind."""
LONGEST = 480
"""Pixels along the longer side of the image that circles are first sought in."""
EDGES = 3000
"""Edge pixels that are looked at, the strongest."""
DRAWS = 4000
"""Circles through three edge pixels that are tried (Fischler and Bolles 1981)."""
RAYS = 720
"""Lines through the centre along which the outline is sought."""
ALONG = 0.9
"""The cosine within which an edge runs along a circle."""
SCATTER = 0.5
"""Of points about the outline, in pixels."""


def brightest(images: Sequence[Float[np.ndarray, "H W C"]]) -> Plane:
    """The largest value of each pixel over all images, channels averaged.

    >>> brightest([np.zeros((1, 2, 3)), np.ones((1, 2, 3))]).tolist()
    [[1.0, 1.0]]
    """
    return np.max([np.nan_to_num(image).mean(axis=-1) for image in images], axis=0)


def circle_from_images(images: Sequence[Float[np.ndarray, "H W C"]]) -> Circle:
    """The circle of a ball's outline in photographs from one place under different lights.

    Circles through three edge pixels drawn at random (from a fixed seed, the strong ones more often, as
    most are noise) are judged by how much of them lies on edges that run along them; the best is
    refined on sub-pixel edges by least squares with Cauchy's loss. Radii are sought from 1/20 to 5/8 of
    the image's shorter side.

    These edges are where the logarithm changes most: outside the outline by 0.2 to 0.6 pixels on matte
    balls, the more the picture is blurred. `circle_of_edge` has it to some hundredths. Where it finds
    none (of strong blur, perspective or clipping, or a mirror that is as bright as what is behind it) the
    circle stays that of the edges.

    Raises `BadInput` where less than 0.3 of the best circle lies on an edge: give the circle then.
    """
    plane = brightest(images)
    shrink = max(plane.shape) / LONGEST
    small = (
        plane
        if shrink <= 1
        else ndimage.zoom(plane, 1 / shrink, order=1, grid_mode=True, mode="nearest")
    )
    factor = plane.shape[0] / small.shape[0]
    coarse, covered = _drawn(small)
    if covered < 0.3:
        raise BadInput(
            f"the photographs show no outline of a ball (the best circle lies on an edge over"
            f" {covered:.0%} of its length): give a mask or a circle"
        )
    circle = np.array(coarse) * factor
    reach = max(3.0 * factor, 0.03 * circle[2])
    for _ in range(3):
        points = outline_points(plane, Circle(*circle.tolist()), reach)
        if len(points) < RAYS // 4:
            raise BadInput("the photographs show no outline of a ball: give a mask or a circle")
        circle = _fitted(points, circle)
        reach = max(3.0, reach / 2)
    near = np.abs(np.hypot(*(points - circle[:2]).T) - circle[2]) < max(1.0, circle[2] / 200)
    if np.count_nonzero(near) < 0.4 * RAYS:
        raise BadInput(
            "the photographs show too little of a ball's outline"
            f" ({np.count_nonzero(near) / RAYS:.0%} of the best circle): give a mask or a circle"
        )
    found = Circle(*circle.tolist())
    return circle_of_edge(plane, found) or found


def outline_points(plane: Plane, circle: Circle, reach: float) -> Points:
    """Where the brightness changes most within `reach` pixels of a circle, along lines through its
    centre: points (x, y), at most one a line.

    The change is that of the logarithm, so that a dim part of the rim counts as a bright one does.
    """
    plane = _logarithm(plane)
    angle = np.arange(RAYS) * (2 * np.pi / RAYS)
    steps = np.arange(-reach, reach + 0.125, 0.25)
    radius = circle.radius + steps
    x = circle.cx + np.cos(angle)[:, None] * radius
    y = circle.cy + np.sin(angle)[:, None] * radius
    inside = (x > 1) & (x < plane.shape[1] - 1) & (y > 1) & (y < plane.shape[0] - 1)
    smooth = ndimage.gaussian_filter(plane, 1.0)
    profile = ndimage.map_coordinates(smooth, [y - 0.5, x - 0.5], order=3, mode="nearest")
    change = np.abs(np.gradient(profile, axis=1))
    best = change[:, 2:-2].argmax(axis=1) + 2
    row = np.arange(RAYS)
    left, peak, right = (change[row, best + k] for k in (-1, 0, 1))
    bend = left - 2 * peak + right
    shift = np.where(bend < 0, 0.5 * (left - right) / np.where(bend < 0, bend, 1), 0)
    there = inside.all(axis=1) & (bend < 0) & (best > 2) & (best < len(steps) - 3)
    there &= peak > 0.1 * np.median(peak)
    at = circle.radius + steps[best] + 0.25 * np.clip(shift, -1, 1)
    points = np.stack([circle.cx + np.cos(angle) * at, circle.cy + np.sin(angle) * at], axis=-1)
    return points[there]


def _logarithm(plane: Plane) -> Plane:
    """Of the brightness, levelled off where it is within the noise of black."""
    top = float(np.quantile(plane, 0.99))
    return np.log(plane.clip(0, None) + max(0.01 * top, 1e-12))


def _drawn(plane: Plane) -> tuple[tuple[float, float, float], float]:
    """The best of many circles through edge pixels, and the share of it that lies on edges."""
    smooth = _logarithm(plane)
    across = ndimage.gaussian_filter(smooth, SMOOTHING, order=(0, 1))
    down = ndimage.gaussian_filter(smooth, SMOOTHING, order=(1, 0))
    strength = np.hypot(across, down)
    ridge = _thin(strength, across, down)
    row, column = np.nonzero(ridge & (strength > 0))
    order = np.argsort(strength[row, column])[::-1][:EDGES]
    row, column = row[order], column[order]
    points = np.stack([column, row], axis=-1) + 0.5
    normal = np.stack([across[row, column], down[row, column]], -1) / strength[row, column, None]
    if len(points) < 3:
        return (0.0, 0.0, 0.0), 0.0
    random = np.random.default_rng(0)
    likely = strength[row, column] / strength[row, column].sum()
    drawn = points[random.choice(len(points), (DRAWS, 3), p=likely)]
    circles = _through(drawn)
    shorter = min(plane.shape)
    with np.errstate(invalid="ignore"):
        possible = (circles[:, 2] > shorter / 20) & (circles[:, 2] < 0.625 * shorter)
    circles = circles[possible & np.isfinite(circles).all(axis=1)]
    best, covered = (0.0, 0.0, 0.0), 0.0
    for circle in circles:
        offset = points - circle[:2]
        distance = np.hypot(*offset.T)
        on = np.abs(distance - circle[2]) < 1.0
        on &= np.abs((offset * normal).sum(-1)) > ALONG * distance
        sectors = np.unique((np.arctan2(offset[on, 1], offset[on, 0]) // (np.pi / 60)).astype(int))
        share = len(sectors) / 120
        if share > covered:
            best, covered = (float(circle[0]), float(circle[1]), float(circle[2])), share
    return best, covered


def _thin(strength: Plane, across: Plane, down: Plane) -> np.ndarray:
    """Where the strength is largest along its own direction, horizontally or vertically."""
    along = np.abs(across) >= np.abs(down)
    sideways = np.where(along, 1, 0)
    rows, columns = np.mgrid[: strength.shape[0], : strength.shape[1]]
    before = strength[(rows - 1 + sideways).clip(0), (columns - sideways).clip(0)]
    after = strength[
        (rows + 1 - sideways).clip(None, strength.shape[0] - 1),
        (columns + sideways).clip(None, strength.shape[1] - 1),
    ]
    return (strength >= before) & (strength > after)


def _through(points: Float[np.ndarray, "N 3 2"]) -> Float[np.ndarray, "N 3"]:
    """The circle (cx, cy, radius) through each three points; not finite where they lie on a line."""
    a, b = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    area = 2 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    aa, bb = (a**2).sum(-1), (b**2).sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (b[:, 1] * aa - a[:, 1] * bb) / area
        y = (a[:, 0] * bb - b[:, 0] * aa) / area
    return np.stack([points[:, 0, 0] + x, points[:, 0, 1] + y, np.hypot(x, y)], axis=-1)


def _fitted(points: Points, start: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The circle that most of the points lie on, by geometric distance and Cauchy's loss."""

    def distances(circle: Float[np.ndarray, "3"]) -> Float[np.ndarray, "N"]:
        return np.hypot(*(points - circle[:2]).T) - circle[2]

    return np.asarray(least_squares(distances, start, loss="cauchy", f_scale=SCATTER).x)
