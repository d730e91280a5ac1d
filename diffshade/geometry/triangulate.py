"""Polygons into triangles, concave ones too."""

import numpy as np
from jaxtyping import Float, Int

from diffshade.errors import BadInput

__all__ = ["triangulate"]

_MOST = 1000
"""Corners of a concave polygon: cutting off ears takes up to the cube of their number."""


def triangulate(polygons: Float[np.ndarray, "N K 3"]) -> Int[np.ndarray, "N K-2 3"]:
    """The corners, numbered from 0 to K - 1, of K - 2 triangles that fill each of N polygons.

    Triangles keep the polygon's orientation. A polygon is cut into a fan about its first corner
    where every triangle of the fan faces as the polygon does, and by cutting off ears (Meisters
    1975) where one does not, in the plane of Newell's normal. One that crosses itself has no right
    answer, and gets some triangles. Raises `BadInput` for a concave one of more than 1000 corners.
    """
    count, corners, _ = polygons.shape
    later = np.arange(1, corners - 1)
    fan = np.stack([np.zeros_like(later), later, later + 1], axis=1)
    triangles = np.tile(fan, (count, 1, 1))
    spokes = polygons[:, 1:] - polygons[:, :1]
    twice_areas = np.cross(spokes[:, :-1], spokes[:, 1:])
    newell = twice_areas.sum(axis=1)  # the vector area: the same sum as Newell's
    facing = np.einsum("nki,ni->nk", twice_areas, newell)
    tolerance = 1e-12 * (newell**2).sum(axis=1, keepdims=True)
    concave = np.flatnonzero((facing < -tolerance).any(axis=1))
    if concave.size and corners > _MOST:
        raise BadInput(
            f"has a concave polygon of {corners} corners, more than {_MOST}: cut it into triangles"
        )
    for polygon in concave:
        triangles[polygon] = _ears(_in_plane(polygons[polygon], newell[polygon]))
    return triangles


def _in_plane(
    polygon: Float[np.ndarray, "K 3"], normal: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "K 2"]:
    """Its projection along the axis nearest to the normal, counter-clockwise."""
    axis = int(np.argmax(np.abs(normal)))
    plane = polygon[:, [(axis + 1) % 3, (axis + 2) % 3]]
    return plane if normal[axis] > 0 else plane * np.array([1.0, -1.0])


def _ears(polygon: Float[np.ndarray, "K 2"]) -> list[tuple[int, int, int]]:
    left = list(range(len(polygon)))
    triangles = []
    while len(left) > 3:
        around = ((left[k - 1], left[k], left[(k + 1) % len(left)]) for k in range(len(left)))
        ears = (k for k, corner in enumerate(around) if _is_ear(polygon, left, *corner))
        ear = next(ears, 0)
        triangles.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    return [*triangles, (left[0], left[1], left[2])]


def _is_ear(polygon: Float[np.ndarray, "K 2"], left: list[int], a: int, b: int, c: int) -> bool:
    """Whether the corner b is convex and no other corner lies in the triangle a, b, c."""
    if _turn(polygon[a], polygon[b], polygon[c]) <= 0:
        return False
    others = polygon[[k for k in left if k not in (a, b, c)]]
    inside = np.ones(len(others), bool)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= _turn(polygon[start], polygon[end], others) >= 0
    return not inside.any()


def _turn(
    a: Float[np.ndarray, "2"], b: Float[np.ndarray, "2"], c: Float[np.ndarray, "*N 2"]
) -> Float[np.ndarray, "*N"]:
    """Twice the area of a, b, c: positive where they run counter-clockwise."""
    u, w = b - a, c - a
    return np.asarray(u[0] * w[..., 1] - u[1] * w[..., 0])
