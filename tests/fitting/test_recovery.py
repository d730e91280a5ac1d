"""Synthetic captures: every coefficient comes back, from no start at all."""

import jax
import numpy as np
import pytest
from truths import Truth, draw

import diffshade as ds
import fitting

GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(96, 96, 2.2))


def relative_errors(fit: fitting.Fit, truth: Truth) -> dict[str, float]:
    """Of ka, kd, ks and n, or with an attenuation of kd f(d0) and ks f(d0) and the shares l."""
    lobe = truth.material.specular[0]
    expected = {"ka": truth.material.ka, "specular.0.shininess": lobe.shininess}
    shares = {}
    if truth.constants is None:
        expected |= {"kd": truth.material.kd, "specular.0.ks": lobe.ks}
    else:
        assert fit.reference_distance is not None
        parts = np.array(truth.constants) * fit.reference_distance ** np.arange(3)
        f = 1 / parts.sum()
        expected |= {
            "reference.kd": np.asarray(truth.material.kd) * f,
            "reference.specular.0.ks": np.asarray(lobe.ks) * f,
        }
        shares = {f"reference.l{k}": parts[k] * f for k in range(3)}
    errors = {
        name: float(np.max(np.abs(fit.coefficients[name] / np.asarray(value) - 1)))
        for name, value in expected.items()
    }
    return errors | {name: float(abs(fit.coefficients[name] - l)) for name, l in shares.items()}


@pytest.mark.slow
@pytest.mark.parametrize("light_count", [1, 2, 3, 4])
@pytest.mark.parametrize("attenuated", [False, True])
def test_random_truths(light_count: int, attenuated: bool) -> None:
    """Five a kind, 20 with and 20 without attenuation: 1e-6 in float64, 1e-3 in float32."""
    allowed = 1e-6 if jax.config.jax_enable_x64 else 1e-3
    rng = np.random.default_rng(100 * light_count + attenuated)
    for trial in range(5):
        truth = draw(rng, light_count, attenuated=attenuated)
        image = ds.render(GBUFFER, truth.scene, truth.material)
        unknown = ds.QuadraticAttenuation if attenuated else None
        fit = fitting.fit(image, GBUFFER, truth.scene, attenuation=unknown)
        errors = relative_errors(fit, truth)
        assert fit.converged
        assert max(errors.values()) < allowed, f"trial {trial}, {truth.constants}: {errors}"


def test_constants_come_back_as_the_texts_write_them() -> None:
    """With c0 = 1 in the truth, c0, c1, c2, k_d and k_s are found themselves, and so is the image."""
    truth = draw(np.random.default_rng(7), 3, attenuated=True)
    image = ds.render(GBUFFER, truth.scene, truth.material)
    fit = fitting.fit(image, GBUFFER, truth.scene, attenuation=ds.QuadraticAttenuation)
    allowed = 1e-6 if jax.config.jax_enable_x64 else 1e-3
    found = [float(fit.coefficients[f"attenuation.c{k}"]) for k in range(3)]
    np.testing.assert_allclose(found, truth.constants, rtol=allowed, atol=allowed)
    np.testing.assert_allclose(fit.material.kd, truth.material.kd, rtol=allowed)
    again = ds.render(GBUFFER, fit.scene, fit.material)
    np.testing.assert_allclose(again, image, atol=allowed)
    assert fit.relative_residual < allowed
    scale = [item for item in fit.unidentified if "attenuation.c0" in item.coefficients]
    assert len(scale) == 1
    assert {"kd", "specular.0.ks", "attenuation.c1"} <= set(scale[0].coefficients)


@pytest.mark.slow
def test_no_corner_of_the_triangle_is_a_trap() -> None:
    """Truths from which a search in polar coordinates about a corner slid into it, and stayed there."""
    rng = np.random.default_rng(1010)
    for trial in range(12):
        truth = draw(rng, 1, attenuated=True)
        image = ds.render(GBUFFER, truth.scene, truth.material)
        fit = fitting.fit(image, GBUFFER, truth.scene, attenuation=ds.QuadraticAttenuation)
        errors = relative_errors(fit, truth)
        allowed = 1e-6 if jax.config.jax_enable_x64 else 1e-3
        assert max(errors.values()) < allowed, f"trial {trial}, {truth.constants}: {errors}"


def test_an_inverse_square_law_is_found() -> None:
    """A corner of the triangle: l = (0, 0, 1)."""
    lights = tuple(ds.PointLight((x, 0.5, 2.5), 1.0, ds.InverseSquare()) for x in (-1.5, 0.3, 2.0))
    scene = ds.Scene(lights=lights)
    material = ds.Material(kd=0.6, specular=ds.Phong(ks=0.4, shininess=30.0))
    fit = fitting.fit(
        ds.render(GBUFFER, scene, material), GBUFFER, scene, attenuation=ds.QuadraticAttenuation
    )
    allowed = 1e-6 if jax.config.jax_enable_x64 else 2e-3
    shares = [float(fit.coefficients[f"reference.l{k}"]) for k in range(3)]
    np.testing.assert_allclose(shares, (0, 0, 1), atol=allowed)
    assert fit.relative_residual < allowed


def test_several_images_share_one_material() -> None:
    rng = np.random.default_rng(3)
    truth = draw(rng, 1, attenuated=False)
    scenes = [
        ds.Scene(ambient=0.5, lights=draw(rng, 1, attenuated=False).scene.lights) for _ in "abc"
    ]
    images = [ds.render(GBUFFER, scene, truth.material) for scene in scenes]
    fit = fitting.fit(images, GBUFFER, scenes)
    errors = relative_errors(fit, truth)
    assert max(errors.values()) < (1e-6 if jax.config.jax_enable_x64 else 1e-3)
    assert len(fit.scene) == len(fit.per_image) == 3


def test_grey_and_coloured_lights_in_one_fit() -> None:
    lights = (ds.ParallelLight((-1, 1, 2)), ds.ParallelLight((1, 1, 2), (1.0, 0.9, 0.8)))
    scenes = [ds.Scene(lights=light) for light in lights]
    truth = ds.Material(kd=(0.5, 0.3, 0.2), specular=ds.Phong(0.4, 30.0))
    images = [np.broadcast_to(ds.render(GBUFFER, s, truth), (96, 96, 3)) for s in scenes]
    fit = fitting.fit(images, GBUFFER, scenes)
    allowed = 1e-6 if jax.config.jax_enable_x64 else 1e-3
    np.testing.assert_allclose(fit.material.specular[0].shininess, 30.0, rtol=allowed)
    np.testing.assert_allclose(fit.material.kd, (0.5, 0.3, 0.2), rtol=allowed)


def test_blinn_phong_and_lambert() -> None:
    scene = ds.Scene(lights=ds.ParallelLight((0.4, 0.3, 0.9)))
    allowed = 1e-6 if jax.config.jax_enable_x64 else 1e-3
    glossy = ds.Material(kd=(0.5, 0.3, 0.2), specular=ds.BlinnPhong(0.4, 77.0))
    model = ds.Material(kd=1.0, specular=ds.BlinnPhong(1.0, 10.0))
    fit = fitting.fit(ds.render(GBUFFER, scene, glossy), GBUFFER, scene, material=model)
    assert isinstance(fit.material.specular[0], ds.BlinnPhong)
    np.testing.assert_allclose(fit.material.specular[0].shininess, 77.0, rtol=allowed)

    matte = ds.Material(kd=(0.5, 0.3, 0.2))
    fit = fitting.fit(
        ds.render(GBUFFER, scene, matte), GBUFFER, scene, material=ds.Material(kd=1.0)
    )
    assert fit.material.specular == ()
    np.testing.assert_allclose(fit.material.kd, matte.kd, rtol=allowed)


@pytest.mark.slow
def test_two_lobes() -> None:
    scene = ds.Scene(lights=(ds.ParallelLight((0.4, 0.3, 0.9)), ds.ParallelLight((-0.5, 0.3, 0.6))))
    lobes = (ds.Phong(0.4, 200.0), ds.Phong(0.2, 12.0))
    truth = ds.Material(kd=0.5, specular=lobes)
    fit = fitting.fit(ds.render(GBUFFER, scene, truth), GBUFFER, scene, material=truth)
    found = [float(lobe.shininess) for lobe in fit.material.specular]
    np.testing.assert_allclose(found, (200, 12), rtol=1e-5 if jax.config.jax_enable_x64 else 1e-2)


def test_gouraud_shaded_meshes_are_fitted_as_they_are_rendered() -> None:
    vertices = np.array([[-1, -1, 0.2], [1, -1, 0], [1, 1, 0.3], [-1, 1, -0.2]], float)
    mesh = ds.Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]))
    camera = ds.OrthographicCamera(40, 40, 2.4)
    gbuffer = ds.gbuffer(mesh, camera, shading=ds.GouraudShading())
    scene = ds.Scene(lights=(ds.PointLight((0.5, 0.2, 1.5)), ds.PointLight((-1, 0.5, 1.0))))
    truth = ds.Material(kd=0.5, specular=ds.Phong(0.3, 6.0))
    fit = fitting.fit(ds.render(gbuffer, scene, truth), gbuffer, scene)
    allowed = 1e-6 if jax.config.jax_enable_x64 else 2e-3
    np.testing.assert_allclose(fit.material.specular[0].shininess, 6.0, rtol=allowed)


def test_a_last_step_does_no_harm(rng: np.random.Generator) -> None:
    """Four photographs of one point: what is left has no curvature along the shininess at its minimum,
    so that every step is slight beside its standard error, and k_s meets its bound near by."""
    normal = np.array([[[0.11, 0.07, np.sqrt(1 - 0.11**2 - 0.07**2)]]])
    gbuffer = ds.GBuffer.from_arrays(normal, normal, view=(0, 0, 1))
    places = ((0.8, 0.5, 2.5), (-1.0, 0.8, 2.0), (0.0, -1.0, 3.0), (1.0, 1.0, 1.6))
    law = ds.QuadraticAttenuation(1.0, 0.1, 0.05)
    scenes = [ds.Scene(ambient=0.5, lights=ds.PointLight(place, 1.0, law)) for place in places]
    truth = ds.Material(ka=0.1, kd=0.6, specular=ds.Phong(ks=0.3, shininess=20.0))
    exact = [np.repeat(ds.render(gbuffer, scene, truth), 3, axis=-1) for scene in scenes]
    for _ in range(8):
        images = [(x + rng.normal(0, 1e-4, x.shape)).astype(x.dtype) for x in exact]
        assert fitting.fit(images, gbuffer, scenes).relative_residual < 1e-3
