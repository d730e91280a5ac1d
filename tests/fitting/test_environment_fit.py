"""Fits under an environment: coefficients come back, with errors that tell how far."""

from typing import Any

import jax
import numpy as np
import pytest
from map_cases import GBUFFER, KD, KS, PIXELS, N

import diffshade as ds
import fitting
from diffshade.errors import BadInput


def environment(order: int = 3) -> ds.EnvironmentLight:
    """A sky that is bright to one side."""
    c = 0.2 * np.random.default_rng(8).normal(size=((order + 1) ** 2, 3))
    c[0], c[3] = (1.0, 1.1, 1.4), (0.5, 0.4, 0.3)
    return ds.EnvironmentLight(c)


SKY = environment()
SCENE = ds.Scene(0.2, (SKY, ds.PointLight((1.0, 1.5, 3.0), 0.9)))
TRUTH = ds.Material(ka=0.3, kd=(0.4, 0.3, 0.2), specular=ds.Phong((0.3, 0.25, 0.2), 18.0))
EXPECTED = {
    "ka": (0.3,) * 3,
    "kd": (0.4, 0.3, 0.2),
    "specular.0.ks": (0.3, 0.25, 0.2),
    "specular.0.shininess": 18.0,
}


def test_coefficients_come_back() -> None:
    """Exactly, from no start; and with noise within their standard errors."""
    image = np.asarray(ds.render(GBUFFER, SCENE, TRUTH), float)
    exact = fitting.fit(image, GBUFFER, SCENE, certify=True)
    allowed = 1e-6 if jax.config.jax_enable_x64 else 1e-3
    for name, value in EXPECTED.items():
        np.testing.assert_allclose(exact.coefficients[name], value, rtol=allowed, err_msg=name)
    assert exact.unidentified == ()
    assert exact.certificate is not None
    assert not exact.certificate.proven
    assert "does not fall convexly" in exact.certificate.reason
    noise = 0.003 * np.random.default_rng(1).normal(size=image.shape)
    fit = fitting.fit(image + noise, GBUFFER, SCENE)
    ratios = [
        (fit.coefficients[name] - np.asarray(value)) / fit.standard_errors[name]
        for name, value in EXPECTED.items()
    ]
    z = np.concatenate([np.ravel(x) for x in ratios])
    assert np.abs(z).max() < 3.5
    assert 0.3 < np.sqrt(np.mean(z**2)) < 1.7


@pytest.mark.slow
def test_an_environment_alone_and_of_unknown_strength() -> None:
    """Three skies, each turned and dimmed; the gains come back too."""
    rng = np.random.default_rng(4)
    gains = np.array([0.8, 1.1, 1.1])
    scenes, images = [], []
    for gain in gains:
        harmonics = np.asarray(SKY.harmonics, float) * rng.choice((-1, 1), size=(16, 1))
        harmonics[0] = SKY.harmonics[0]
        scenes.append(ds.Scene(lights=ds.EnvironmentLight(harmonics)))
        lit = ds.Scene(lights=ds.EnvironmentLight(harmonics, gain))
        images.append(np.asarray(ds.render(GBUFFER, lit, TRUTH)))
    fit = fitting.fit(images, GBUFFER, scenes, gains=True)
    allowed = 1e-5 if jax.config.jax_enable_x64 else 5e-3
    np.testing.assert_allclose(fit.gains, gains, rtol=allowed)
    for name in ("kd", "specular.0.ks", "specular.0.shininess"):
        np.testing.assert_allclose(fit.coefficients[name], EXPECTED[name], rtol=allowed)
    relit = fit.scene[0].lights[0]
    np.testing.assert_allclose(relit.intensity, gains[0], rtol=allowed)


def test_an_even_sky_is_ambient_light() -> None:
    """k_a I_a and k_d pi L look alike, and are said to."""
    scene = ds.Scene(0.5, ds.EnvironmentLight([2.0]))
    material = ds.Material(ka=0.3, kd=0.5)
    image = ds.render(GBUFFER, scene, material)
    fit = fitting.fit(image, GBUFFER, scene, material=material)
    assert {name for group in fit.unidentified for name in group.coefficients} == {"ka", "kd"}


@pytest.mark.slow
@pytest.mark.parametrize("steps", [None, 4])
def test_maps(steps: int | None) -> None:
    """A material for every pixel, under lamps and a sky, which some images lack."""
    rng = np.random.default_rng(2)
    lamps = rng.normal(size=(16, 3)) + np.array([0, 0, 1.5])
    scenes = [
        ds.Scene(lights=(ds.ParallelLight(d), *((SKY,) if k % 2 else ())))
        for k, d in enumerate(lamps)
    ]
    truth = ds.Material(
        kd=rng.uniform(0.1, 0.9, (3, PIXELS)),
        specular=ds.Phong(
            ks=rng.uniform(0.2, 0.9, (3, PIXELS)), shininess=rng.uniform(3, 30, (1, PIXELS))
        ),
    )
    images = [np.asarray(ds.render(GBUFFER, scene, truth)) for scene in scenes]
    options: dict[str, Any] = {} if steps is None else {"steps": steps}
    maps = fitting.fit_maps(images, GBUFFER, scenes, **options)
    found = maps.coefficients
    allowed = 1e-3 if jax.config.jax_enable_x64 else 2e-2
    for name, value in (
        (KD, truth.kd),
        (KS, truth.specular[0].ks),
        (N, truth.specular[0].shininess),
    ):
        error = np.abs(np.asarray(found[name], float) / np.asarray(value, float) - 1)
        assert np.median(error) < allowed, name


def test_what_asks_for_rays_is_refused() -> None:
    image = ds.render(GBUFFER, SCENE, TRUTH)
    blinn = ds.Material(kd=0.5, specular=ds.BlinnPhong(0.5, 30.0))
    with pytest.raises(BadInput, match="a BlinnPhong, and an EnvironmentLight"):
        fitting.fit(image, GBUFFER, SCENE, material=blinn)
