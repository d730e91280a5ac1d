"""Intensities that look equally far apart, gamma, and the table of a screen."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diffshade.colour.srgb import from_srgb, to_srgb
from diffshade.colour.transfer import (
    displayed,
    intensity_levels,
    levels_needed,
    look_up_table,
    value_for,
)
from diffshade.errors import BadInput


def test_levels_have_one_ratio() -> None:
    levels = intensity_levels(0.02, 255)
    assert (levels[0], levels[-1], len(levels)) == (pytest.approx(0.02), 1.0, 256)
    np.testing.assert_allclose(levels[1:] / levels[:-1], (1 / 0.02) ** (1 / 255), rtol=1e-12)


@pytest.mark.parametrize(
    ("dynamic_range", "published"), [(50, 400), (100, 465), (400, 600), (1000, 700), (10, 234)]
)
def test_the_numbers_of_levels_of_the_books(dynamic_range: float, published: int) -> None:
    """Foley and van Dam's table of typical displays: 400 to 530 for a CRT, 465 for a photograph."""
    assert levels_needed(1 / dynamic_range) == pytest.approx(published, rel=0.02)


def test_there_and_back(tolerance: float) -> None:
    x = jnp.linspace(0, 1, 101)
    np.testing.assert_allclose(displayed(value_for(x, 2.3, 0.8), 2.3, 0.8), x, atol=10 * tolerance)
    for array in (x, np.asarray(x)):
        back = from_srgb(to_srgb(array))
        assert isinstance(back, type(array))
        assert back.dtype == array.dtype
        np.testing.assert_allclose(back, x, atol=1e-6)


def test_the_table_is_the_formula() -> None:
    levels = intensity_levels(1e-3, 63)
    table = look_up_table(levels, 2.2, scale=1.2, bits=10)
    values = value_for(jnp.asarray(levels, float), 2.2, 1.2)
    np.testing.assert_array_equal(table, np.rint(np.asarray(values, float) * 1023))
    shown = np.asarray(displayed(jnp.asarray(table / 1023, float), 2.2, 1.2))
    assert np.abs(shown - levels).max() < 1.2 * 2.2 / 1023


def test_srgb_is_that_of_the_standard() -> None:
    np.testing.assert_allclose(to_srgb(np.array([0.002, 0.5])), [0.02584, 0.735357], atol=1e-6)
    slope = jax.grad(lambda x: to_srgb(x))(jnp.asarray(0.0))
    np.testing.assert_allclose(slope, 12.92, rtol=1e-6)


def test_what_no_screen_shows_is_refused() -> None:
    for call, message in (
        (lambda: intensity_levels(0.0, 8), "lowest intensity is 0: it must be above 0"),
        (lambda: intensity_levels(0.1, 0), "number of steps is 0"),
        (lambda: levels_needed(0.1, 1.0), "ratio of levels is 1: it must be above 1"),
        (lambda: value_for(jnp.ones(1), -1.0), "gamma is -1: it must be above 0"),
        (lambda: look_up_table(np.array([1.5]), 2.2), "reach beyond 0 to 1"),
        (lambda: look_up_table(np.array([np.nan]), 2.2), "reach beyond 0 to 1"),
    ):
        with pytest.raises(BadInput, match=message):
            call()
