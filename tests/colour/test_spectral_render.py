"""A render of as many channels as wavelengths, seen by the eye, beside a render of three."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import diffshade as ds
import fitting
from diffshade.colour.cie import xyz_to_rgb
from diffshade.colour.metamer import metamer
from diffshade.colour.observer import illuminant, spectrum_to_xyz

WAVELENGTHS = np.arange(400.0, 701.0, 10.0)
DAY, LAMP = (illuminant(name, WAVELENGTHS) for name in ("D65", "A"))
BALL = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(width=12, height=12, extent=2.2))
ORANGE = 0.1 + 0.7 / (1 + np.exp(-(WAVELENGTHS - 580) / 15))


def scene(light: np.ndarray) -> ds.Scene:
    return ds.Scene(ambient=0.1 * light, lights=ds.ParallelLight((-0.5, 0.6, 1.0), light))


def ball(colour: jax.Array) -> ds.Material:
    lobe = ds.Phong(ks=0.2, shininess=10.0)
    return ds.Material(ka=0.5, kd=0.7, specular=lobe, od=colour)


def seen(light: np.ndarray, reflectance: jax.Array) -> jax.Array:
    """Linear sRGB of the spectral render, white where the light is on a perfect reflector."""
    image = ds.render(BALL, scene(light / light.mean()), ball(reflectance))
    return xyz_to_rgb(spectrum_to_xyz(image, WAVELENGTHS, white=light / light.mean()))


def rgb_of(light: np.ndarray, reflectance: jax.Array) -> jax.Array:
    """Of the surface alone: what a render of three channels is given."""
    shone = reflectance * jnp.asarray(light, reflectance.dtype)
    return xyz_to_rgb(spectrum_to_xyz(shone, WAVELENGTHS, white=light))


def in_three(light: np.ndarray, reflectance: jax.Array) -> jax.Array:
    """The render of three channels: the colours of the light and of the surface under it."""
    white = rgb_of(light, jnp.ones(31))
    colour = rgb_of(light, reflectance) / white
    return ds.render(BALL, scene(np.asarray(white)), ball(colour))


def test_three_channels_do_for_one_bounce_under_the_light_they_are_of(tolerance: float) -> None:
    """Every radiance is (a R(λ) + b) E(λ), so the eye may come first; for flat and other spectra."""
    for light in (DAY, LAMP):
        for reflectance in (jnp.full(31, 0.4), jnp.asarray(ORANGE, float)):
            found, expected = seen(light, reflectance), in_three(light, reflectance)
            np.testing.assert_allclose(found, expected, atol=30 * tolerance)


def test_flat_spectra_stay_as_they_are_under_another_light(tolerance: float) -> None:
    """But for the white: three channels of the day are right under the lamp for greys alone."""
    white = rgb_of(LAMP, jnp.ones(31))
    for reflectance, right in ((jnp.full(31, 0.4), True), (jnp.asarray(ORANGE, float), False)):
        of_day = rgb_of(DAY, reflectance) / rgb_of(DAY, jnp.ones(31))
        three = ds.render(BALL, scene(np.asarray(white)), ball(of_day))
        error = abs(seen(LAMP, reflectance) - three).max()
        assert (error < 30 * tolerance) if right else (error > 0.03)


def test_metamers_part_under_another_light(tolerance: float) -> None:
    first = jnp.full(31, 0.4)
    second = metamer(
        first, jnp.asarray(0.4 + 0.2 * np.cos(WAVELENGTHS / 20), float), DAY, WAVELENGTHS
    )
    assert ((second > 0) & (second < 1)).all()
    np.testing.assert_allclose(seen(DAY, first), seen(DAY, second), atol=30 * tolerance)
    assert abs(seen(LAMP, first) - seen(LAMP, second)).max() > 0.01


@pytest.mark.slow
@pytest.mark.float64
def test_the_slope_by_a_reflectance_is_exact() -> None:
    """The image is linear in it: a step of any size is a derivative; reverse and forward agree."""
    coarse, light = WAVELENGTHS[::3], LAMP[::3] / 100

    def eye(reflectance: jax.Array) -> jax.Array:
        image = ds.render(
            BALL, scene(light), ds.Material(kd=reflectance, specular=ds.Phong(0.2, 9.0))
        )
        return xyz_to_rgb(spectrum_to_xyz(image, coarse, white=light))

    at, way = jnp.asarray(ORANGE[::3]), jnp.linspace(-1.0, 1.0, 11)
    value, forward = jax.jit(lambda r: jax.jvp(eye, (r,), (way,)))(at)
    np.testing.assert_allclose(forward, eye(at + way) - value, atol=1e-12)
    slope = jax.jit(jax.grad(lambda r: (eye(r) ** 2).sum()))
    np.testing.assert_allclose(slope(at) @ way, 2 * (value * forward).sum(), rtol=1e-12)
    for grey in (0.0, 0.5):
        assert np.isfinite(slope(jnp.full(11, grey))).all()


@pytest.mark.slow
def test_a_spectral_material_is_fitted(tolerance: float) -> None:
    """Of 11 wavelengths under a lamp, and so its colour by day, which no RGB photograph tells."""
    coarse, lamp, day = WAVELENGTHS[::3], LAMP[::3] / 100, DAY[::3]
    image = ds.render(BALL, scene(lamp), ds.Material(kd=ORANGE[::3]))
    fit = fitting.fit(image, BALL, scene(lamp), material=ds.Material(kd=np.full(11, 0.5)))
    np.testing.assert_allclose(fit.material.kd, ORANGE[::3], rtol=100 * tolerance)
    colours = [
        spectrum_to_xyz(jnp.asarray(kd * day, float), coarse, white=day)
        for kd in (np.asarray(fit.material.kd), ORANGE[::3])
    ]
    np.testing.assert_allclose(*colours, atol=100 * tolerance)
