"""Between two colours: what the texts say of red and green, greys, and the shorter way round."""

import jax.numpy as jnp
import numpy as np
import pytest

from diffshade.colour.device import rgb_to_hsv
from diffshade.colour.interpolate import SYSTEMS, interpolate
from diffshade.errors import BadInput

RED, GREEN, BLUE = jnp.eye(3)


def test_red_to_green_in_rgb_and_in_hsv() -> None:
    for system, value in (("rgb", 0.5), ("hsv", 1.0)):
        half = rgb_to_hsv(interpolate(RED, GREEN, 0.5, system))
        np.testing.assert_allclose(half, (60, 1, value), atol=1e-4)


@pytest.mark.parametrize("system", SYSTEMS)
def test_the_ends_are_the_colours(system: str, tolerance: float) -> None:
    a, b = jnp.asarray([0.9, 0.2, 0.1]), jnp.asarray([0.1, 0.3, 0.6])
    for share, end in ((0.0, a), (1.0, b)):
        np.testing.assert_allclose(interpolate(a, b, share, system), end, atol=10 * tolerance)


def test_what_is_linear_in_rgb_goes_its_way(tolerance: float) -> None:
    for system in ("cmy", "yiq"):
        found = interpolate(RED, BLUE, 0.3, system)
        np.testing.assert_allclose(found, 0.7 * RED + 0.3 * BLUE, atol=10 * tolerance)


def test_hues_go_the_shorter_way(tolerance: float) -> None:
    """From magenta-red (330) to orange (30) through red, either way."""
    a, b = jnp.asarray([1.0, 0.0, 0.5]), jnp.asarray([1.0, 0.5, 0.0])
    for start, end in ((a, b), (b, a)):
        np.testing.assert_allclose(interpolate(start, end, 0.5, "hsv"), RED, atol=10 * tolerance)


@pytest.mark.parametrize("system", ["hsv", "hls"])
def test_a_grey_takes_the_hue_of_the_other_end(system: str) -> None:
    grey = jnp.full(3, 0.5)
    for start, end in ((grey, BLUE), (BLUE, grey)):
        half = interpolate(start, end, 0.5, system)
        np.testing.assert_allclose(rgb_to_hsv(half)[0], 240, atol=1e-3)


def test_shares_of_an_image(tolerance: float) -> None:
    share = jnp.linspace(0, 1, 4)[None]
    ramp = interpolate(RED, GREEN, share)
    assert ramp.shape == (1, 4, 3)
    np.testing.assert_allclose(ramp[0, 3], GREEN, atol=tolerance)


def test_another_system_is_refused() -> None:
    with pytest.raises(BadInput, match="'lab': give one of rgb, cmy, yiq, hsv, hls"):
        interpolate(RED, GREEN, 0.5, "lab")
