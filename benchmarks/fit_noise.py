"""How close a fit comes to the Cramer-Rao bound, and whether its intervals hold what they promise.

A ball of 64 x 64 pixels under three near lights, many draws of the noise. The bound is that of what
was observed: with a tenth of the pixels outliers, of the other nine tenths; with clipped pixels, of
what they still tell, which is that the radiance is no less than the level.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from scipy.stats import norm

import diffshade as ds
import fitting
from benchmarks.figures import Figure, ask
from benchmarks.fit_truths import (
    Ball,
    Named,
    Truth,
    ball,
    observe,
    reported,
    scene,
    standard_errors,
)

__all__ = ["KINDS", "figures", "run"]

TRUTH = Truth(
    ka=np.array([0.12]),
    kd=np.array([0.6]),
    ks=np.array([0.4]),
    shininess=40.0,
    c1=0.2,
    c2=0.05,
    positions=np.array([[1, 1, 1.5], [-2, 1, 3.5], [0, -2.5, 2]]),
    intensities=np.array([[1.0], [1.2], [0.8]]),
)
SIZE = 64
SIGMA = 0.005
"""Of the noise, in parts of the image's maximum."""
OUTLIERS, OFF = 0.10, 0.5
"""The share of the pixels that are outliers, and their standard deviation in parts of the maximum."""
CLIPPED = 0.01
MOST = {"gaussian": 1.1, "outliers": 1.1, "clipped": 1.3}
KINDS = tuple(MOST)


class Experiment(NamedTuple):
    """How photographs are made from the exact image, and how they are fitted."""

    photograph: Callable[[np.random.Generator], np.ndarray]  # [H, W, 1]
    options: Callable[[np.ndarray], dict[str, Any]]
    information: np.ndarray  # [P], of each pixel, in parts of what it tells unspoilt


def experiment(kind: str, exact: np.ndarray, inside: np.ndarray, sigma: float) -> Experiment:
    """One of `KINDS`."""
    everything = np.ones(int(inside.sum()))

    def noisy(rng: np.random.Generator) -> np.ndarray:
        return exact + sigma * rng.standard_normal(exact.shape)

    if kind == "gaussian":
        return Experiment(noisy, lambda image: {}, everything)
    if kind == "outliers":

        def spoilt(rng: np.random.Generator) -> np.ndarray:
            image = noisy(rng)
            wrong = rng.random(exact.shape) < OUTLIERS
            image[wrong] += OFF * exact.max() * rng.standard_normal(int(wrong.sum()))
            return image

        return Experiment(spoilt, lambda image: {"robust": "tukey"}, (1 - OUTLIERS) * everything)
    assert kind == "clipped"
    level = float(np.quantile(exact[inside], 1 - CLIPPED))
    # Fisher information of a normal observation that is censored at the level
    z = (level - exact[inside][:, 0]) / sigma
    hazard = np.exp(norm.logpdf(z) - norm.logsf(z))
    information = norm.cdf(z) + norm.pdf(z) * (hazard - z)
    return Experiment(
        lambda rng: np.minimum(noisy(rng), level),
        # Compared as the fit gets it, for the level itself is rounded too.
        lambda image: {"clipped": image[..., 0] >= image.dtype.type(level)},
        information,
    )


def measure(kind: str, draws: int) -> dict[str, Any]:
    """Root mean square errors over bounds, and coverage in per cent, by coefficient."""
    surface = ball(SIZE)
    exact = observe(TRUTH, surface)
    sigma = SIGMA * float(exact.max())
    trial = experiment(kind, exact, surface.inside, sigma)
    dtype = np.float64 if jax.config.jax_enable_x64 else np.float32
    light = scene(TRUTH)
    squares: dict[str, list[float]] = {}
    covered: dict[str, list[bool]] = {}
    distances, converged = [], 0
    for draw in range(draws):
        image = trial.photograph(np.random.default_rng(draw)).astype(dtype)
        image[~surface.inside] = 0
        fit = fitting.fit(
            image,
            surface.gbuffer,
            light,
            attenuation=ds.QuadraticAttenuation,
            **trial.options(image),
        )
        assert fit.reference_distance is not None
        distances.append(fit.reference_distance)  # it moves a little with the pixels that are used
        converged += fit.converged
        for name, value in reported(TRUTH.unknowns, distances[-1]).items():
            true = float(np.squeeze(value))
            off = float(np.squeeze(fit.coefficients[name])) - true
            squares.setdefault(name, []).append(off**2)
            covered.setdefault(name, []).append(_covers(fit, name, true))
    distance = float(np.median(distances))
    bounds, unspoilt = _bounds(surface, distance, sigma, trial), _bounds(surface, distance, sigma)
    rms = {name: float(np.sqrt(np.mean(square))) for name, square in squares.items()}
    return {
        "draws": draws,
        "converged": converged,
        "over bound": {name: rms[name] / bounds[name] for name in rms},
        "over bound of unspoilt data": {name: rms[name] / unspoilt[name] for name in rms},
        "coverage": {name: 100 * float(np.mean(held)) for name, held in covered.items()},
    }


def _bounds(
    surface: Ball, distance: float, sigma: float, trial: Experiment | None = None
) -> dict[str, float]:
    weight = None if trial is None else trial.information
    bounds: Named = standard_errors(TRUTH, surface, distance, weight)
    return {name: sigma * float(np.squeeze(bound)) for name, bound in bounds.items()}


def _covers(fit: fitting.Fit, name: str, true: float) -> bool:
    low, high = fit.intervals[name]
    return bool(np.squeeze(low) <= true <= np.squeeze(high))


def run(draws: int = 1000, kinds: Sequence[str] = KINDS) -> dict[str, Any]:
    """Each kind of noise in a process of its own, in float32."""
    return {kind: ask("fit_noise", kind=kind, draws=draws) for kind in kinds}


def figures(results: dict[str, Any]) -> list[Figure]:
    """The worst coefficient of each kind of noise, and coverage of the 95 % intervals."""
    rows = []
    for kind, found in results.items():
        name = f"{kind}, {found['draws']} draws"
        over, strict = found["over bound"], found["over bound of unspoilt data"]
        worst = max(over, key=lambda coefficient: over[coefficient])
        rows += [
            Figure(f"{name}: error over bound, worst ({worst})", over[worst], most=MOST[kind]),
            Figure(f"{name}: error over bound of unspoilt data", max(strict.values())),
            Figure(f"{name}: fits that converged", 100 * found["converged"] / found["draws"], "%"),
        ]
        asked = (93.0, 97.0) if kind == "gaussian" else (None, None)
        for word, pick in (("least", min), ("most", max)):
            share = pick(found["coverage"].values())
            rows.append(Figure(f"{name}: {word} coverage of a 95 % interval", share, "%", *asked))
    return rows
