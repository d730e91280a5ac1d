"""Halftone and dither: the levels are those that theory counts, and the mean intensity is kept."""

from itertools import pairwise

import numpy as np
import pytest

from diffshade.colour.halftone import (
    clustered_dot,
    dispersed_dot,
    dither,
    halftone,
    level_count,
)
from diffshade.errors import BadInput

MATRICES = [
    clustered_dot(3),
    clustered_dot(4),
    clustered_dot(5),
    dispersed_dot(2),
    dispersed_dot(8),
]


def test_the_matrices_of_the_text() -> None:
    assert clustered_dot(3).tolist() == [[6, 8, 4], [1, 0, 3], [5, 2, 7]]
    assert dispersed_dot(2).tolist() == [[0, 2], [3, 1]]


@pytest.mark.parametrize("bits", [1, 2, 3])
@pytest.mark.parametrize("matrix", MATRICES, ids=len)
def test_levels_are_as_many_as_they_should_be(matrix: np.ndarray, bits: int) -> None:
    """Every level is a mean of its own, and no mean lies between."""
    order, most = len(matrix), 2**bits - 1
    ramp = np.linspace(0, 1, 4 * level_count(order, bits))[None]
    means = halftone(ramp, matrix, bits).reshape(order, -1, order).sum(axis=(0, 2))
    assert len(set(means.tolist())) == level_count(order, bits) == order**2 * most + 1
    np.testing.assert_allclose(
        means / (order**2 * most), ramp[0], atol=0.5 / (order**2 * most) + 1e-9
    )


@pytest.mark.parametrize("matrix", MATRICES, ids=len)
def test_dither_keeps_the_mean_of_an_even_region(matrix: np.ndarray) -> None:
    order = len(matrix)
    for intensity in (0.0, 0.2, 0.5, 0.77, 1.0):
        lit = dither(np.full((3 * order, 2 * order), intensity), matrix)
        assert lit.mean() == pytest.approx(np.rint(intensity * order**2) / order**2)


def test_a_brighter_pixel_loses_no_dot() -> None:
    """The dots of one level are among those of the next."""
    for matrix in MATRICES:
        cells = [halftone(np.array([[x]]), matrix) for x in np.linspace(0, 1, 30)]
        assert all(np.all(a <= b) for a, b in pairwise(cells))


def test_a_clustered_dot_is_one_dot() -> None:
    """Every level but the first touches what was lit before."""
    for order in (4, 5, 6):
        places = np.argsort(clustered_dot(order).ravel())
        y, x = np.divmod(places, order)
        for rank in range(1, order**2):
            apart = np.maximum(abs(y[:rank] - y[rank]), abs(x[:rank] - x[rank]))
            assert apart.min() == 1


def test_dither_reads_the_matrix_by_column_and_row() -> None:
    """S(x, y) > D[x mod n, y mod n], x to the right."""
    lit = dither(np.full((3, 3), 2 / 9), clustered_dot(3))
    assert np.argwhere(lit).tolist() == [[0, 1], [1, 1]]


def test_what_is_no_image_and_no_matrix_is_refused() -> None:
    for call, message in (
        (lambda: dither(np.full((2, 2), 1.5), dispersed_dot(2)), r"outside \[0, 1\]"),
        (lambda: dither(np.full((2, 2), np.nan), dispersed_dot(2)), r"outside \[0, 1\]"),
        (lambda: dither(np.zeros(4), dispersed_dot(2)), r"shape \(4,\): give intensities"),
        (lambda: dither(np.zeros((2, 2)), np.ones((2, 2), int)), "0 to n\\^2 - 1, once each"),
        (lambda: dispersed_dot(3), "order of a dispersed dot is 3: give a power of 2"),
        (lambda: clustered_dot(0), "order of a matrix is 0: give 1 or more"),
        (lambda: level_count(2, 0), "bits are 0: give 1 or more"),
    ):
        with pytest.raises(BadInput, match=message):
            call()
