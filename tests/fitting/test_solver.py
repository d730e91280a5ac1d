"""The bounded solver on published problems, against SciPy's, inside `optimistix.least_squares`."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from scipy.optimize import least_squares

from fitting.solver import BoundedLevenbergMarquardt

pytestmark = pytest.mark.float64


def rosenbrock(y: jax.Array) -> jax.Array:
    return jnp.array([10 * (y[1] - y[0] ** 2), 1 - y[0]])


def powell_singular(y: jax.Array) -> jax.Array:
    return jnp.array(
        [
            y[0] + 10 * y[1],
            jnp.sqrt(5.0) * (y[2] - y[3]),
            (y[1] - 2 * y[2]) ** 2,
            jnp.sqrt(10.0) * (y[0] - y[3]) ** 2,
        ]
    )


def helical_valley(y: jax.Array) -> jax.Array:
    theta = jnp.arctan2(y[1], y[0]) / (2 * jnp.pi)
    return jnp.array([10 * (y[2] - 10 * theta), 10 * (jnp.hypot(y[0], y[1]) - 1), y[2]])


def decay(y: jax.Array) -> jax.Array:
    t = jnp.linspace(0, 3, 40)
    return y[0] * jnp.exp(-y[1] * t) - (2 * jnp.exp(-0.7 * t) + 0.05 * jnp.sin(9 * t))


PROBLEMS: dict[str, tuple[Callable, list, list, list]] = {
    "Rosenbrock": (rosenbrock, [-1.2, 1.0], [-5.0, -5.0], [5.0, 5.0]),
    "Rosenbrock, minimum cut off": (rosenbrock, [-1.2, 1.0], [-5.0, -5.0], [0.6, 5.0]),
    "Rosenbrock, corner": (rosenbrock, [1.5, 3.0], [1.2, 2.0], [5.0, 5.0]),
    "Powell, singular": (powell_singular, [3.0, -1.0, 0.0, 1.0], [-9.0] * 4, [9.0] * 4),
    "helical valley": (helical_valley, [0.9, 0.6, 0.5], [0.1, -5.0, -5.0], [5.0, 5.0, 5.0]),
    "decay": (decay, [0.5, 3.0], [0.0, 0.0], [10.0, 10.0]),
    "decay, bounded": (decay, [0.5, 3.0], [0.0, 0.9], [1.5, 10.0]),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_against_scipy(name: str) -> None:
    f, start, lower, upper = PROBLEMS[name]
    solver = BoundedLevenbergMarquardt(1e-9, 1e-8, jnp.array(lower), jnp.array(upper))
    solution = optx.least_squares(
        lambda y, _: f(y), solver, jnp.array(start), max_steps=256, throw=False
    )
    reference = least_squares(f, start, bounds=(lower, upper), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    cost = float(0.5 * jnp.sum(f(solution.value) ** 2))
    assert solution.result == optx.RESULTS.successful
    np.testing.assert_allclose(cost, reference.cost, rtol=1e-6, atol=1e-12)
    assert np.all((np.asarray(solution.value) >= lower) & (np.asarray(solution.value) <= upper))


def test_every_iterate_stays_in_the_box() -> None:
    """The residual is not defined outside: a solver that steps out first would meet NaN."""

    def f(y: jax.Array, _: None) -> jax.Array:
        outside = (y[0] < 0) | (y[0] > 2)
        return jnp.where(outside, jnp.nan, jnp.array([jnp.sqrt(jnp.maximum(y[0], 0)) + 3.0]))

    solver = BoundedLevenbergMarquardt(1e-9, 1e-12, jnp.array([0.0]), jnp.array([2.0]))
    solution = optx.least_squares(f, solver, jnp.array([1.7]), max_steps=64, throw=False)
    assert abs(float(solution.value[0])) < 1e-6
