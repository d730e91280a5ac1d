"""How intensity falls with distance (LIGHT-12 and the other laws of R7)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from registry import ATTENUATIONS

import diffshade as ds

DISTANCES = np.array([1e-6, 0.01, 0.5, 1.0, 2.0, 25.02, 1e3, 1e6])


def value(attenuation: object, d: object) -> np.ndarray:
    return np.asarray(attenuation(jnp.asarray(d, float)))  # type: ignore[operator]


def test_light_12(tolerance: float) -> None:
    """min(1/(c0 + c1 d + c2 d^2), 1), and never the inverted clamp that text C prints."""
    for c in ((0.5, 0.03, 0.001), (2.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)):
        q = c[0] + c[1] * DISTANCES + c[2] * DISTANCES**2
        np.testing.assert_allclose(
            value(ds.QuadraticAttenuation(*c), DISTANCES), np.minimum(1 / q, 1), rtol=tolerance
        )


def test_constants_of_zero_are_finite() -> None:
    assert value(ds.QuadraticAttenuation(0, 0, 0), 3.0) == 1
    assert value(ds.QuadraticAttenuation(0, 0, 1), 0.0) == 1
    assert value(ds.LinearAttenuation(0, 0), 3.0) == 0
    assert value(ds.InverseSquare(), 0.0) == 0


def test_the_other_laws(tolerance: float) -> None:
    exact = {"rtol": tolerance}
    np.testing.assert_allclose(value(ds.InverseSquare(), DISTANCES), DISTANCES**-2.0, **exact)
    linear = value(ds.LinearAttenuation(0.9, 0.3), DISTANCES)
    np.testing.assert_allclose(linear, 1 / (0.9 + 0.3 * DISTANCES), **exact)
    absorbed = value(ds.ExponentialAttenuation(0.21), DISTANCES[:6])
    np.testing.assert_allclose(absorbed, np.exp(-0.21 * DISTANCES[:6]), **exact)


def test_a_window_ends_smoothly_at_the_reach(tolerance: float) -> None:
    """(1 - (d/R)^4)^2, and exactly nothing from R on (Karis 2013)."""
    f = ds.Windowed(ds.LinearAttenuation(1, 0), reach=2.0)
    np.testing.assert_allclose(value(f, 1.0), (15 / 16) ** 2, rtol=tolerance)
    far = float(jnp.finfo(jnp.zeros(()).dtype).max) ** 0.79  # its fourth power is not finite
    np.testing.assert_array_equal(value(f, [2.0, 2.1, far]), 0)
    slope = jax.vmap(jax.grad(f))(jnp.array([0.0, 1.999999, 2.0, far]))
    np.testing.assert_allclose(slope, 0, atol=2e-5)
    assert value(ds.Windowed(ds.InverseSquare(), reach=0.0), 1.0) == 0


def test_absorption_multiplies_along_the_way(tolerance: float) -> None:
    """Lambert's third law: what two layers let through is the product of what each does."""
    f = ds.ExponentialAttenuation(0.4)
    np.testing.assert_allclose(value(f, 5.0), value(f, 2.0) * value(f, 3.0), rtol=10 * tolerance)


@pytest.mark.parametrize("name", [n for n, a in ATTENUATIONS.items() if a is not None])
@pytest.mark.parametrize("d", [0.0, 1e-6, 1.0, 1e6])
def test_finite_with_finite_derivatives(name: str, d: float) -> None:
    attenuation = ATTENUATIONS[name]

    def f(attenuation: object, d: jax.Array) -> jax.Array:
        return attenuation(d)  # type: ignore[operator]

    at = jnp.asarray(d, float)
    values = [f(attenuation, at), *jax.tree.leaves(jax.grad(f, argnums=(0, 1))(attenuation, at))]
    bound = 1e30 if jax.config.jax_enable_x64 else 1e20
    assert all(np.isfinite(v) and abs(v) < bound for v in values)
