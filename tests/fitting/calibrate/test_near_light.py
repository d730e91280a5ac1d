"""Near lights from the rays of two mirror balls, traced in NumPy."""

import numpy as np
import pytest
from mirror_scenes import mirror_image

from diffshade.errors import BadInput
from diffshade.io.circle import Circle
from fitting.calibrate import ball_of, find_highlight, mirrored, near_light

SHAPE = (100, 200)
CIRCLES = (Circle(45.2, 50.7, 40.0), Circle(155.1, 48.9, 40.0))
LAMP = np.array([30.0, 80.0, 400.0])


def rays() -> tuple[np.ndarray, np.ndarray]:
    points, directions = [], []
    for circle in CIRCLES:
        center = np.array([circle.cx - SHAPE[1] / 2, SHAPE[0] / 2 - circle.cy, 0.0])
        image = mirror_image(SHAPE, center, circle.radius, LAMP, near=True)
        at = find_highlight(image, circle)
        p, l = mirrored(*ball_of(circle, SHAPE), np.array([at.x]), np.array([at.y]))
        points.append(np.asarray(p[0], float))
        directions.append(np.asarray(l[0], float))
    return np.stack(points), np.stack(directions)


def test_two_balls_tell_where_the_lamp_is() -> None:
    found = near_light(*rays(), degrees=0.2)
    error = found.position - LAMP
    assert np.abs(error).max() < 20, found
    assert error @ np.linalg.solve(found.covariance, error) < 16
    assert found.standard_errors[2] > 3 * found.standard_errors[0]  # along the rays


def test_the_covariance_is_that_of_many_draws(rng: np.random.Generator) -> None:
    points = np.array([[-2.0, 0, 0], [2, 0, 0], [0, 2, 0]])
    lamp, sigma = np.array([0.5, 1.0, 8.0]), np.radians(0.2)
    l = lamp - points
    l /= np.linalg.norm(l, axis=-1, keepdims=True)
    found = [
        near_light(points, l + rng.normal(0, sigma, l.shape), degrees=0.2).position
        for _ in range(400)
    ]
    stated = near_light(points, l, degrees=0.2).standard_errors
    np.testing.assert_allclose(np.std(found, axis=0), stated, rtol=0.25)


def test_what_tells_no_position_is_refused() -> None:
    points, up = np.array([[-1.0, 0, 0], [1, 0, 0]]), np.array([[0.0, 0, 1]] * 2)
    with pytest.raises(BadInput, match="two at the least"):
        near_light(points[:1], up[:1])
    with pytest.raises(BadInput, match="parallel"):
        near_light(points, up)
    with pytest.raises(BadInput, match="behind"):
        near_light(points, np.array([[-1.0, 0, 3], [1, 0, 3]]))
