"""Whether a mesh stands between points and a source of light, by rays from the source (Embree).

A ray starts at the source, or where it enters the mesh's sphere, and the first triangle that it meets
hides the point behind it. The point itself mostly lies on the mesh too, and a ray that starts there
would meet its own triangle or not as rounding wills; a ray that ends there meets that triangle first
where nothing hides it. Whether a point lies on the plane of the triangle met is decided across that
plane, in double precision, and not along the ray, so that grazing light is no exception. Nor is a
source that lies on the mesh, as a lamp in a ceiling, hidden by the triangle on which it lies: its ray
starts again just beyond.
"""

import numpy as np
from jaxtyping import Bool, Float

from diffshade.geometry.mesh import Mesh
from diffshade.geometry.raycast import Target, target_of

__all__ = ["hidden_by_mesh"]

BLOCK = 2**18
"""Rays that are in memory at once."""

ROUNDINGS = 16
"""So many roundings of a coordinate off its plane, a point still lies on it: Embree's, in single
precision, and those of the positions."""

Points = Float[np.ndarray, "N 3"]


def hidden_by_mesh(
    mesh: Mesh, points: Points, towards: Points, distance: Float[np.ndarray, "N"], eps: float
) -> Bool[np.ndarray, "N"]:
    """Which points' rays `towards` a source, unit vectors, are stopped within the `distance` to it.

    `eps` is the rounding of the points' coordinates. Raises `BadInput` as `visibility` does.
    """
    target = target_of(mesh)
    hidden = np.zeros(len(points), bool)
    for first in range(0, len(points), BLOCK):
        some = slice(first, first + BLOCK)
        hidden[some] = _hidden(target, points[some], towards[some], distance[some], eps)
    return hidden


def _hidden(
    target: Target, points: Points, towards: Points, distance: Float[np.ndarray, "N"], eps: float
) -> Bool[np.ndarray, "N"]:
    centre, radius = np.asarray(target.centre), float(target.radius)
    p, far = (points - centre) / radius, distance / radius
    along = -_dot(p, towards)  # where the ray is closest to the centre
    closest = p + along[:, None] * towards
    start = np.minimum(far, along + 1.5)
    meets = (_dot(closest, closest) < 1 + 1e-6) & (start > 0)
    hidden = np.zeros(len(points), bool)
    chosen, corners = np.flatnonzero(meets), np.asarray(target.corners)
    largest = np.abs(points).max(axis=1, initial=0) / radius + np.where(np.isfinite(far), far, 0)
    off = ROUNDINGS * (np.finfo(np.float32).eps + eps * largest)
    step = off.copy()
    while chosen.size:
        origin = p[chosen] + start[chosen, None] * towards[chosen]
        met = target.scene.run(origin.astype(np.float32), (-towards[chosen]).astype(np.float32))
        chosen, met = chosen[met >= 0], met[met >= 0]
        a, b, c = np.split(corners[met], 3, axis=1)
        n = np.cross(b - a, c - a)
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        height, rise = _dot(n, p[chosen] - a), _dot(n, towards[chosen])
        # The ray meets the plane between point and source where it goes down to it from the point
        hidden[chosen] = (np.abs(height) > off[chosen]) & (height * rise < 0)
        with np.errstate(invalid="ignore"):
            at_source = np.abs(height + far[chosen] * rise) <= off[chosen]
        chosen = chosen[hidden[chosen] & at_source]
        hidden[chosen] = False
        start[chosen] = np.minimum(start, far)[chosen] - step[chosen]
        step[chosen] *= 2
        chosen = chosen[start[chosen] > 0]
    return hidden


def _dot(a: Points, b: Points) -> Float[np.ndarray, "N"]:
    return np.einsum("ij,ij->i", a, b)
