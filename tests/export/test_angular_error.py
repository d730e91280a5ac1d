"""The error of an export over angles, and the radiance that it compares."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import diffshade as ds
from diffshade.export.angular_error import angular_error
from diffshade.export.response import Exact
from diffshade.reflectance.conversion import difference, to_blinn_phong
from diffshade.vector import Vec3

MATERIALS = {
    "two lobes and colours": ds.Material(
        0.1,
        (0.5, 0.4, 0.3),
        (ds.Phong(0.3, 32), ds.GGX(0.2, 0.2, ds.Schlick())),
        od=(0.9, 0.8, 0.7),
        os=(0.5, 0.6, 0.7),
    ),
    "plastic": ds.Material(kd=0.4, specular=ds.GGX(0.8, 0.1), body=ds.FresnelBody()),
}


@pytest.mark.parametrize("name", MATERIALS)
def test_the_radiance_is_that_of_render(name: str, tolerance: float) -> None:
    l: Any = np.array([[0.3, -0.2, 0.9], [-0.6, 0.0, 0.8], [0.0, 0.1, 0.2]])
    v: Any = np.array([[-0.2, 0.3, 0.9], [0.6, 0.05, 0.8], [0.9, 0.0, 0.1]])
    l, v = (d / np.linalg.norm(d, axis=1, keepdims=True) for d in (l, v))
    found = np.stack(Exact(MATERIALS[name])(*(Vec3.from_array(jnp.asarray(d)) for d in (l, v))))
    for k in range(3):
        up = ds.GBuffer.from_arrays(None, np.tile([0.0, 0.0, 1.0], (1, 1, 1)), view=v[k])
        scene = ds.Scene(lights=ds.ParallelLight(l[k]))
        image = np.asarray(ds.render(up, scene, MATERIALS[name]))[0, 0]
        np.testing.assert_allclose(found[:, k], image, rtol=100 * tolerance, atol=tolerance)


def test_a_share_of_the_whole_is_found_as_it_is() -> None:
    found = angular_error(Exact(ds.Material(kd=0.5)), Exact(ds.Material(kd=0.6)), (0.0, 80.0))
    np.testing.assert_allclose(found.relative_rms, 0.2, rtol=1e-5)
    np.testing.assert_allclose(found.largest, 0.2, rtol=1e-5)
    assert found.incidence == (0.0, 80.0)


def test_the_norm_by_another_quadrature() -> None:
    """Light from above: cos^n theta less cos^(4n) of half the angle, by Gauss and Legendre."""
    n = 20.0
    lobe = ds.Phong(0.5, n)
    found = angular_error(
        Exact(ds.Material(specular=lobe)), Exact(ds.Material(specular=to_blinn_phong(lobe))), (0.0,)
    )
    x, w = np.polynomial.legendre.leggauss(400)
    theta = np.pi / 4 * (x + 1)
    phong, blinn = np.cos(theta) ** n, np.cos(theta / 2) ** (4 * n)
    difference2, whole = (np.sum(w * np.sin(theta) * f**2) for f in (phong - blinn, phong))
    np.testing.assert_allclose(found.relative_rms[0], np.sqrt(difference2 / whole), rtol=1e-3)


def test_the_largest_is_that_of_the_conversions() -> None:
    lobe = ds.Phong(1.0, 100.0)
    found = angular_error(
        Exact(ds.Material(specular=lobe)), Exact(ds.Material(specular=to_blinn_phong(lobe)))
    )
    expected = difference(lobe, to_blinn_phong(lobe), np.radians(found.incidence))
    np.testing.assert_allclose(found.largest, expected, rtol=0.01, atol=1e-5)


def test_narrow_lobes_are_seen() -> None:
    """Of exponent 10,000, against a grid of four times as many directions."""
    lobes = ds.Phong(0.3, 1e4), ds.BlinnPhong(0.3, 4e4)
    pair = [Exact(ds.Material(specular=lobe)) for lobe in lobes]
    coarse, fine = (angular_error(*pair, (30.0, 60.0), steps=n) for n in (192, 768))
    np.testing.assert_allclose(coarse.relative_rms, fine.relative_rms, rtol=0.01)
    np.testing.assert_allclose(coarse.largest, fine.largest, rtol=0.01)


def test_nothing_has_no_error() -> None:
    black = Exact(ds.Material(kd=0.0))
    assert angular_error(black, black, (0.0,)).relative_rms == (0.0,)
    assert len(angular_error(black, black).lines()) == 3
