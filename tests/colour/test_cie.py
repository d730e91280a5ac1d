"""CIE colours against published values."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diffshade.colour.cie import (
    SRGB,
    Primaries,
    between_screens,
    in_gamut,
    luv_to_xyz,
    rgb_to_xyz,
    xyy_to_xyz,
    xyz_to_luv,
    xyz_to_rgb,
    xyz_to_xyy,
)
from diffshade.errors import BadInput

NTSC = Primaries((0.67, 0.33), (0.21, 0.71), (0.14, 0.08), white=(0.3101, 0.3162))


def colours(count: int = 50) -> jax.Array:
    return jnp.asarray(np.random.default_rng(0).uniform(0, 1, (count, 3)), float)


def test_the_matrices_of_the_standards() -> None:
    """sRGB: IEC 61966-2-1; NTSC of 1953 under C: Foley and van Dam give 0.299, 0.587, 0.114 for Y."""
    srgb = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    np.testing.assert_allclose(SRGB.to_xyz, srgb, atol=5.1e-5)
    np.testing.assert_allclose(NTSC.to_xyz[1], [0.299, 0.587, 0.114], atol=1e-3)


def test_white_has_its_chromaticity(tolerance: float) -> None:
    x, y, brightness = xyz_to_xyy(rgb_to_xyz(jnp.ones(3)))
    np.testing.assert_allclose((x, y, brightness), (0.3127, 0.3290, 1), atol=10 * tolerance)


@pytest.mark.parametrize(
    ("rgb", "luv"),
    [
        ((1, 0, 0), (53.24, 175.01, 37.76)),
        ((0, 1, 0), (87.73, -83.08, 107.40)),
        ((0, 0, 1), (32.30, -9.41, -130.34)),
        ((1, 1, 1), (100, 0, 0)),
        ((0, 0, 0), (0, 0, 0)),
    ],
)
def test_luv_of_the_primaries(rgb: tuple[float, ...], luv: tuple[float, ...]) -> None:
    """As widely published for sRGB under D65."""
    found = xyz_to_luv(rgb_to_xyz(jnp.asarray(rgb, float)))
    np.testing.assert_allclose(found, luv, atol=0.03)


def test_there_and_back(tolerance: float) -> None:
    xyz = jnp.concatenate([rgb_to_xyz(colours()), 1e-3 * rgb_to_xyz(colours()), jnp.zeros((1, 3))])
    for found in (
        xyy_to_xyz(xyz_to_xyy(xyz)),
        luv_to_xyz(xyz_to_luv(xyz)),
        rgb_to_xyz(xyz_to_rgb(xyz)),
    ):
        np.testing.assert_allclose(found, xyz, atol=30 * tolerance)


def test_another_screen_shows_the_same_colour(tolerance: float) -> None:
    rgb = colours()
    there = between_screens(rgb, SRGB, NTSC)
    np.testing.assert_allclose(rgb_to_xyz(there, NTSC), rgb_to_xyz(rgb), atol=10 * tolerance)
    assert in_gamut(rgb).all()
    assert not in_gamut(between_screens(jnp.asarray([0.0, 1.0, 0.0]), NTSC, SRGB))


def test_lightness_is_smooth_where_its_branches_meet() -> None:
    at = jnp.asarray((6 / 29) ** 3)

    def lightness(y: jax.Array) -> jax.Array:
        return xyz_to_luv(jnp.stack([y, y, y]))[0]

    below, above = (jax.grad(lightness)(at * (1 + h)) for h in (-1e-5, 1e-5))
    np.testing.assert_allclose(below, above, rtol=1e-4)


def test_what_makes_no_colours_is_refused() -> None:
    with pytest.raises(BadInput, match="lie on one line"):
        Primaries((0.2, 0.2), (0.3, 0.3), (0.4, 0.4))
    with pytest.raises(BadInput, match="y above 0"):
        Primaries((0.6, 0.0), (0.3, 0.6), (0.15, 0.06))
