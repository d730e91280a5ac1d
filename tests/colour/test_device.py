"""Systems of colour against Python's own `colorsys`, and the way there and back."""

import colorsys
from collections.abc import Callable
from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diffshade.colour import device
from diffshade.colour.device import hls_to_rgb, hsv_to_rgb, rgb_to_hls, rgb_to_hsv

STEPS = np.linspace(0, 1, 6)
CUBE = np.array(list(product(STEPS, repeat=3)))
"""Greys, equal components, black and white among them."""


def by_colorsys(f: Callable[..., Any], colours: np.ndarray) -> np.ndarray:
    return np.array([f(*map(float, colour)) for colour in colours])


@pytest.mark.parametrize("name", ["hsv", "hls"])
def test_hues_are_those_of_colorsys(name: str, tolerance: float) -> None:
    cube = jnp.asarray(CUBE, float)
    known = by_colorsys(getattr(colorsys, f"rgb_to_{name}"), np.asarray(cube))
    found = np.asarray(jax.jit(getattr(device, f"rgb_to_{name}"))(cube))
    turn = (found[:, 0] / 360 - known[:, 0] + 0.5) % 1 - 0.5
    np.testing.assert_allclose(turn, 0, atol=tolerance)
    np.testing.assert_allclose(found[:, 1:], known[:, 1:], atol=10 * tolerance)
    assert np.all((found[:, 0] >= 0) & (found[:, 0] < 360))


@pytest.mark.parametrize("name", ["hsv", "hls"])
def test_from_hues_is_that_of_colorsys(name: str, tolerance: float) -> None:
    hues = np.array([0.0, 17.0, 60.0, 100.0, 120.0, 199.0, 240.0, 301.0, 359.0])
    given = np.array([(h, a, b) for h, a, b in product(hues, STEPS, STEPS)])
    known = by_colorsys(getattr(colorsys, f"{name}_to_rgb"), given / (360, 1, 1))
    found = jax.jit(getattr(device, f"{name}_to_rgb"))(jnp.asarray(given, float))
    np.testing.assert_allclose(found, known, atol=10 * tolerance)


@pytest.mark.parametrize("name", ["cmy", "cmyk", "yiq", "hsv", "hls"])
def test_there_and_back(name: str, tolerance: float) -> None:
    there, back = getattr(device, f"rgb_to_{name}"), getattr(device, f"{name}_to_rgb")
    image = jnp.asarray(CUBE, float).reshape(6, 36, 3)
    np.testing.assert_allclose(back(there(image)), image, atol=10 * tolerance)
    assert back(there(image)).dtype == image.dtype


def test_turns_of_the_hue_are_one_colour(tolerance: float) -> None:
    for back in (hsv_to_rgb, hls_to_rgb):
        colours = [back(jnp.asarray([h, 0.6, 0.3], float)) for h in (-310.0, 50.0, 410.0)]
        np.testing.assert_allclose(colours, [colours[1]] * 3, atol=100 * tolerance)


def test_black_ink_takes_the_place_of_all_three() -> None:
    cmyk = device.rgb_to_cmyk(jnp.asarray(CUBE, float))
    assert np.all(cmyk[:, :3].min(axis=1) == 0)
    np.testing.assert_array_equal(cmyk[:, 3], 1 - CUBE.max(axis=1).astype(cmyk.dtype))


def test_luma_is_that_of_the_standard() -> None:
    """0.299 R + 0.587 G + 0.114 B; a grey has no difference of colour."""
    yiq = device.rgb_to_yiq(jnp.asarray([[1.0, 0.0, 0.0], [0.4, 0.4, 0.4]], float))
    np.testing.assert_allclose(yiq, [[0.299, 0.596, 0.212], [0.4, 0, 0]], atol=1e-6)


@pytest.mark.float64
@pytest.mark.parametrize("f", [rgb_to_hsv, rgb_to_hls])
def test_derivatives_are_those_of_finite_differences(f: Callable[..., Any]) -> None:
    for rgb in ([0.7, 0.2, 0.4], [0.1, 0.8, 0.3], [0.2, 0.3, 0.9], [0.9, 0.2, 0.8]):
        at = jnp.asarray(rgb)
        step = 1e-6 * np.eye(3)
        finite = np.stack([(f(at + h) - f(at - h)) / 2e-6 for h in step], axis=1)
        np.testing.assert_allclose(jax.jacfwd(f)(at), finite, rtol=1e-6, atol=1e-6)
