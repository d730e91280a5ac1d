"""Polygons into triangles that fill them, once, and face as they do."""

import numpy as np
import pytest

from diffshade.geometry.triangulate import triangulate

TURN = np.linalg.qr(np.array([[0.3, -0.5, 0.8], [0.7, 0.6, -0.1], [0.2, 0.9, 0.4]]))[0]

FLAT = {
    "triangle": [[0, 0], [1, 0], [0, 1]],
    "square": [[0, 0], [1, 0], [1, 1], [0, 1]],
    "pentagon": [[0, 0], [2, 0], [3, 1], [1, 3], [-1, 1]],
    "arrow, tip first": [[0, 2], [-1, -1], [0, 0], [1, -1]],
    "arrow, notch second": [[-1, -1], [0, 0], [1, -1], [0, 2]],
    "house with a notch": [[0, 2], [0, 0], [2, 0], [2, 2], [1, 0.2]],
    "comb": [[0, 0], [6, 0], [6, 3], [5, 3], [5, 1], [4, 1], [4, 3], [2, 3], [2, 1], [1, 1], [1, 3]],
    "collinear corners": [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [0, 2]],
}  # fmt: skip


def area(corners):
    """Signed, by the shoelace formula."""
    x, y = np.asarray(corners, float).T
    return (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("name", FLAT)
def test_triangles_fill_the_polygon(name, clockwise):
    flat = np.array(FLAT[name], float)[:: -1 if clockwise else 1]
    for turned in (np.eye(3), TURN):
        polygon = np.pad(flat, ((0, 0), (0, 1))) @ turned.T + np.array([1.0, 2, 3])
        (triangles,) = triangulate(polygon[None])
        assert triangles.shape == (len(flat) - 2, 3)
        areas = np.array([area(flat[triangle]) for triangle in triangles])
        # No triangle faces the other way, and so none overlaps where the sum is the whole.
        assert (areas * np.sign(area(flat)) > -1e-12).all()
        assert areas.sum() == pytest.approx(area(flat), rel=1e-12)


def test_many_polygons_at_once_keep_their_fans_where_they_can():
    square = np.pad(np.array(FLAT["square"], float), ((0, 0), (0, 1)))
    arrow = np.pad(np.array(FLAT["arrow, notch second"], float), ((0, 0), (0, 1)))
    triangles = triangulate(np.stack([square, arrow, square]))
    np.testing.assert_array_equal(triangles[0], [[0, 1, 2], [0, 2, 3]])
    np.testing.assert_array_equal(triangles[2], triangles[0])
    assert {3, 1} <= set(triangles[1][0]) & set(triangles[1][1])  # cut from the notch to the tip


def test_a_polygon_that_crosses_itself_gets_some_triangles():
    bow_tie = np.array([[[0.0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0], [0.5, 2, 0]]])
    assert triangulate(bow_tie).shape == (1, 3, 3)


def test_no_polygons():
    assert triangulate(np.zeros((0, 4, 3))).shape == (0, 2, 3)
