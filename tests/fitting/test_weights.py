"""Photographs' noise: outliers, clipped pixels, noisy brightness, unknown gains, one bad image."""

import jax
import numpy as np
import pytest

import diffshade as ds
import fitting
from fitting.residual import ImageResidual
from fitting.suspects import suspects

GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(64, 64, 2.2))
LIGHTS = (
    ds.PointLight((1.0, 1.0, 2.0)),
    ds.PointLight((-1.5, 1.0, 2.5), 1.2),
    ds.PointLight((0.2, -1.5, 2.0), 0.8),
)
SCENE = ds.Scene(ambient=1.0, lights=LIGHTS)
TRUTH = ds.Material(ka=0.12, kd=0.6, specular=ds.Phong(ks=0.4, shininess=40.0))
IMAGE = np.asarray(ds.render(GBUFFER, SCENE, TRUTH))
EXPECTED = {"ka": 0.12, "kd": 0.6, "specular.0.ks": 0.4, "specular.0.shininess": 40.0}
NOISE = 0.01


def noisy(seed: int, sigma: float = NOISE) -> np.ndarray:
    drawn = np.random.default_rng(seed).normal(0, sigma, IMAGE.shape)
    return (IMAGE + drawn).astype(IMAGE.dtype)


def deviations(fit: fitting.Fit) -> dict[str, float]:
    """Errors in standard errors."""
    return {
        name: float(np.ravel(fit.coefficients[name] - truth)[0])
        / float(np.ravel(fit.standard_errors[name])[0])
        for name, truth in EXPECTED.items()
    }


@pytest.mark.slow
def test_outliers_lose_their_weight() -> None:
    """A tenth of the pixels in an unmodelled shadow: least squares is far off, Tukey is not."""
    image = noisy(0)
    shadow = (np.random.default_rng(1).random(image.shape[:2]) < 0.1) & GBUFFER.mask
    image[shadow] *= 0.2
    plain = fitting.fit(image, GBUFFER, SCENE)
    assert abs(plain.coefficients["kd"][0] - 0.6) > 0.03
    robust = fitting.fit(image, GBUFFER, SCENE, robust="tukey")
    assert robust.converged
    assert max(map(abs, deviations(robust).values())) < 3.5, deviations(robust)
    np.testing.assert_allclose(robust.noise, NOISE, rtol=0.25)  # not that of the shadow
    # The figures stand side by side: over all pixels, and weighted.
    assert robust.weighted_residual is not None
    assert robust.relative_residual > 10 * robust.weighted_residual
    again = fitting.evaluate(robust.material, image, GBUFFER, SCENE)
    assert robust.relative_residual == pytest.approx(again.relative_residual, rel=1e-4)


def test_without_outliers_tukey_is_nearly_least_squares() -> None:
    plain = fitting.fit(noisy(2), GBUFFER, SCENE)
    robust = fitting.fit(noisy(2), GBUFFER, SCENE, robust=fitting.Tukey())
    for name, truth in EXPECTED.items():
        error = float(np.ravel(plain.standard_errors[name])[0])
        apart = float(np.ravel(robust.coefficients[name] - plain.coefficients[name])[0])
        assert abs(apart) < error, (name, truth)


def test_clipped_pixels_say_at_least() -> None:
    """The highlight is clipped: as they stand they spoil k_s and n, as censored they do not."""
    image = noisy(3)
    level = np.quantile(image[GBUFFER.mask], 0.97)
    clipped = image >= level
    image = np.where(clipped, level, image).astype(image.dtype)
    naive = fitting.fit(image, GBUFFER, SCENE)
    assert abs(naive.coefficients["specular.0.ks"][0] - 0.4) > 0.1
    fit = fitting.fit(image, GBUFFER, SCENE, clipped=clipped)
    assert fit.converged
    assert max(map(abs, deviations(fit).values())) < 3.5, deviations(fit)
    left_out = fitting.fit(image, GBUFFER, SCENE, valid=~clipped[..., 0])
    # What they say is more than nothing, and they are not in the figure.
    assert fit.standard_errors["specular.0.ks"][0] < left_out.standard_errors["specular.0.ks"][0]
    assert fit.fraction_excluded == left_out.fraction_excluded


def test_masks_in_which_nothing_is_clipped_cost_nothing() -> None:
    """No weights, and so none that follow: the fit is that without masks."""
    plain = fitting.fit(noisy(2), GBUFFER, SCENE)
    masked = fitting.fit(noisy(2), GBUFFER, SCENE, clipped=np.zeros(IMAGE.shape, bool))
    assert masked.weighted_residual is None
    assert masked.steps == plain.steps


def test_noise_that_grows_with_brightness_is_weighed() -> None:
    """With the shininess held it is weighted linear least squares: NumPy's, at the weights found."""
    sensor = fitting.SensorNoise(read=0.002, gain=4e-4)
    spread = np.sqrt(0.002**2 + 4e-4 * np.maximum(IMAGE, 0))
    image = IMAGE + np.random.default_rng(4).normal(0, 1, IMAGE.shape) * spread
    image = image.astype(IMAGE.dtype)
    fit = fitting.fit(
        image, GBUFFER, SCENE, material=TRUTH, hold=["specular.shininess"], noise=sensor
    )
    lobe = ds.Phong(ks=1.0, shininess=40.0)
    parts = (ds.Material(ka=1.0), ds.Material(kd=1.0), ds.Material(specular=lobe))
    columns = [np.asarray(ds.render(GBUFFER, SCENE, part), float) for part in parts]
    a = np.stack([column[GBUFFER.mask][:, 0] for column in columns], axis=1)
    k = np.ravel([fit.coefficients[name][0] for name in ("ka", "kd", "specular.0.ks")])
    weight = 1 / np.sqrt(0.002**2 + 4e-4 * (a @ k))
    y = np.asarray(image, float)[GBUFFER.mask][:, 0]
    expected = np.linalg.lstsq(a * weight[:, None], y * weight, rcond=None)[0]
    np.testing.assert_allclose(k, expected, rtol=1e-4)
    plain = np.linalg.lstsq(a, y, rcond=None)[0]
    assert np.abs(k / plain - 1).max() > 1e-3  # which the weights change
    np.testing.assert_allclose(fit.noise, 0.002, rtol=0.05)  # that of darkness


def several(gains: np.ndarray) -> tuple[list[np.ndarray], list[ds.Scene]]:
    """One image a light, each as bright as its gain says, and the scenes without the gains."""
    rng = np.random.default_rng(5)
    images, scenes = [], []
    for k, gain in enumerate(gains):
        light = LIGHTS[k % len(LIGHTS)]
        position = np.asarray(light.position) + rng.normal(0, 0.2, 3)
        scenes.append(ds.Scene(ambient=1.0, lights=ds.PointLight(tuple(position), light.intensity)))
        brighter = ds.PointLight(tuple(position), float(light.intensity) * float(gain))
        image = np.asarray(ds.render(GBUFFER, ds.Scene(1.0, (brighter,)), TRUTH))
        images.append((image + rng.normal(0, 0.002, image.shape)).astype(image.dtype))
    return images, scenes


def test_gains_of_lights_are_found() -> None:
    gains = np.array([1.1, 0.9, 1.05, 0.8, 1.2, 0.95])
    gains /= gains.mean()
    images, scenes = several(gains)
    fit = fitting.fit(images, GBUFFER, scenes, gains=True)
    assert fit.converged
    np.testing.assert_allclose(fit.gains, gains, rtol=2e-3)
    assert max(map(abs, deviations(fit).values())) < 4, deviations(fit)
    # They are in the scenes that come back, and cost precision.
    again = fitting.evaluate(fit.material, images, GBUFFER, fit.scene)
    assert again.relative_residual == pytest.approx(fit.relative_residual, rel=1e-4)
    known = fitting.fit(images, GBUFFER, fit.scene)
    assert known.standard_errors["kd"][0] < fit.standard_errors["kd"][0]


def test_a_bad_image_among_many_is_named() -> None:
    images, scenes = several(np.ones(8))
    assert fitting.fit(images, GBUFFER, scenes).suspect_images == ()
    images[5] = images[5][:, ::-1].copy()  # its light came from the other side
    found = fitting.fit(images, GBUFFER, scenes).suspect_images
    assert [item.image for item in found] == [5]
    assert "check its light" in found[0].reason


def test_few_images_and_equal_ones_are_not_suspect() -> None:
    def residuals(*values: float) -> list[ImageResidual]:
        return [ImageResidual(value, 10, 0) for value in values]

    assert suspects(residuals(0.01, 0.01, 5.0)) == ()
    assert suspects(residuals(*[0.02] * 8)) == ()
    assert suspects(residuals(*[0.0] * 8)) == ()
    assert [s.image for s in suspects(residuals(0.01, 0.011, 0.5, 0.009, 0.012, 0.01))] == [2]


@pytest.mark.parametrize("numbers", [(0.0, 0.1, 0.0), (-1.0, 0.0, 0.0), (0.1, -1.0, 0.0)])
def test_noise_without_darkness_is_refused(numbers: tuple[float, float, float]) -> None:
    with pytest.raises(ds.BadInput, match="read or step"):
        fitting.SensorNoise(*numbers)


def test_another_solver_finds_the_same() -> None:
    import optimistix as optx

    tight = 1e-10 if jax.config.jax_enable_x64 else 1e-5
    plain = fitting.fit(IMAGE, GBUFFER, SCENE, solver=optx.LevenbergMarquardt(tight, tight))
    np.testing.assert_allclose(plain.material.specular[0].shininess, 40.0, rtol=1e-3)


def test_darkness_is_no_noise() -> None:
    """More than half of the pixels unlit and exactly 0: what is lit says how strong the noise is."""
    sphere = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(64, 64, 2.2))
    scene = ds.Scene(lights=ds.ParallelLight((1, 0, -0.3)))
    exact = np.asarray(ds.render(sphere, scene, ds.Material(kd=0.6, specular=ds.Phong(0.2, 5.0))))
    noise = np.random.default_rng(0).normal(0, 0.01, exact.shape) * (exact > 0)
    fit = fitting.fit(exact + noise.astype(exact.dtype), sphere, scene, robust="tukey")
    assert np.count_nonzero(exact[sphere.mask]) < 0.5 * np.count_nonzero(sphere.mask)
    np.testing.assert_allclose(fit.noise, 0.01, rtol=0.1)
    np.testing.assert_allclose(fit.coefficients["kd"], 0.6, rtol=0.05)
