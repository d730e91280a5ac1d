"""Reflectances against the amplitudes of electromagnetic theory, and published values."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import diffshade as ds
from diffshade import guard
from diffshade.reflectance.fresnel import conductor, dielectric, schlick

COSINES = np.linspace(0, 1, 1001)[1:]


def amplitudes(cosine: np.ndarray, index: complex) -> np.ndarray:
    """(|r_s|^2 + |r_p|^2) / 2 from the complex amplitudes."""
    inside = np.sqrt(1 - (1 - cosine**2) / index**2 + 0j)
    s = (cosine - index * inside) / (cosine + index * inside)
    p = (index * cosine - inside) / (index * cosine + inside)
    return 0.5 * (np.abs(s) ** 2 + np.abs(p) ** 2)


@pytest.mark.parametrize("index", [0.7, 1.0001, 1.22, 1.5, 2.4, 9.0])
def test_a_dielectric(index: float, tolerance: float) -> None:
    rounded = jnp.asarray(index, float)  # near 1 its rounding matters
    found = dielectric(jnp.asarray(COSINES, float), rounded)
    np.testing.assert_allclose(found, amplitudes(COSINES, float(rounded)), atol=tolerance)


@pytest.mark.parametrize("metal", [(0.2, 3.9), (1.1, 2.14), (2.9, 3.1), (0.05, 9.0), (1.5, 0.0)])
def test_a_conductor(metal: tuple[float, float], tolerance: float) -> None:
    found = conductor(jnp.asarray(COSINES, float), *map(jnp.asarray, metal))
    np.testing.assert_allclose(found, amplitudes(COSINES, complex(*metal)), atol=tolerance)


def test_published_values(tolerance: float) -> None:
    """Glass reflects 4 % head-on, and nothing of one polarisation at Brewster's angle."""
    one = jnp.ones(())
    np.testing.assert_allclose(dielectric(one, 1.5 * one), 0.04, rtol=tolerance)
    np.testing.assert_allclose(dielectric(0 * one, 1.5 * one), 1, rtol=tolerance)
    brewster = jnp.cos(jnp.arctan(1.5 * one))  # R_s = ((n^2 - 1) / (n^2 + 1))^2, R_p = 0
    expected = 0.5 * (1.25 / 3.25) ** 2
    np.testing.assert_allclose(dielectric(brewster, 1.5 * one), expected, rtol=10 * tolerance)


def test_all_is_reflected_beyond_the_critical_angle() -> None:
    critical = np.sqrt(1 - 1 / 1.5**2)
    at = jnp.asarray([0.0, 0.5 * critical, 0.99 * critical, 1.01 * critical, 1.0])
    found = np.asarray(dielectric(at, jnp.asarray(1 / 1.5)))
    assert (found[:3] == 1).all()
    assert (found[3:] < 1).all()


def hessian_is_finite(cosine: float, index: float) -> bool:
    at = jnp.asarray(cosine), jnp.asarray(index)
    slopes = jax.hessian(dielectric, argnums=(0, 1))(*at)
    return all(bool(jnp.isfinite(x)) for x in jax.tree.leaves(slopes))


def test_second_derivatives_are_finite_where_all_is_reflected() -> None:
    least = guard.shortest(jnp.zeros(())) ** 0.5
    for cosine in (0.0, least / 10, 2 * least, 10 * least, 1e-3):
        assert hessian_is_finite(cosine, 0.25), cosine


def test_second_derivatives_are_finite_of_alike_media() -> None:
    least = guard.shortest(jnp.zeros(())) ** 0.5
    for power in (0.1, 1.0, 1.5, 1.7, 1.9, 2.0, 3.0):
        assert hessian_is_finite(least**power, 1.0), power


def test_the_slope_of_a_metal_in_a_small_index() -> None:
    """Head-on 1 - F = 4 n / ((n + 1)^2 + k^2), which 1 - F itself has lost to rounding."""
    n = 1e-9 if jax.config.jax_enable_x64 else 1e-4
    slope = jax.grad(conductor, argnums=1)(*map(jnp.asarray, (1.0, n, 9.0)))
    np.testing.assert_allclose(slope, -4 / 82, rtol=1e-3)


def test_alike_media_reflect_nothing() -> None:
    assert (dielectric(jnp.asarray(COSINES, float), jnp.ones(())) == 0).all()
    assert float(dielectric(jnp.zeros(()), jnp.ones(()))) == 0


def test_schlick_is_near_the_dielectric_and_exact_at_both_ends(tolerance: float) -> None:
    cosines = jnp.asarray(np.linspace(0, 1, 101), float)
    exact = dielectric(cosines, jnp.asarray(1.5))
    found = np.asarray(schlick(cosines, jnp.asarray(0.04)))
    np.testing.assert_allclose(found[[0, -1]], np.asarray(exact)[[0, -1]], rtol=tolerance)
    assert 0.01 < np.abs(found - exact).max() < 0.05


def test_a_boundary_a_channel() -> None:
    gold = ds.Conductor(index=(0.18, 0.42, 1.37), extinction=(3.4, 2.35, 1.77))
    head_on = [float(f) for f in gold.reflected(jnp.ones(()))]
    assert head_on[0] > head_on[1] > head_on[2]  # it is yellow
    assert len(ds.Dielectric((1.4, 1.5)).reflected(jnp.ones(()))) == 2
