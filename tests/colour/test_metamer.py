"""Metamers: alike under one light by construction, and not under another."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diffshade.colour.metamer import are_metamers, metamer, metameric_black
from diffshade.colour.observer import illuminant, spectrum_to_xyz, standard_observer
from diffshade.errors import BadInput

WAVELENGTHS = np.arange(400.0, 701.0, 10.0)
DAY, LAMP = (illuminant(name, WAVELENGTHS) for name in ("D65", "A"))


def reflectances(count: int) -> jax.Array:
    """Smooth ones, in [0, 1]."""
    place = np.linspace(0, np.pi, 31)
    waves = np.stack([np.cos(k * place + k) for k in range(5)])
    amounts = np.random.default_rng(0).uniform(-0.1, 0.1, (count, 5))
    return jnp.asarray(0.5 + amounts @ waves, float)


def under(light: np.ndarray, reflectance: jax.Array) -> np.ndarray:
    shone = jnp.asarray(light, reflectance.dtype) * reflectance
    return np.asarray(spectrum_to_xyz(shone, WAVELENGTHS, white=light))


def test_a_metameric_black_is_black_under_its_light_only(tolerance: float) -> None:
    black = metameric_black(reflectances(1)[0], DAY, WAVELENGTHS)
    assert abs(black).max() > 0.1
    np.testing.assert_allclose(under(DAY, black), 0, atol=10 * tolerance)
    assert abs(under(LAMP, black)).max() > 1e-3


@pytest.mark.float64
def test_it_is_the_nearest_of_all_by_least_squares() -> None:
    """Lagrange's conditions of min |m - other|^2 under A^T m = A^T r, solved as one system."""
    first, second = np.asarray(reflectances(2))
    steps = np.gradient(WAVELENGTHS)
    steps[[0, -1]] /= 2
    seen = (DAY * steps)[:, None] * standard_observer(WAVELENGTHS)
    seen /= seen.sum()
    system = np.block([[np.eye(31), seen], [seen.T, np.zeros((3, 3))]])
    expected = np.linalg.solve(system, np.concatenate([second, seen.T @ first]))[:31]
    found = metamer(jnp.asarray(first), jnp.asarray(second), DAY, WAVELENGTHS)
    np.testing.assert_allclose(found, expected, atol=1e-10)


def test_metamers_are_told_from_equals_and_from_others() -> None:
    first, second = reflectances(8), reflectances(16)[8:]
    pair = metamer(first, second, DAY, WAVELENGTHS)
    assert are_metamers(first, pair, WAVELENGTHS, light=DAY, tolerance=1e-4).all()
    assert not are_metamers(first, pair, WAVELENGTHS, light=LAMP, tolerance=1e-4).any()
    assert not are_metamers(first, first, WAVELENGTHS, light=DAY, tolerance=1e-4).any(), (
        "one spectrum"
    )
    assert not are_metamers(first, second, WAVELENGTHS, light=DAY, tolerance=1e-4).any(), (
        "two colours"
    )
    lamp, day = jnp.asarray(LAMP, float), jnp.asarray(DAY, float)
    assert not are_metamers(lamp, day, WAVELENGTHS)


def test_the_light_has_to_show_three_numbers() -> None:
    line = (WAVELENGTHS == 550).astype(float)
    with pytest.raises(BadInput, match="fewer than three numbers are seen"):
        metameric_black(reflectances(1)[0], line, WAVELENGTHS)
