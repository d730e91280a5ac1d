"""Conversions between models of a highlight, and the errors that they are said to have."""

import re

import jax.numpy as jnp
import numpy as np
import pytest

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.reflectance import conversion
from diffshade.reflectance.conversion import (
    alpha_of,
    difference,
    exponent_of,
    normalised,
    plain,
    to_beckmann,
    to_blinn_phong,
    to_ggx,
    to_phong,
)

ROWS = re.findall(r"^\| (\w.*?) \| (\d+) \| (.*) \|$", conversion.__doc__ or "", re.M)
CONVERSIONS = {
    "Phong to Blinn-Phong": (ds.Phong, to_blinn_phong),
    "Blinn-Phong to Beckmann": (ds.BlinnPhong, to_beckmann),
    "Blinn-Phong to GGX": (ds.BlinnPhong, to_ggx),
}


@pytest.mark.parametrize(("name", "exponent", "errors"), ROWS)
def test_the_errors_that_are_stated(name: str, exponent: str, errors: str) -> None:
    kind, convert = CONVERSIONS[name]
    lobe = kind(1.0, float(exponent))
    found = difference(lobe, convert(lobe), np.radians([0, 30, 60, 80]))
    np.testing.assert_allclose(found, [float(x) for x in errors.split(" | ")], rtol=0.06)


def test_the_table_has_every_conversion() -> None:
    assert {name for name, _, _ in ROWS} == set(CONVERSIONS)


def test_four_times_the_exponent_is_the_best_factor() -> None:
    phong = ds.Phong(1.0, 100.0)
    factors = (3.0, 3.9, 4.0, 4.1, 5.0)
    errors = [float(difference(phong, ds.BlinnPhong(1.0, f * 100), 0.0)[0]) for f in factors]
    assert np.argmin(errors) == 2


def test_there_and_back(tolerance: float) -> None:
    lobe = ds.Phong((0.5, 0.2), 30.0, ds.Schlick())
    again = to_phong(to_blinn_phong(lobe))
    np.testing.assert_allclose(again.shininess, lobe.shininess, rtol=tolerance)
    assert again.weight is lobe.weight
    exponents = jnp.asarray([1.0, 30.0, 1e4])
    np.testing.assert_allclose(exponent_of(alpha_of(exponents)), exponents, rtol=10 * tolerance)
    np.testing.assert_allclose(normalised(plain(0.3, exponents), exponents), 0.3, rtol=tolerance)


def test_a_normalised_lobe_reflects_its_ks(tolerance: float) -> None:
    """The integral of (n + 2) / (2 pi) cos^n cos over the hemisphere, light from above, is 1."""
    x, w = np.polynomial.legendre.leggauss(200)
    cosine = 0.5 * (x + 1)
    for n in (1.0, 7.0, 60.0):
        whole = np.pi * np.sum(w * float(plain(1.0, n)) * cosine ** (n + 1))
        np.testing.assert_allclose(whole, 1, rtol=10 * tolerance)


def test_the_peaks_agree(tolerance: float) -> None:
    lobe = ds.BlinnPhong(0.4, 90.0)
    up = ds.GBuffer.from_arrays(None, np.tile([0.0, 0.0, 1.0], (1, 1, 1)))
    scene = ds.Scene(lights=ds.ParallelLight((0, 0, 1)))
    for convert in (to_beckmann, to_ggx):
        peak = ds.render(up, scene, ds.Material(specular=convert(lobe)))
        np.testing.assert_allclose(peak, 0.4, rtol=10 * tolerance)


def test_a_weight_of_the_incidence_is_none_of_facets() -> None:
    for convert in (to_beckmann, to_ggx):
        with pytest.raises(BadInput, match=r"a weight of n\.l, which no facet has"):
            convert(ds.BlinnPhong(0.4, 90.0, ds.Schlick()))


def test_lobes_with_channels_are_refused() -> None:
    with pytest.raises(BadInput, match="give lobes with one number each"):
        difference(ds.Phong((0.1, 0.2), 9), ds.Phong(0.1, 9), 0.0)
