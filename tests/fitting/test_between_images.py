"""Errors where the model is not the whole truth: images that disagree say how far it can be trusted."""

import json

import numpy as np
import pytest
from shared import shared_data

import diffshade as ds
import fitting
from diffshade.io.image import read_image, read_mask

GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(64, 64, 2.2))
DIRECTIONS = [
    (0.5, 0.3, 1),
    (-0.5, 0.2, 1),
    (0, -0.6, 1),
    (0.2, 0.7, 1),
    (-0.3, -0.3, 1),
    (0.6, 0, 1),
]
SCENES = [ds.Scene(lights=ds.ParallelLight(direction)) for direction in DIRECTIONS]
TRUTH = ds.Material(kd=0.6, specular=ds.Phong(ks=0.3, shininess=15.0))
EXPECTED = {"kd": 0.6, "specular.0.ks": 0.3, "specular.0.shininess": 15.0}


def images(rng: np.random.Generator, noise: float, unevenness: float) -> list[np.ndarray]:
    """With noise at each pixel, and a slow factor over each image that no model holds."""
    y, x = np.mgrid[-1:1:64j, -1:1:64j]
    waves = np.stack([np.sin(2 * x), np.cos(2 * x), np.sin(2 * y), np.cos(2 * y), x * y])
    found = []
    for scene in SCENES:
        exact = np.asarray(ds.render(GBUFFER, scene, TRUTH), np.float64)
        factor = 1 + unevenness * np.tensordot(rng.normal(size=5), waves, 1) / np.sqrt(5)
        seen = exact * factor[..., None] + rng.normal(0, noise, exact.shape)
        found.append(np.where(GBUFFER.mask[..., None], seen, 0).astype(exact.dtype))
    return found


def test_intervals_hold_where_images_disagree(rng: np.random.Generator) -> None:
    draws, held, sure = 20, dict.fromkeys(EXPECTED, 0), dict.fromkeys(EXPECTED, 0)
    for _ in range(draws):
        fit = fitting.fit(images(rng, 1e-3, 0.1), GBUFFER, SCENES)
        for name, value in EXPECTED.items():
            low, high = fit.intervals[name]
            held[name] += int(np.all((low <= value) & (value <= high)))
            # what the pixels alone would say: that every one of them errs by itself
            error = fit._uncertainty.unit_errors[name] * fit.noise
            sure[name] += int(np.all(np.abs(fit.coefficients[name] - value) <= 2 * error))
    assert min(held.values()) >= 0.75 * draws
    assert min(sure.values()) <= 0.6 * draws


def test_images_that_agree_change_nothing(rng: np.random.Generator) -> None:
    fit = fitting.fit(images(rng, 0.01, 0.0), GBUFFER, SCENES)
    for name in EXPECTED:
        alone = fit._uncertainty.unit_errors[name] * fit.noise
        np.testing.assert_allclose(fit.standard_errors[name], alone, rtol=1e-3)


def test_the_gray_sphere_is_not_told_a_confident_number() -> None:
    """Dirt and scratches leave 7 %: six photographs tell little of its faint, broad highlight."""
    folder = shared_data("uw_psm")
    circle = json.loads((folder / "circles.json").read_text())["gray"]
    lights = np.loadtxt(folder / "lights_from_chrome.txt")[::2]
    pictures = [read_image(folder / "gray" / f"gray.{k}.png").values for k in range(0, 12, 2)]
    height, width = pictures[0].shape[:2]
    camera = ds.OrthographicCamera(width, height, extent=float(width))
    center = circle["cx"] + 0.5 - width / 2, height / 2 - circle["cy"] - 0.5, 0.0
    gbuffer = ds.gbuffer(ds.Sphere(center=center, radius=circle["R"]), camera)
    row, column = np.mgrid[:height, :width]
    rim = np.hypot(column - circle["cx"], row - circle["cy"]) < 0.97 * circle["R"]
    valid = rim & read_mask(folder / "gray" / "gray.mask.png")
    observed = [picture.astype(gbuffer.normal.x.dtype) for picture in pictures]
    scenes = [ds.Scene(lights=ds.ParallelLight(light)) for light in lights]
    for robust in (None, "tukey"):
        fit = fitting.fit(
            observed,
            gbuffer,
            scenes,
            valid=valid,
            robust=robust,
            bounds={"kd": (0, None), "specular.ks": (0, None)},
        )
        assert fit.converged
        low, high = fit.intervals["specular.0.shininess"]
        assert high > 3 * low
        low, high = fit.intervals["specular.0.ks"]
        assert (high - low > 0.3 * fit.coefficients["specular.0.ks"]).all()
        assert 0.04 < fit.relative_residual < 0.08


def test_few_images_are_not_compared(rng: np.random.Generator) -> None:
    observed = images(rng, 1e-3, 0.1)[:3]
    fit = fitting.fit(observed, GBUFFER, SCENES[:3])
    alone = fit._uncertainty.unit_errors["kd"] * fit.noise
    np.testing.assert_allclose(fit.standard_errors["kd"], alone, rtol=1e-3)


def test_noise_beside_a_bound_is_no_disagreement(rng: np.random.Generator) -> None:
    """k_s rests on 0 beyond which the images pull it: no error grows by that."""
    scenes = [ds.Scene(ambient=1.0, lights=scene.lights) for scene in SCENES]
    flat = ds.Material(ka=0.2, kd=0.6, specular=ds.Phong(ks=0.0, shininess=15.0))
    widest = 0.0
    for _ in range(10):
        observed = []
        for scene in scenes:
            exact = np.array(ds.render(GBUFFER, scene, flat), np.float64)
            # The highlight is darker than nothing
            lobe = ds.Material(specular=ds.Phong(ks=0.01, shininess=15.0))
            exact -= np.asarray(ds.render(GBUFFER, scene, lobe))
            seen = exact + rng.normal(0, 0.01, exact.shape)
            observed.append(seen.astype(GBUFFER.normal.x.dtype))
        fit = fitting.fit(observed, GBUFFER, scenes)
        assert fit.coefficients["specular.0.ks"] == 0
        for name in ("ka", "kd", "specular.0.ks"):
            alone = fit._uncertainty.unit_errors[name] * fit.noise
            widest = max(widest, float(np.max(fit.standard_errors[name] / alone)))
    assert widest <= 1 + 1e-6


@pytest.mark.parametrize("robust", [None, "tukey"])
def test_images_without_noise_or_light_do_not_disagree(robust: str | None) -> None:
    """Where nothing is left, not even rounding, no error is divided by."""
    black = [np.zeros((64, 64, 1), GBUFFER.normal.x.dtype) for _ in SCENES]
    fit = fitting.fit(black, GBUFFER, SCENES, robust=robust)
    assert fit.noise == 0
    assert fit.standard_errors["kd"] == 0
    assert np.isinf(fit.standard_errors["specular.0.shininess"])
