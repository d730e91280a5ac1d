"""A ball seen in perspective: its outline is an ellipse, and its centre is not that of the outline.

The lines of sight that touch a ball of radius R with its centre C at the distance D = |C| from the eye
make a cone about C whose half angle a has sin a = R / D; so d . C = sqrt(D^2 - R^2) |C| / D for every
unit direction d to the outline. With the camera known the cone has three unknowns, where an ellipse
would have five.
"""

from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from diffshade.errors import BadInput
from diffshade.geometry.camera import PerspectiveCamera
from diffshade.geometry.sphere import Sphere
from diffshade.io.circle import Circle

__all__ = ["camera_at_eye", "sphere_of_circle", "sphere_of_outline"]

Points = Float[np.ndarray, "N 2"]

SCATTER = 0.5
"""Of points about the outline, in pixels."""


def camera_at_eye(shape: tuple[int, int], fov: float) -> PerspectiveCamera:
    """The camera at the origin that looks along -z, with the vertical field of view `fov` in radians."""
    height, width = shape
    angle: Any = fov
    eye: Any = (0.0, 0.0, 0.0)
    ahead: Any = (0.0, 0.0, -1.0)
    up: Any = (0.0, 1.0, 0.0)
    camera = PerspectiveCamera(width, height, angle, eye, ahead, up)
    camera.check()
    return camera


def sphere_of_outline(
    points: Points, shape: tuple[int, int], fov: float
) -> tuple[Sphere, PerspectiveCamera]:
    """The ball of radius 1 with this outline, points (x, y) in pixels, y down, and the camera.

    Robust to points that are not of the outline (Cauchy's loss). Its distance and its radius are
    known up to a common factor only: give the true radius to have the distance.

    >>> angle = np.linspace(0, 6, 60)
    >>> circle = np.stack([50 + 20 * np.cos(angle), 50 + 20 * np.sin(angle)], axis=-1)
    >>> sphere, camera = sphere_of_outline(circle, (100, 100), 0.8)
    >>> round(float(sphere.center[2]), 2)
    -6.0
    """
    if len(points) < 3:
        raise BadInput("an outline needs three points at the least: give more of them, or a circle")
    camera = camera_at_eye(shape, fov)
    height, width = shape
    focal = height / (2 * np.tan(fov / 2))
    away = np.stack([points[:, 0] - width / 2, height / 2 - points[:, 1]], axis=-1) / focal
    d = np.append(away, np.full((len(away), 1), -1.0), axis=-1)
    d /= np.linalg.norm(d, axis=-1, keepdims=True)

    def axis(q: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        towards = np.array([q[0], q[1], -1.0])
        return np.asarray(towards / np.linalg.norm(towards))

    def off(q: Float[np.ndarray, "3"]) -> Float[np.ndarray, "N"]:
        # In pixels, near enough
        return (
            np.arctan2(np.linalg.norm(np.cross(d, axis(q)), axis=-1), d @ axis(q)) - q[2]
        ) * focal

    middle = away.mean(axis=0)
    start = np.array([*middle, np.hypot(*(away - middle).T).mean()])
    found = least_squares(off, start, loss="cauchy", f_scale=SCATTER).x
    half = float(found[2])
    if not 0 < half < np.pi / 2:
        raise BadInput("the points are no outline of a ball: correct them, or give a circle")
    center: Any = axis(found) / np.sin(half)
    return Sphere(center), camera


def sphere_of_circle(
    circle: Circle, shape: tuple[int, int], fov: float
) -> tuple[Sphere, PerspectiveCamera]:
    """The ball of radius 1 whose outline is nearest to a circle."""
    angle = np.arange(180) * (np.pi / 90)
    x, y = circle.cx + circle.radius * np.cos(angle), circle.cy + circle.radius * np.sin(angle)
    return sphere_of_outline(np.stack([x, y], axis=-1), shape, fov)
