"""Environments: the basis, images as quadrature, and published irradiance."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import sph_harm_y

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.harmonics import bands, order_of, spherical_harmonics
from diffshade.vector import Vec3

GRACE = np.array(
    [
        [0.79, 0.44, 0.54],
        [0.39, 0.35, 0.60],
        [-0.34, -0.18, -0.27],
        [-0.29, -0.06, 0.01],
        [-0.11, -0.05, -0.12],
        [-0.26, -0.22, -0.47],
        [-0.16, -0.09, -0.15],
        [0.56, 0.21, 0.14],
        [0.21, -0.05, -0.30],
    ]
)
"""Grace Cathedral, of Debevec's probes (Ramamoorthi and Hanrahan 2001, figure 2)."""


def directions(count: int, seed: int = 0) -> np.ndarray:
    """Unit vectors [count, 3], both poles first."""
    w = np.random.default_rng(seed).normal(size=(count, 3))
    w[:2] = [[0, 0, 1], [0, 0, -1]]
    return w / np.linalg.norm(w, axis=1, keepdims=True)


def vec(w: np.ndarray) -> Vec3:
    return Vec3(*(jnp.asarray(x, float) for x in w.T))


@pytest.mark.parametrize("order", [0, 2, 16])
def test_the_basis_is_scipys(order: int, tolerance: float) -> None:
    """But for the sign of Condon and Shortley."""
    w = directions(200)
    theta, phi = np.arccos(w[:, 2]), np.arctan2(w[:, 1], w[:, 0])
    expected = []
    for l in range(order + 1):
        for m in range(-l, l + 1):
            y = sph_harm_y(l, abs(m), theta, phi)
            part = y.imag if m < 0 else y.real
            expected.append(part if m == 0 else (-1) ** m * np.sqrt(2) * part)
    found = spherical_harmonics(vec(w), order)
    np.testing.assert_allclose(found, expected, atol=(order + 1) ** 2 * tolerance)


def test_the_bands_are_sums_over_the_basis(tolerance: float) -> None:
    w, c = directions(50), np.random.default_rng(1).normal(size=(25, 2))
    y = np.asarray(spherical_harmonics(vec(w), 4), float)
    for l, degree in enumerate(bands(vec(w), jnp.asarray(c, float))):
        own = slice(l * l, (l + 1) ** 2)
        np.testing.assert_allclose(degree, c[own].T @ y[own], atol=100 * tolerance)


def test_grace_cathedral_as_published(tolerance: float) -> None:
    """E(n) = n' M n of homogeneous n, with the paper's five constants of six digits (equation 12)."""
    c1, c2, c3, c4, c5 = 0.429043, 0.511664, 0.743125, 0.886227, 0.247708
    n = directions(100)
    homogeneous = np.append(n, np.ones((len(n), 1)), axis=1)
    found = ds.EnvironmentLight(GRACE).irradiance(vec(n))
    for channel, (l00, l1m1, l10, l11, l2m2, l2m1, l20, l21, l22) in enumerate(GRACE.T):
        m = np.array(
            [
                [c1 * l22, c1 * l2m2, c1 * l21, c2 * l11],
                [c1 * l2m2, -c1 * l22, c1 * l2m1, c2 * l1m1],
                [c1 * l21, c1 * l2m1, c3 * l20, c2 * l10],
                [c2 * l11, c2 * l1m1, c2 * l10, c4 * l00 - c5 * l20],
            ]
        )
        expected = np.einsum("pi,ij,pj->p", homogeneous, m, homogeneous)
        np.testing.assert_allclose(found[channel], expected, atol=3e-6 + tolerance)


def test_an_even_environment(tolerance: float) -> None:
    """E = pi L, whatever the normal."""
    even = ds.EnvironmentLight.from_image(np.full((8, 16, 3), [0.5, 1.0, 2.0]), order=2)
    for channel, L in zip(even.irradiance(vec(directions(20))), (0.5, 1.0, 2.0), strict=True):
        # The middles of pixels are not exact for the second degree: half a degree's square
        np.testing.assert_allclose(channel, np.pi * L, rtol=0.03)
    constant = np.sqrt(4 * np.pi) * np.array([0.5, 1, 2])
    np.testing.assert_allclose(even.harmonics[0], constant, rtol=tolerance)


def picture(height: int, light: ds.EnvironmentLight) -> np.ndarray:
    """What a camera sees that turns around in it: -z in the middle, x right of it, y up."""
    up = np.pi * (0.5 - (np.arange(height) + 0.5) / height)[:, None]
    right = np.pi * ((np.arange(2 * height) + 0.5) / height - 1)
    w = np.broadcast_arrays(np.cos(up) * np.sin(right), np.sin(up), -np.cos(up) * np.cos(right))
    return np.asarray(light.radiance(np.stack(w, axis=-1)), float)


def test_an_image_gives_its_harmonics_back() -> None:
    """The error falls like the square of a pixel's side."""
    light = ds.EnvironmentLight(np.random.default_rng(2).normal(size=(25, 3)))
    errors = [
        np.abs(
            ds.EnvironmentLight.from_image(picture(h, light), 4).harmonics - light.harmonics
        ).max()
        for h in (32, 64)
    ]
    assert errors[0] < 0.01
    assert errors[1] < errors[0] / 3.5


def test_where_an_image_looks() -> None:
    """A bright spot at each of six places of the image lights the normal that faces it the most."""
    faces = {
        (0, 8): (0, 1, 0),
        (15, 8): (0, -1, 0),
        (8, 16): (0, 0, -1),
        (8, 0): (0, 0, 1),
        (8, 24): (1, 0, 0),
        (8, 8): (-1, 0, 0),
    }
    axes = np.array(list(faces.values()), float)
    for (row, column), face in faces.items():
        image = np.zeros((16, 32))
        image[row, column] = 1
        (found,) = ds.EnvironmentLight.from_image(image, 2).irradiance(vec(axes))
        assert tuple(axes[np.argmax(found)]) == face


def test_derivatives_reach_the_image() -> None:
    image = (
        np.random.default_rng(3).uniform(size=(6, 12)).astype(jax.dtypes.canonicalize_dtype(float))
    )
    slope = jax.grad(lambda x: ds.EnvironmentLight.from_image(x, 1).harmonics[3])(
        jnp.asarray(image)
    )
    harmonic = ds.EnvironmentLight.from_image(image, 1).harmonics[3]
    np.testing.assert_allclose(np.sum(slope * image), harmonic, rtol=1e-5)  # it is linear


def test_lights_that_are_the_environment(tolerance: float) -> None:
    """Their sum against any harmonic is its coefficient: Gauss's rule is exact for these."""
    light = ds.EnvironmentLight(GRACE, intensity=0.5)
    lights = light.as_lights(3)
    assert len(lights) == 18
    w = np.array([np.asarray(x.direction) for x in lights])
    power = np.array([np.asarray(x.intensity) for x in lights])
    y = np.asarray(spherical_harmonics(vec(w), 2), float)
    np.testing.assert_allclose(y @ power, 0.5 * GRACE, atol=10 * tolerance)
    grey = ds.EnvironmentLight([1.0]).as_lights(1)
    assert [x.intensity.shape for x in grey] == [(), ()]


def test_truncated_is_the_first_degrees() -> None:
    light = ds.EnvironmentLight(GRACE)
    assert light.order == 2
    np.testing.assert_array_equal(light.truncated(1).harmonics, np.asarray(light.harmonics)[:4])
    assert [order_of(count) for count in (0, 1, 3, 4, 9, 10)] == [None, 0, None, 1, 2, None]


def test_what_is_refused() -> None:
    for harmonics_, shape in ((np.ones(5), "(5,)"), (1.0, "()"), (np.ones((4, 0)), "(4, 0)")):
        with pytest.raises(BadInput) as refused:
            ds.EnvironmentLight(harmonics_)
        assert f"have shape {shape}: give [(order + 1)^2]" in str(refused.value)
    with pytest.raises(BadInput, match="every number must be finite"):
        ds.EnvironmentLight([np.nan])
    image = np.ones((4, 8))
    for order in (-1, True):
        with pytest.raises(BadInput, match=f"order is {order}: give a whole number"):
            ds.EnvironmentLight.from_image(image, order)
    with pytest.raises(BadInput, match="8 x 4 pixels, too few for order 4: give a lower order"):
        ds.EnvironmentLight.from_image(image, 4)
    with pytest.raises(BadInput, match=r"shape \(4,\): give \[H, W\]"):
        ds.EnvironmentLight.from_image(image[:, 0], 1)
    with pytest.raises(BadInput, match="samples is 0: give a whole number of at least 1"):
        ds.EnvironmentLight([1.0]).as_lights(0)
