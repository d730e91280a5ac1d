"""The rivals of `fitting.fit`: general solvers on `plain_phong`, set up as their authors would.

Each is given the image and the G-buffer, computes the geometry once, and starts from the same place:
a plain guess, or random ones. All that JAX compiles is compiled before it is timed. SciPy and lmfit
work in float64, so their residuals and Jacobians do too; Adam and Optimistix run in float32.
"""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import lmfit
import numpy as np
import optax
import optimistix as optx
from jax import Array
from scipy.optimize import least_squares

from benchmarks.fit_truths import Ball, Truth
from benchmarks.plain_phong import Terms, jacobian, predict, terms

__all__ = [
    "GUESS",
    "Rival",
    "adam",
    "adam_schedules",
    "lmfit_leastsq",
    "optimistix",
    "random_start",
    "scipy_trf",
]

Rival = Callable[[np.ndarray, Ball, Truth, np.ndarray], np.ndarray]
"""From an image [H, W, 1], a surface, lights and a start to the unknowns (ka, kd, ks, n, c1, c2)."""

NAMES = ("ka", "kd", "ks", "n", "c1", "c2")
GUESS = np.array([0.1, 0.5, 0.3, 20.0, 0.1, 0.05])
LOWER = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
UPPER = np.array([1.0, 1.0, 1.0, 2000.0, 10.0, 10.0])
ADAM_STEPS = 500

_predict = jax.jit(predict)
_jacobian = jax.jit(jacobian)
_columns = jax.jit(lambda x, at: jacobian(x, at).T)


def random_start(rng: np.random.Generator) -> np.ndarray:
    """Anywhere that a material may lie."""
    logarithms = np.log([[1.2, 800], [0.005, 2], [0.005, 1]])
    linear = rng.uniform([0.01, 0.05, 0.02], [0.5, 1, 1])
    return np.concatenate([linear, np.exp(rng.uniform(*logarithms.T))])


def _data(image: np.ndarray, ball: Ball, truth: Truth, dtype: Any) -> tuple[Terms, np.ndarray]:
    """Geometry and observations from the G-buffer's planes."""
    normal, position = ball.gbuffer.normal, ball.gbuffer.position
    assert position is not None
    planes = [
        np.stack([np.asarray(axis, dtype) for axis in (v.x, v.y, v.z)]) for v in (position, normal)
    ]
    lights = (np.asarray(truth.positions, dtype), np.asarray(truth.intensities, dtype))
    return terms(*planes, *lights), image[ball.inside][:, 0].astype(dtype)


def scipy_trf(image: np.ndarray, ball: Ball, truth: Truth, start: np.ndarray) -> np.ndarray:
    """`scipy.optimize.least_squares`, trust region reflective, under bounds."""
    with jax.enable_x64(True):
        at, observed = _data(image, ball, truth, np.float64)
        found = least_squares(
            lambda x: np.asarray(_predict(x, at)) - observed,
            np.clip(start, 1.001 * LOWER, 0.999 * UPPER),
            jac=lambda x: np.asarray(_jacobian(x, at)),
            bounds=(LOWER, UPPER),
            method="trf",
            x_scale="jac",
        )
    return found.x


def lmfit_leastsq(image: np.ndarray, ball: Ball, truth: Truth, start: np.ndarray) -> np.ndarray:
    """`lmfit.minimize` by MINPACK's Levenberg-Marquardt, under bounds."""
    with jax.enable_x64(True):
        at, observed = _data(image, ball, truth, np.float64)
        guess = lmfit.Parameters()
        for name, value, low, high in zip(NAMES, start, LOWER, UPPER, strict=True):
            guess.add(name, value=value, min=low, max=high)

        def unknowns(parameters: Mapping[str, Any]) -> np.ndarray:
            return np.array([parameters[name].value for name in NAMES])

        found = lmfit.minimize(
            lambda p: np.asarray(_predict(unknowns(p), at)) - observed,
            guess,
            method="leastsq",
            Dfun=lambda p: np.asarray(_columns(unknowns(p), at)),
            col_deriv=True,  # as MINPACK stores it
        )
    return unknowns(found.params)


def optimistix(image: np.ndarray, ball: Ball, truth: Truth, start: np.ndarray) -> np.ndarray:
    """Optimistix's own Levenberg-Marquardt in the free variables that Adam has too."""
    at, observed = _data(image, ball, truth, np.float32)
    return np.asarray(_levenberg_marquardt(at, observed, _to_free(start)))


@jax.jit
def _levenberg_marquardt(at: Terms, observed: Array, start: Array) -> Array:
    found = optx.least_squares(
        lambda u, _: predict(_from_free(u), at) - observed,
        optx.LevenbergMarquardt(rtol=1e-5, atol=1e-6),
        start,
        max_steps=300,
        throw=False,
    )
    return _from_free(found.value)


def adam(schedule: np.ndarray) -> Rival:
    """Adam, one learning rate a step, on the mean square, as inverse rendering does today."""
    rates = jnp.asarray(schedule, jnp.float32)

    def solve(image: np.ndarray, ball: Ball, truth: Truth, start: np.ndarray) -> np.ndarray:
        at, observed = _data(image, ball, truth, np.float32)
        return np.asarray(_descend(at, observed, rates, _to_free(start)))

    return solve


def adam_schedules(steps: int = ADAM_STEPS) -> dict[str, np.ndarray]:
    """Learning rates from 0.01 to 1: constant, decaying as a cosine, and exponentially."""
    t = np.arange(steps) / steps
    shapes = {
        "constant": np.ones(steps),
        "cosine": (1 + np.cos(np.pi * t)) / 2,
        "exponential": 0.01**t,
        "one cycle": np.minimum(10 * t + 0.1, 1) * (1 + np.cos(np.pi * t)) / 2,
    }
    rates = (0.01, 0.03, 0.1, 0.3, 1.0)
    return {f"{rate} {name}": rate * shape for name, shape in shapes.items() for rate in rates}


@jax.jit
def _descend(at: Terms, observed: Array, rates: Array, start: Array) -> Array:
    direction = optax.scale_by_adam()  # `optax.adam` but for the rate, which is an argument here

    def loss(u: Array) -> Array:
        return ((predict(_from_free(u), at) - observed) ** 2).mean()

    def step(carry: Any, rate: Array) -> tuple[Any, None]:
        u, state = carry
        update, state = direction.update(jax.grad(loss)(u), state)
        return (u - rate * update, state), None

    (u, _), _ = jax.lax.scan(step, (start, direction.init(start)), rates)
    return _from_free(u)


def _from_free(u: Array) -> Array:
    """Softplus, and the exponential for n: no bounds in these."""
    return jax.nn.softplus(u).at[3].set(jnp.exp(u[3]))


def _to_free(unknowns: np.ndarray) -> Array:
    free = np.log(np.expm1(unknowns))
    free[3] = np.log(unknowns[3])
    return jnp.asarray(free, jnp.float32)
