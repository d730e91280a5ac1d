"""Point and parallel lights, and the sum over many of them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import diffshade as ds
from diffshade.vector import Vec3

GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(24, 24, 2.3))
GLOSSY = ds.Material(kd=0.6, specular=ds.Phong(0.3, 12.0))


def render(*lights: object, material: ds.Material = GLOSSY, ambient: object = None) -> np.ndarray:
    return np.asarray(ds.render(GBUFFER, ds.Scene(ambient=ambient, lights=lights), material))


def test_a_far_point_light_is_parallel() -> None:
    """R9: the parallel light is the limit of a point light far away."""
    towards = np.array([0.3, 0.5, 0.8])
    parallel = render(ds.ParallelLight(towards))
    errors = [
        np.abs(render(ds.PointLight(towards * far)) - parallel).max() for far in (1e2, 1e3, 1e4)
    ]
    assert errors[0] < 0.1
    assert errors[1] < errors[0] / 5
    assert errors[2] < errors[1] / 5


def test_a_direction_need_not_be_a_unit_vector(tolerance: float) -> None:
    long, short = render(ds.ParallelLight((3, 4, 12))), render(ds.ParallelLight((0.3, 0.4, 1.2)))
    np.testing.assert_allclose(long, short, atol=10 * tolerance)


def test_lights_add_up_and_ambient_counts_once(tolerance: float) -> None:
    """Text A sums whole right-hand sides, which would count I_a k_a once a light; once is right."""
    material = ds.Material(ka=0.2, kd=0.6, specular=ds.Phong(0.3, 12.0))
    one = ds.PointLight((1, 2, 3), (0.5, 0.6, 0.7), ds.InverseSquare())
    two = ds.ParallelLight((0, 0, 1), 0.4)
    together = render(one, two, material=material, ambient=0.5)
    lone = render(one, material=material) + render(two, material=material)
    ambient = np.where(GBUFFER.mask[..., None], 0.5 * 0.2, 0.0)
    np.testing.assert_allclose(together, lone + ambient, atol=10 * tolerance)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 16, 17, 41])
def test_any_number_of_lights(count: int, tolerance: float) -> None:
    """Scans over chunks of lights give what adding them one by one gives."""
    lights = [
        ds.PointLight((np.cos(k), np.sin(k), 1.5 + k / 20), (0.1, 0.2, 0.3)) for k in range(count)
    ]
    one_by_one = sum(render(light) for light in lights)
    np.testing.assert_allclose(
        render(*lights), one_by_one, rtol=100 * tolerance, atol=100 * tolerance
    )


def test_kinds_may_be_mixed(tolerance: float) -> None:
    lights = [
        ds.PointLight((1, 2, 3), 0.5),
        ds.PointLight((1, 2, 3), (0.5, 0.2, 0.1)),
        ds.ParallelLight((0, 1, 1), 0.3),
        ds.PointLight((0, 2, 3), 0.5, ds.InverseSquare()),
    ]
    separate = sum(np.broadcast_to(render(light), (24, 24, 3)) for light in lights)
    np.testing.assert_allclose(render(*lights), separate, atol=10 * tolerance)


def test_a_point_at_the_light_receives_nothing() -> None:
    """Coincident points: l is zero there, with finite derivatives."""
    here = Vec3(*map(jnp.asarray, (1.0, 2.0, 3.0)))
    light = ds.PointLight((1, 2, 3), 1.0, ds.InverseSquare())
    l, distance, _ = light.incidence(here)
    assert np.all(np.asarray(l.to_array()) == 0)
    assert light.falloff(distance) == 0

    def reach(light: ds.PointLight) -> jax.Array:
        l, distance, _ = light.incidence(here)
        return l.x + l.y + l.z + light.falloff(distance)

    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(jax.grad(reach)(light)))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: ds.PointLight((1, 2)), "the light's position has shape"),
        (lambda: ds.PointLight((1, 2, np.nan)), "the light's position is .* finite"),
        (lambda: ds.ParallelLight((1, 2, 3), "bright"), "the light's intensity is 'bright'"),
        (lambda: ds.Scene(ambient=np.inf), "the ambient intensity is .* finite"),
    ],
)
def test_bad_numbers_are_refused_in_one_line(build, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ds.BadInput, match=message) as caught:
        build()
    assert "\n" not in str(caught.value)


def test_channels_that_do_not_match_are_refused() -> None:
    lights = (ds.ParallelLight((0, 0, 1), (1, 1)), ds.ParallelLight((0, 0, 1), (1, 1, 1)))
    with pytest.raises(ds.BadInput, match="channels"):
        render(*lights)


def test_spectral_channels(tolerance: float) -> None:
    """R8: any number of channels, each on its own."""
    spectrum = np.linspace(0.1, 1.0, 31)
    image = render(ds.ParallelLight((0, 0, 1), spectrum), material=ds.Material(kd=spectrum[::-1]))
    grey = render(ds.ParallelLight((0, 0, 1), 1.0), material=ds.Material(kd=1.0))
    np.testing.assert_allclose(image, grey * spectrum * spectrum[::-1], atol=10 * tolerance)
