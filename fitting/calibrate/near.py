"""The position of a near light from the rays that two balls or more send towards it.

Mirror ball i shows the light from the point p_i in the direction l_i. Rays that miss each other by their
errors have no common point; the one nearest to all of them, x, solves

    sum over i of P_i (x - p_i) = 0,    P_i = 1 - l_i l_i' (across the ray),

a linear equation (Hartley and Sturm 1997 call it the midpoint where there are two). An error of a
direction moves a ray the more the farther the light is, so each counts by 1 / distance^2.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from diffshade.errors import BadInput

__all__ = ["NearLight", "near_light"]

ROUNDS = 8
PARALLEL = 1e-6
"""The square of the sine of the angle between rays that are told apart."""


class NearLight(NamedTuple):
    """Where a light is, the covariance of that, and by how much the rays miss it, in degrees."""

    position: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "3 3"]
    miss: Float[np.ndarray, "B"]

    @property
    def standard_errors(self) -> Float[np.ndarray, "3"]:
        """Of x, y and z."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)))


def near_light(
    points: Float[np.ndarray, "B 3"],
    directions: Float[np.ndarray, "B 3"],
    *,
    degrees: float = 0.3,
) -> NearLight:
    """The point nearest to B >= 2 rays, from `points` in `directions`, in the points' own unit.

    All in one world: two balls in one photograph have to be of known size or place, as `mirrored` has
    them. `degrees` is the standard error of a direction; that of a highlight's centroid is some 0.2 to
    0.3. The covariance is that of weighted least squares, for this error or for the one by which the
    rays miss each other, whichever is larger: along the rays it grows as distance over the balls'
    separation. Raises `BadInput` for one ray, for parallel ones, and where the nearest point lies
    behind a ball.

    >>> points = np.array([[-1.0, 0, 0], [1, 0, 0]])
    >>> near_light(points, np.array([[1.0, 0, 3], [-1, 0, 3]])).position.round(6).tolist()
    [0.0, 0.0, 3.0]
    """
    points, l = np.asarray(points, float), np.asarray(directions, float)
    if len(points) < 2:
        raise BadInput("one ball tells a light's direction only: give the rays of two at the least")
    norm = np.linalg.norm(l, axis=-1, keepdims=True)
    if not (np.isfinite(points).all() and np.isfinite(l).all() and (norm > 0).all()):
        raise BadInput("a ray is not finite, or has no direction: give three numbers each")
    l = l / norm
    across = np.eye(3) - l[:, :, None] * l[:, None, :]
    if np.linalg.eigvalsh(across.mean(axis=0))[0] < PARALLEL:
        raise BadInput("the rays are parallel: the light is too far away to tell where it is")
    weight = np.ones(len(points))
    for _ in range(ROUNDS):
        matrix = (across * weight[:, None, None]).sum(axis=0)
        moment = ((across @ points[:, :, None])[..., 0] * weight[:, None]).sum(axis=0)
        x = np.linalg.solve(matrix, moment)
        along = ((x - points) * l).sum(axis=-1)
        if not np.abs(along).max() > 0:
            raise BadInput("the rays meet in the balls themselves: give rays from different points")
        weight = 1 / np.maximum(along, np.abs(along).max() * 1e-3) ** 2
    if (along <= 0).any():
        raise BadInput(
            f"the rays meet behind ball {int(along.argmin())}: check which highlights belong together"
        )
    gap = np.linalg.norm((across @ (x - points)[:, :, None])[..., 0], axis=-1)
    miss = np.arctan2(gap, along)
    freedom = 2 * len(points) - 3
    sigma = max(np.radians(degrees), float(np.sqrt((miss**2).sum() / freedom)))
    covariance = sigma**2 * np.linalg.inv((across * weight[:, None, None]).sum(axis=0))
    return NearLight(x, covariance, np.degrees(miss))
