"""The refraction vector: Snell's law, both ways, and total internal reflection."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diffshade.vector import Vec3, dot, length, refract

N = Vec3(*map(jnp.asarray, (0.0, 0.0, 1.0)))


def towards(angle: float) -> Vec3:
    return Vec3(jnp.sin(jnp.asarray(angle)), jnp.asarray(0.0), jnp.cos(jnp.asarray(angle)))


@pytest.mark.parametrize("index", [1.0, 1.33, 1.5, 2.4, 0.7])
@pytest.mark.parametrize("degrees", [0, 10, 30, 44])
def test_snells_law(degrees: float, index: float, tolerance: float) -> None:
    l = towards(np.radians(degrees))
    t = refract(l, N, jnp.asarray(index))
    np.testing.assert_allclose(length(t), 1, rtol=10 * tolerance)
    np.testing.assert_allclose(-t.x * index, l.x, atol=10 * tolerance)
    assert t.z < 0
    assert t.y == 0


def test_the_angles_of_a_book(tolerance: float) -> None:
    """From air into water at 45 degrees: 32.1 degrees; water's critical angle is 48.8 degrees."""
    t = refract(towards(np.radians(45)), N, jnp.asarray(1.333))
    assert abs(np.degrees(np.arccos(-float(t.z))) - 32.04) < 0.02
    for degrees, total in ((48.5, False), (48.7, True)):
        t = refract(towards(np.radians(degrees)), N, jnp.asarray(1 / 1.333))
        assert (float(length(t)) == 0) is total


def test_light_comes_back_the_same_way(tolerance: float) -> None:
    l = towards(0.7)
    t = refract(l, N, jnp.asarray(1.5))
    back = refract(t, -N, jnp.asarray(1 / 1.5))
    np.testing.assert_allclose(back.to_array(), l.to_array(), atol=10 * tolerance)


def test_beyond_the_critical_angle_derivatives_are_zero() -> None:
    def components(angle: jax.Array, index: jax.Array) -> jax.Array:
        return refract(Vec3(jnp.sin(angle), 0 * angle, jnp.cos(angle)), N, index).to_array()

    at = jnp.asarray(1.0), jnp.asarray(0.7)
    assert (components(*at) == 0).all()
    for mode in (jax.jacfwd, jax.jacrev):
        assert all((slope == 0).all() for slope in mode(components, argnums=(0, 1))(*at))


def test_it_lies_in_the_plane_of_incidence(rng: np.random.Generator, tolerance: float) -> None:
    l, n = (
        Vec3.from_array(jnp.asarray(v / np.linalg.norm(v)))
        for v in ([0.3, 0.5, 0.8], [0.1, -0.2, 0.9])
    )
    t = refract(l, n, jnp.asarray(1.4))
    across = np.cross(np.asarray(l.to_array()), np.asarray(n.to_array()))
    assert abs(np.asarray(t.to_array()) @ across) < 10 * tolerance
    np.testing.assert_allclose(
        np.sqrt(1 - float(dot(n, t)) ** 2) * 1.4,
        np.sqrt(1 - float(dot(n, l)) ** 2),
        rtol=100 * tolerance,
    )
