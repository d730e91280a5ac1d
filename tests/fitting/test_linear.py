"""Bounded least squares in few unknowns, against SciPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from fitting.linear import bounded_least_squares

pytestmark = pytest.mark.float64


@pytest.mark.parametrize("p", [1, 2, 3, 4])
def test_against_scipy(p: int) -> None:
    rng = np.random.default_rng(p)
    solve = jax.jit(bounded_least_squares)
    for _ in range(25):
        a, y = rng.normal(size=(20, p)), rng.normal(size=20) * 2
        lower, upper = -rng.uniform(0, 0.3, p), rng.uniform(0, 0.3, p)
        lower = np.where(rng.random(p) < 0.2, -np.inf, lower)
        upper = np.where(rng.random(p) < 0.2, np.inf, upper)
        k, free = solve(a.T @ a, a.T @ y, jnp.asarray(lower), jnp.asarray(upper))
        expected = lsq_linear(a, y, (lower, upper), method="bvls", tol=1e-14).x
        np.testing.assert_allclose(k, expected, atol=1e-9)
        assert np.all((np.asarray(k) > lower) & (np.asarray(k) < upper) | ~np.asarray(free))


def test_a_column_of_zeros_rests() -> None:
    """A term that no pixel shows is left at 0, or at the bound nearest to it."""
    a = np.array([[1.0, 0.0], [2.0, 0.0]])
    y = np.array([1.0, 2.0])
    for low, expected in ((0.0, 0.0), (-1.0, 0.0), (0.2, 0.2)):
        k, free = bounded_least_squares(
            jnp.asarray(a.T @ a), jnp.asarray(a.T @ y), jnp.full(2, low), jnp.full(2, 5.0)
        )
        np.testing.assert_allclose(k, (1.0, expected), atol=1e-12)
        assert not free[1]


def test_equal_bounds_hold() -> None:
    rng = np.random.default_rng(0)
    a, y = rng.normal(size=(20, 2)), rng.normal(size=20)
    lower, upper = jnp.array([0.7, -jnp.inf]), jnp.array([0.7, jnp.inf])
    k, _ = bounded_least_squares(jnp.asarray(a.T @ a), jnp.asarray(a.T @ y), lower, upper)
    rest = np.linalg.lstsq(a[:, 1:], y - 0.7 * a[:, 0], rcond=None)[0]
    np.testing.assert_allclose(k, (0.7, rest[0]), rtol=1e-10)


def test_a_column_that_is_nothing_rests() -> None:
    """So little of the largest that it is the other columns' rounding: held, not divided by."""
    gram, moment = np.diag([1.0, 1e-18]), np.array([0.5, 1e-18])
    lower, upper = np.zeros(2), np.full(2, np.inf)
    k, free = bounded_least_squares(gram, moment, lower, upper, nothing=1e-6)
    np.testing.assert_array_equal(k, [0.5, 0])
    np.testing.assert_array_equal(free, [True, False])
    k, free = bounded_least_squares(gram, moment, lower, upper)
    np.testing.assert_allclose(k, [0.5, 1])
    assert free.all()
