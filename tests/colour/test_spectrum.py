"""Integrals over spectra, against closed forms and published constants; X, Y, Z by colour-science."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diffshade.colour.cie import xyz_to_xyy
from diffshade.colour.munsell import munsell_to_xyy
from diffshade.colour.observer import (
    OBSERVER,
    illuminant,
    luminance,
    spectral_locus,
    spectrum_to_xyz,
    standard_observer,
    tables,
)
from diffshade.colour.spectrum import blackbody, sensor_response, trapezoid
from diffshade.errors import BadInput

FINE = np.arange(360.0, 831.0, 1.0)
USUAL = np.arange(380.0, 781.0, 5.0)


def test_a_sensor_integrates_what_is_linear_exactly(tolerance: float) -> None:
    """The integral of (λ - 400) from 400 to 700 is 45,000, whatever the steps."""
    wavelengths = np.array([400.0, 410.0, 475.0, 600.0, 700.0])
    ramp = jnp.asarray(wavelengths - 400, float)
    found = sensor_response(ramp, np.ones((5, 1)), wavelengths)
    np.testing.assert_allclose(found, [45_000], rtol=tolerance)


def test_light_times_reflectance_meets_each_sensitivity(tolerance: float) -> None:
    """Of an image, and in the shape of one: bands that do not overlap see their own light only."""
    bands = np.kron(np.eye(3), np.ones((4, 1)))
    image = jnp.ones((2, 5, 12)) * jnp.asarray(bands @ [1.0, 2.0, 3.0], float).reshape(1, 1, 12)
    found = sensor_response(image, bands, np.arange(12.0))
    assert found.shape == (2, 5, 3)
    np.testing.assert_allclose(found[1, 3], [3.5, 8.0, 10.5], rtol=tolerance)


@pytest.mark.parametrize(
    ("name", "xy"),
    [
        ("A", (0.44758, 0.40745)),
        ("C", (0.31006, 0.31616)),
        ("D50", (0.34567, 0.35850)),
        ("D65", (0.31272, 0.32903)),
        ("E", (1 / 3, 1 / 3)),
    ],
)
def test_whites_of_illuminants(name: str, xy: tuple[float, float]) -> None:
    """CIE 15:2004, table T.3."""
    power = jnp.asarray(illuminant(name, USUAL), float)
    found = xyz_to_xyy(spectrum_to_xyz(power, USUAL))
    np.testing.assert_allclose(found[:2], xy, atol=3e-5)


@pytest.mark.parametrize(
    ("wavelength", "xy"),
    [
        (400, (0.1733, 0.0048)),
        (450, (0.1566, 0.0177)),
        (500, (0.0082, 0.5384)),
        (520, (0.0743, 0.8338)),
        (550, (0.3016, 0.6923)),
        (600, (0.6270, 0.3725)),
        (650, (0.7260, 0.2740)),
    ],
)
def test_pure_light_is_on_the_locus(wavelength: int, xy: tuple[float, float]) -> None:
    """CIE 15:2004, table T.4; by the table of the locus, and as a spectrum of one line."""
    wavelengths, locus = spectral_locus()
    np.testing.assert_allclose(locus[wavelengths == wavelength][0], xy, atol=5.1e-5)
    line = jnp.asarray(wavelength == FINE, float)
    np.testing.assert_allclose(xyz_to_xyy(spectrum_to_xyz(line, FINE))[:2], xy, atol=5.1e-5)


@pytest.mark.parametrize("name", ["A", "D65"])
def test_the_reflectances_of_a_chart_are_those_of_colour_science(
    name: str, tolerance: float
) -> None:
    """24 patches, by its own sum over steps of 10 nm: a trapezoid, where nothing is beyond the ends."""
    colour = tables()
    shape = colour.SpectralShape(380, 730, 10)
    matching = colour.MSDS_CMFS[OBSERVER].copy().align(shape)
    light = colour.SDS_ILLUMINANTS[name].copy().align(shape)
    chart = colour.SDS_COLOURCHECKERS["BabelColor Average"]
    expected = [colour.sd_to_XYZ(chart[p], matching, light, method="Integration") for p in chart]

    wavelengths = np.arange(370.0, 741.0, 10.0)
    shining = illuminant(name, wavelengths) * (wavelengths > 370) * (wavelengths < 740)
    patches = np.pad(np.stack([chart[p].values for p in chart]), ((0, 0), (1, 1)))
    found = spectrum_to_xyz(jnp.asarray(patches * shining, float), wavelengths, white=shining)
    np.testing.assert_allclose(100 * found, expected, atol=1000 * tolerance)


def test_a_perfect_reflector_has_the_white_of_its_light(tolerance: float) -> None:
    light = jnp.asarray(illuminant("A", USUAL), float)
    half = spectrum_to_xyz(0.5 * light, USUAL, white=light)
    np.testing.assert_allclose(half[1], 0.5, rtol=tolerance)
    np.testing.assert_array_equal(spectrum_to_xyz(0 * light, USUAL, white=0 * light), 0)


def test_the_candela_of_1948() -> None:
    """A black body at the freezing point of platinum, 2042 K, had 600,000 cd/m^2 by definition."""
    found = luminance(blackbody(jnp.asarray(2042.0), FINE), FINE)
    np.testing.assert_allclose(found, 6e5, rtol=3e-3)
    # By the table, the efficacy of light of equal energy is 683 x 106.857 nm.
    np.testing.assert_allclose(luminance(jnp.ones(FINE.size), FINE), 683 * 106.857, rtol=1e-5)


def test_black_bodies() -> None:
    """All of their radiance is σ T^4 / π; illuminant A has the shape of one of 2856 K."""
    wide = np.geomspace(50.0, 3e5, 4000)
    for kelvin in (2000.0, 6000.0):
        found = sensor_response(blackbody(jnp.asarray(kelvin), wide), np.ones((4000, 1)), wide)
        np.testing.assert_allclose(np.pi * found, [5.670374419e-8 * kelvin**4], rtol=2e-5)
    lamp = blackbody(jnp.asarray(2856.0), USUAL)
    np.testing.assert_allclose(100 * lamp / lamp[36], illuminant("A", USUAL), rtol=2e-3)


def test_the_temperature_of_a_black_body_is_found_by_its_slope(tolerance: float) -> None:
    """d log B / d log T = x / (1 - exp(-x)) with x = h c / (λ k T), 8.99 at 560 nm and 2856 K."""
    one = np.array([560.0])
    slope = jax.grad(lambda t: jnp.log(blackbody(t, one)[0]))(jnp.asarray(2856.0)) * 2856
    x = 1.438776877e7 / 560 / 2856
    np.testing.assert_allclose(slope, x / -np.expm1(-x), rtol=max(1e-9, 10 * tolerance))


def test_the_observer_is_dark_outside_its_table() -> None:
    np.testing.assert_array_equal(standard_observer(np.array([300.0, 359.0, 831.0])), 0)
    assert standard_observer(FINE)[:, 1].max() == 1


def test_what_is_no_spectrum_is_refused() -> None:
    for wavelengths in ([400.0], [400.0, 400.0], [500.0, 400.0]):
        with pytest.raises(BadInput, match="give them in nm, rising"):
            trapezoid(np.array(wavelengths))
    with pytest.raises(BadInput, match="'D66': give one of A, B, C"):
        illuminant("D66", USUAL)
    with pytest.raises(BadInput, match="outside 300 to 780 nm, the table of illuminant D65"):
        illuminant("D65", FINE)


def test_without_the_extra_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "colour", None)
    tables.cache_clear()
    try:
        for asked in (lambda: illuminant("A", USUAL), lambda: munsell_to_xyy("N5")):
            with pytest.raises(BadInput, match=r"pip install 'diffshade\[colour\]'"):
                asked()
    finally:
        tables.cache_clear()
