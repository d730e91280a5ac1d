"""Dominant wavelengths against published ones, and against mixtures whose parts are known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diffshade.colour.cie import D65, SRGB, xyz_to_xyy
from diffshade.colour.dominant import (
    complementary_wavelength,
    dominant_wavelength,
    excitation_purity,
)
from diffshade.colour.observer import OBSERVER, spectral_locus, standard_observer, tables
from diffshade.errors import BadInput

E = (1 / 3, 1 / 3)
C = (0.3101, 0.3162)


@pytest.mark.parametrize(
    ("xy", "white", "wavelength"),
    [
        # ITU-R BT.2020, whose primaries are pure light of these wavelengths
        ((0.708, 0.292), D65, 630),
        ((0.170, 0.797), D65, 532),
        ((0.131, 0.046), D65, 467),
        # The CIE's own RGB of 1931: 546.1 and 435.8 nm
        ((0.27376, 0.71741), E, 546.1),
        ((0.16658, 0.00886), E, 435.8),
        # Adobe Wide Gamut: 525 and 450 nm
        ((0.1152, 0.8264), (0.3457, 0.3585), 525),
        ((0.1566, 0.0177), (0.3457, 0.3585), 450),
    ],
)
def test_primaries_of_published_wavelength(
    xy: tuple[float, float], white: tuple[float, float], wavelength: float
) -> None:
    """Given to three or four digits of x and y, which are some hundredths of a nanometre."""
    at = jnp.asarray(xy, float)
    assert abs(dominant_wavelength(at, white) - wavelength) < 0.2
    assert abs(excitation_purity(at, white) - 1) < 2e-3


def xyz(wavelength: float) -> np.ndarray:
    return standard_observer(np.array([wavelength]))[0]


@pytest.mark.parametrize("wavelength", [470.0, 500.0, 520.0, 550.0, 580.0, 620.0])
def test_white_and_pure_light_make_known_mixtures(wavelength: float, tolerance: float) -> None:
    """With shares s of X + Y + Z the purity is s, and the wavelength that of the pure part."""
    pure = xyz(wavelength)
    for share in (1e-3, 0.3, 0.9):
        mixed = (1 - share) * np.full(3, 1 / 3) + share * pure / pure.sum()
        at = xyz_to_xyy(jnp.asarray(mixed, float))[:2]
        wanted = np.array([wavelength, share])
        found = jnp.stack([dominant_wavelength(at, E), excitation_purity(at, E)])
        # In float32 the distance from white has lost some digits.
        np.testing.assert_allclose(found, wanted, rtol=10 * tolerance / share)


def test_complements_make_white() -> None:
    """A colour and as much pure light of its complementary wavelength as there must be."""
    colours = np.array([[0.45, 0.40], [0.20, 0.20], [0.35, 0.20], [0.50, 0.25]])
    for xy, found in zip(
        colours, complementary_wavelength(jnp.asarray(colours, float)), strict=True
    ):
        pure = xyz(float(found))
        other = pure[:2] / pure.sum() - D65
        own = xy - D65
        assert abs(own[0] * other[1] - own[1] * other[0]) < 3e-5, "on one line with white"
        assert own @ other < 0, "on either side of it"


def test_purples_have_a_complementary_wavelength_only() -> None:
    """Between the ends of the locus: with a minus sign, as greens have for a complement."""
    ends = spectral_locus()[1][[0, -1]]
    purples = np.linspace(0.05, 0.95, 7)[:, None] * (ends[1] - ends[0]) + ends[0]
    for share in (0.2, 1.0):
        at = jnp.asarray(share * purples + (1 - share) * np.array(C), float)
        found = np.asarray(dominant_wavelength(at, C))
        assert np.all((found < -492) & (found > -568))
        np.testing.assert_allclose(-found, complementary_wavelength(at, C), rtol=1e-6)
        np.testing.assert_allclose(excitation_purity(at, C), share, rtol=1e-4)
    green = jnp.asarray(SRGB.green, float)
    assert float(complementary_wavelength(green)) == -float(dominant_wavelength(green))


def test_colour_science_finds_the_same_to_a_nanometre() -> None:
    """Which gives the nearest entry of its table. Its locus, and its purples, end farther out."""
    colour = tables()
    matching = colour.MSDS_CMFS[OBSERVER]
    x, y = np.meshgrid(np.linspace(0.15, 0.55, 6), np.linspace(0.15, 0.55, 6))
    grid = np.stack([x, y], axis=-1)[x + y < 0.9]
    known = np.array([colour.dominant_wavelength(xy, D65, matching)[0] for xy in grid])
    purity = np.array([colour.excitation_purity(xy, D65, matching) for xy in grid])
    at = jnp.asarray(grid, float)
    np.testing.assert_allclose(dominant_wavelength(at), known, atol=1)
    np.testing.assert_allclose(excitation_purity(at), purity, atol=1e-3)
    assert (known < 0).sum() > 3, "purples are among them"


@pytest.mark.float64
def test_derivatives_are_those_of_finite_differences() -> None:
    for xy in ([0.45, 0.40], [0.20, 0.20], [0.35, 0.20]):
        at = jnp.asarray(xy)
        for f in (dominant_wavelength, excitation_purity):
            finite = [(f(at + h) - f(at - h)) / 2e-7 for h in 1e-7 * np.eye(2)]
            np.testing.assert_allclose(jax.grad(f)(at), np.array(finite), rtol=1e-5)


def test_white_has_none() -> None:
    white = jnp.asarray(D65, float)
    for f in (dominant_wavelength, complementary_wavelength, excitation_purity):
        for found in (f(white), jax.jacfwd(f)(white), jax.jacrev(f)(white)):
            np.testing.assert_array_equal(found, 0)


def test_a_white_outside_the_locus_is_refused() -> None:
    with pytest.raises(BadInput, match="is not inside the locus"):
        dominant_wavelength(jnp.asarray([0.3, 0.3], float), (0.7, 0.7))
