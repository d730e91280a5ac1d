"""What `fit` promises: holding, bounds, errors that mean something, refusals in one line."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import diffshade as ds
import fitting
from fitting.gauge import ReferenceAttenuation

GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(64, 64, 2.2))
SCENE = ds.Scene(
    ambient=0.5, lights=(ds.PointLight((0.8, 0.5, 2.5)), ds.PointLight((-1.0, 0.8, 2.0), 0.7))
)
TRUTH = ds.Material(ka=0.1, kd=(0.6, 0.4, 0.2), specular=ds.Phong(ks=0.3, shininess=25.0))
IMAGE = np.asarray(ds.render(GBUFFER, SCENE, TRUTH))


def noisy(sigma: float, seed: int) -> np.ndarray:
    return IMAGE + np.random.default_rng(seed).normal(0, sigma, IMAGE.shape).astype(IMAGE.dtype)


def test_held_coefficients_keep_their_value() -> None:
    start = ds.Material(ka=0.13, kd=0.5, specular=ds.Phong(ks=0.3, shininess=20.0))
    fit = fitting.fit(IMAGE, GBUFFER, SCENE, material=start, hold=("ka", "specular.shininess"))
    np.testing.assert_allclose(fit.material.ka, 0.13, rtol=1e-6)
    np.testing.assert_allclose(fit.material.specular[0].shininess, 20.0, rtol=1e-6)
    assert set(fit.standard_errors) == {"kd", "specular.0.ks"}
    everything = ("ka", "kd", "specular.ks", "specular.shininess")
    fit = fitting.fit(IMAGE, GBUFFER, SCENE, material=TRUTH, hold=everything)
    assert fit.relative_residual < 1e-6
    assert not fit.standard_errors


def test_holding_kd_gives_the_attenuation_its_scale() -> None:
    """c0, c1, c2 share a scale with k_d and k_s; with k_d known they are themselves."""
    law = ds.QuadraticAttenuation(1.6, 0.3, 0.2)
    lights = tuple(ds.PointLight(light.position, light.intensity, law) for light in SCENE.lights)
    scene = ds.Scene(ambient=0.5, lights=(*lights, ds.PointLight((0, -1, 4), 1.5, law)))
    image = ds.render(GBUFFER, scene, TRUTH)
    fit = fitting.fit(
        image, GBUFFER, scene, material=TRUTH, hold=["kd"], attenuation=ds.QuadraticAttenuation
    )
    found = [float(fit.coefficients[f"attenuation.c{k}"]) for k in range(3)]
    allowed = 1e-6 if jax.config.jax_enable_x64 else 5e-3
    np.testing.assert_allclose(found, (1.6, 0.3, 0.2), rtol=allowed)
    np.testing.assert_allclose(fit.material.specular[0].ks, 0.3, rtol=allowed)
    assert fit.unidentified == ()


def test_bounds_hold_and_can_be_opened() -> None:
    bright = ds.Material(ka=0.1, kd=1.4, specular=ds.Phong(ks=0.3, shininess=25.0))
    image = ds.render(GBUFFER, SCENE, bright)
    fit = fitting.fit(image, GBUFFER, SCENE)
    np.testing.assert_array_equal(fit.material.kd, 1.0)
    fit = fitting.fit(image, GBUFFER, SCENE, bounds={"kd": (0, None)})
    np.testing.assert_allclose(fit.material.kd, 1.4, rtol=1e-4)
    fit = fitting.fit(IMAGE, GBUFFER, SCENE, bounds={"specular.shininess": (30, 50)})
    np.testing.assert_allclose(fit.material.specular[0].shininess, 30, rtol=1e-6)


def test_a_coefficient_of_zero_is_found_to_be_zero() -> None:
    dark = ds.Material(ka=0.0, kd=0.5, specular=ds.Phong(ks=0.3, shininess=25.0))
    image = np.asarray(ds.render(GBUFFER, SCENE, dark))
    image = image + np.random.default_rng(0).normal(0, 1e-3, image.shape).astype(image.dtype)
    fit = fitting.fit(image, GBUFFER, SCENE)
    assert np.all(np.asarray(fit.material.ka) >= 0)
    assert np.all(np.asarray(fit.material.ka) < 1e-3)
    assert "ka" not in {name for item in fit.unidentified for name in item.coefficients}


@pytest.mark.slow
def test_standard_errors_cover_the_truth() -> None:
    """Over 60 noisy captures, the errors in units of their standard errors have mean square 1."""
    deviations = []
    for seed in range(60):
        fit = fitting.fit(noisy(0.01, seed), GBUFFER, SCENE)
        deviations.append(
            [
                (float(fit.coefficients["ka"][0]) - 0.1) / fit.standard_errors["ka"][0],
                (float(fit.coefficients["kd"][1]) - 0.4) / fit.standard_errors["kd"][1],
                (float(fit.coefficients["specular.0.ks"][2]) - 0.3)
                / fit.standard_errors["specular.0.ks"][2],
                (float(fit.coefficients["specular.0.shininess"]) - 25)
                / fit.standard_errors["specular.0.shininess"],
            ]
        )
    mean_square = np.mean(np.square(deviations), axis=0)
    # 60 draws of a chi-square with one degree of freedom: 1 +- 3 * sqrt(2 / 60)
    assert np.all(mean_square > 0.45), mean_square
    assert np.all(mean_square < 1.55), mean_square
    np.testing.assert_allclose(fit.noise, 0.01, rtol=0.05)


def test_pixels_that_are_not_valid_do_not_count() -> None:
    spoiled = IMAGE.copy()
    spoiled[10:30, 10:40] = 7.0
    valid = np.ones(IMAGE.shape[:2], bool)
    valid[10:30, 10:40] = False
    fit = fitting.fit(spoiled, GBUFFER, SCENE, valid=valid)
    np.testing.assert_allclose(fit.material.specular[0].shininess, 25.0, rtol=1e-3)
    assert fit.relative_residual < 1e-5
    assert fit.fraction_excluded == pytest.approx(
        (GBUFFER.mask & ~valid).sum() / GBUFFER.mask.sum(), rel=1e-9
    )


def test_what_one_image_cannot_tell_is_named() -> None:
    def named(fit: fitting.Fit) -> set[str]:
        return {name for item in fit.unidentified for name in item.coefficients}

    matte = ds.render(GBUFFER, SCENE, ds.Material(ka=0.1, kd=0.5))
    fit = fitting.fit(matte, GBUFFER, SCENE)
    assert "specular.0.shininess" in named(fit)
    # A light from behind shows neither diffuse nor specular reflection.
    behind = ds.Scene(ambient=0.5, lights=ds.ParallelLight((0, 0, -1)))
    fit = fitting.fit(ds.render(GBUFFER, behind, TRUTH), GBUFFER, behind)
    assert {"kd", "specular.0.ks", "specular.0.shininess"} <= named(fit)
    assert "ka" not in named(fit)
    assert all("\n" not in item.reason for item in fit.unidentified)
    assert np.isinf(fit.standard_errors["kd"]).all()
    # And from in front of everything, all is told.
    assert fitting.fit(IMAGE, GBUFFER, SCENE).unidentified == ()


def test_object_colours_are_part_of_the_model() -> None:
    """k_d O_d is what is seen; O_d is known."""
    coloured = ds.Material(
        ka=0.1, kd=0.6, specular=ds.Phong(0.3, 25.0), od=(0.5, 0.4, 0.9), os=(0.9, 0.5, 0.2)
    )
    image = ds.render(GBUFFER, SCENE, coloured)
    fit = fitting.fit(image, GBUFFER, SCENE, material=coloured)
    np.testing.assert_allclose(fit.material.kd, 0.6, rtol=1e-4)
    np.testing.assert_allclose(fit.material.specular[0].ks, 0.3, rtol=1e-4)
    assert fit.relative_residual < 1e-5


@pytest.mark.slow
def test_constants_can_be_held() -> None:
    """Holding c1 = 0 leaves the scale free; holding c0 sets it."""
    truth = ds.QuadraticAttenuation(1.6, 0.0, 0.2)
    lights = tuple(ds.PointLight(light.position, light.intensity, truth) for light in SCENE.lights)
    scene = ds.Scene(ambient=0.5, lights=lights)
    image = ds.render(GBUFFER, scene, TRUTH)
    allowed = 1e-5 if jax.config.jax_enable_x64 else 1e-2
    unknown = ds.QuadraticAttenuation
    fit = fitting.fit(image, GBUFFER, scene, attenuation=unknown, hold=["attenuation.c1"])
    assert float(fit.coefficients["attenuation.c1"]) == 0
    ratio = fit.coefficients["attenuation.c2"] / fit.coefficients["attenuation.c0"]
    np.testing.assert_allclose(ratio, 0.2 / 1.6, rtol=allowed)
    fit = fitting.fit(image, GBUFFER, scene, attenuation=unknown, hold=["attenuation.c0"])
    np.testing.assert_allclose(fit.coefficients["attenuation.c0"], 1.6, rtol=1e-6)
    np.testing.assert_allclose(fit.coefficients["attenuation.c2"], 0.2, rtol=allowed)
    np.testing.assert_allclose(fit.material.kd, (0.6, 0.4, 0.2), rtol=allowed)
    assert "attenuation.c0" not in fit.standard_errors
    assert fit.unidentified == ()


def test_bounds_of_zero_hold_with_a_fitted_attenuation() -> None:
    fit = fitting.fit(
        IMAGE,
        GBUFFER,
        SCENE,
        attenuation=ds.QuadraticAttenuation,
        bounds={"specular.ks": (0, 0)},
    )
    np.testing.assert_array_equal(fit.material.specular[0].ks, 0)


@pytest.mark.slow
def test_a_law_that_is_clamped_everywhere_is_named() -> None:
    """Lights that are three times as strong as the scene says, beside a k_d that is known: f is 1."""
    lights = tuple(ds.PointLight(light.position, 3 * light.intensity) for light in SCENE.lights)
    image = ds.render(GBUFFER, ds.Scene(ambient=0.5, lights=lights), TRUTH)
    fit = fitting.fit(
        image, GBUFFER, SCENE, material=TRUTH, hold=["kd"], attenuation=ds.QuadraticAttenuation
    )
    clamped = [item for item in fit.unidentified if "clamped at 1 at every" in item.reason]
    assert clamped[0].coefficients == ("attenuation.c0", "attenuation.c1", "attenuation.c2")


@pytest.mark.float64
def test_a_surface_in_single_precision_under_64_bits() -> None:
    """The fit is in the surface's precision, whatever images and lights came in."""
    single = jax.tree.map(lambda x: x.astype(np.float32) if x.dtype == np.float64 else x, GBUFFER)
    with jax.numpy_dtype_promotion("standard"):  # the images that it renders are of both
        fit = fitting.fit(IMAGE, single, SCENE)
    np.testing.assert_allclose(fit.material.specular[0].shininess, 25.0, rtol=1e-3)


def test_attenuation_of_a_gouraud_shaded_mesh() -> None:
    mesh = ds.Mesh([[-1, -1, 0.2], [1, -1, 0], [1, 1, 0.3], [-1, 1, -0.2]], [[0, 1, 2], [0, 2, 3]])
    gbuffer = ds.gbuffer(mesh, ds.OrthographicCamera(20, 20, 2.4), shading=ds.GouraudShading())
    law = ds.QuadraticAttenuation(1.0, 0.0, 0.3)
    scene = ds.Scene(lights=ds.PointLight((0.5, 0.2, 1.5), 1.0, law))
    image = ds.render(gbuffer, scene, ds.Material(kd=0.5))
    unknown = ds.Material(kd=1.0)
    fit = fitting.fit(image, gbuffer, scene, material=unknown, attenuation=ds.QuadraticAttenuation)
    assert fit.relative_residual < 1e-4


def test_evaluate_measures_what_fit_measures() -> None:
    fit = fitting.fit(noisy(0.01, 1), GBUFFER, SCENE)
    again = fitting.evaluate(fit.material, noisy(0.01, 1), GBUFFER, SCENE)
    assert again.relative_residual == pytest.approx(fit.relative_residual, rel=1e-4)
    other = fitting.evaluate(fit.material, noisy(0.01, 2), GBUFFER, SCENE)
    assert other.relative_residual == pytest.approx(fit.relative_residual, rel=0.05)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"images": IMAGE[:10]}, "sizes must match"),
        ({"images": []}, "no images"),
        ({"images": (IMAGE * 255).astype(np.uint8)}, "linear radiance as floats"),
        ({"images": [IMAGE, IMAGE], "scenes": [SCENE] * 3}, "3 scenes for 2 images"),
        ({"images": np.where(IMAGE > 0.5, np.nan, IMAGE)}, "NaN or infinity"),
        ({"valid": jnp.zeros(IMAGE.shape[:2], bool)}, "no pixel is left"),
        ({"valid": np.ones((3, 3), bool)}, "sizes must match"),
        ({"hold": ["shine"]}, "hold names 'shine'"),
        ({"hold": "kd"}, "a sequence of names"),
        ({"hold": ["specular.ks"]}, "give material="),
        ({"hold": ["attenuation.c1"]}, "hold names 'attenuation.c1'"),
        ({"bounds": {"kd": (1, 0)}}, "lower <= upper"),
        ({"bounds": {"specular.0.shininess": (0, 5)}}, "0 < lower"),
        ({"bounds": {"gloss": (0, 5)}}, "bounds names 'gloss'"),
        ({"attenuation": ReferenceAttenuation}, "ds.QuadraticAttenuation"),
        ({"robust": "huber"}, "tukey"),
        ({"clipped": np.ones((3, 3), bool)}, "clipped pixels of image 0"),
        ({"noise": fitting.SensorNoise(read=0.01), "clipped": [None, None]}, "2 masks of clipped"),
    ],
)
def test_bad_input_is_refused_in_one_line(arguments: dict, message: str) -> None:
    given = {"images": IMAGE, "gbuffer": GBUFFER, "scenes": SCENE} | arguments
    with pytest.raises(ds.BadInput, match=message) as caught:
        fitting.fit(**given)
    assert "\n" not in str(caught.value)


def test_what_is_held_at_zero_sets_no_scale() -> None:
    """A k_d of 0 says nothing of how much light there is: k_s and the constants share their scale."""
    law = ds.QuadraticAttenuation(0.4, 0.3, 0.2)
    lights = tuple(ds.PointLight(light.position, light.intensity, law) for light in SCENE.lights)
    scene, mirror = ds.Scene(lights=lights), ds.Material(kd=0.0, specular=ds.Phong(0.9, 8.0))
    image = ds.render(GBUFFER, scene, mirror)
    fit = fitting.fit(
        image, GBUFFER, scene, material=mirror, hold=["kd"], attenuation=ds.QuadraticAttenuation
    )
    assert "specular.0.ks" in {name for item in fit.unidentified for name in item.coefficients}
    np.testing.assert_allclose(fit.coefficients["specular.0.shininess"], 8, rtol=1e-3)


def test_lights_whose_held_constants_differ_are_refused() -> None:
    laws = ds.QuadraticAttenuation(1.0, 0.1, 0.1), ds.QuadraticAttenuation(2.0, 0.1, 0.1)
    lights = tuple(ds.PointLight((x, 0, 3), 1, law) for x, law in zip((-1, 1), laws, strict=True))
    with pytest.raises(ds.BadInput, match="different values, 1 to 2") as caught:
        fitting.fit(
            IMAGE,
            GBUFFER,
            ds.Scene(ambient=0.5, lights=lights),
            hold=["attenuation.c0"],
            attenuation=ds.QuadraticAttenuation,
        )
    assert "\n" not in str(caught.value)


def test_a_surface_out_of_view_is_refused() -> None:
    nothing = ds.gbuffer(ds.Sphere(center=(9, 0, 0)), ds.OrthographicCamera(16, 16, 2.2))
    with pytest.raises(ds.BadInput, match="no pixel is left"):
        fitting.fit(np.zeros((16, 16, 3)), nothing, SCENE)


@pytest.mark.parametrize("double", [False, True])
def test_a_fit_keeps_its_precision(double: bool) -> None:
    with jax.enable_x64(double):
        sphere = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(16, 16, 2.2))
        scene = ds.Scene(lights=ds.ParallelLight((0, 0, 1.0)))
        image = ds.render(sphere, scene, ds.Material(kd=0.5, specular=ds.Phong(0.3, 10.0)))
        fit = fitting.fit(np.asarray(image), sphere, scene)
    dtype = np.float64 if double else np.float32
    for other in (not double, double):
        with jax.enable_x64(other):
            assert fit.material.kd.dtype == dtype
