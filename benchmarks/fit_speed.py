"""Run time of a fit beside its error, warm, from image and G-buffer to coefficients, float32."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import diffshade as ds
import fitting
from benchmarks import fit_rivals as rivals
from benchmarks.figures import Figure, ask, in_turn, median, paired_ratio
from benchmarks.fit_truths import (
    Ball,
    Truth,
    ball,
    draw,
    errors,
    observe,
    reported,
    scene,
    terms_of,
)
from benchmarks.plain_phong import jacobian, predict

__all__ = ["figures", "run"]

OURS = "fitting.fit"
SPEEDUP = {"SciPy TRF": 100.0, "lmfit": 20.0, "Adam": 100.0, "Optimistix LM": None}
SMALL, LARGE = 256, 1024
LIGHTS = 3


class Picture:
    """An exact observation of a truth, in float32, and where the rivals start."""

    def __init__(self, truth: Truth, surface: Ball, start: np.ndarray) -> None:
        self.truth, self.ball, self.start = truth, surface, start
        self.image = observe(truth, surface).astype(np.float32)
        self.scene = scene(truth)

    def fit(self) -> fitting.Fit:
        """By the public interface."""
        return fitting.fit(
            self.image, self.ball.gbuffer, self.scene, attenuation=ds.QuadraticAttenuation
        )

    def by(self, rival: rivals.Rival) -> np.ndarray:
        """By another solver."""
        return rival(self.image, self.ball, self.truth, self.start)

    def error(self, unknowns: np.ndarray, d0: float) -> float:
        """The largest error of a rival's over the coefficients at the reference distance d0."""
        return worst(reported(unknowns, d0), self.truth, d0)


def worst(found: Mapping[str, Any], truth: Truth, d0: float) -> float:
    """The largest error over the coefficients at the reference distance d0."""
    return max(float(np.max(off)) for off in errors(found, truth, d0).values())


def measure(truths: int, rounds: int, start: str) -> dict[str, Any]:
    """Every method in turn, on every truth, in every round; then sizes and colours of ours."""
    _check_jacobian()
    rng = np.random.default_rng(5)
    grey = [draw(rng, lights=LIGHTS, channels=1) for _ in range(truths)]
    starts = [rivals.GUESS if start == "guess" else rivals.random_start(rng) for _ in grey]
    small, large = ball(SMALL), ball(LARGE)
    pictures = [Picture(truth, small, at) for truth, at in zip(grey, starts, strict=True)]

    fits = [picture.fit() for picture in pictures]  # and everything compiles here
    distances = [float(fit.reference_distance or np.nan) for fit in fits]
    found = {
        OURS: [
            worst(fit.coefficients, truth, d0)
            for fit, truth, d0 in zip(fits, grey, distances, strict=True)
        ]
    }

    def errors_of(solver: rivals.Rival) -> list[float]:
        return [p.error(p.by(solver), d0) for p, d0 in zip(pictures, distances, strict=True)]

    schedules = rivals.adam_schedules()
    tried = {name: median(errors_of(rivals.adam(s))) for name, s in schedules.items()}
    schedule = min(tried, key=lambda name: tried[name])
    solvers = {
        "SciPy TRF": rivals.scipy_trf,
        "lmfit": rivals.lmfit_leastsq,
        "Adam": rivals.adam(schedules[schedule]),
        "Optimistix LM": rivals.optimistix,
    }
    found |= {name: errors_of(solver) for name, solver in solvers.items()}
    methods = [
        {OURS: p.fit} | {name: partial(p.by, solver) for name, solver in solvers.items()}
        for p in pictures
    ]
    sizes = [
        {
            "grey": picture.fit,
            "RGB": Picture(_coloured(picture.truth), small, picture.start).fit,
            "1024 x 1024": Picture(picture.truth, large, picture.start).fit,
        }
        for picture in pictures
    ]
    return {
        "start": start,
        "schedule": schedule,
        "schedules tried": tried,
        "errors": found,
        "seconds": _interleaved(methods, rounds),
        "sizes": _interleaved(sizes, rounds),
    }


def _check_jacobian() -> None:
    """The rivals' Jacobian is the derivative of their model."""
    truth, points = draw(np.random.default_rng(0), lights=2, channels=3), ball(16).points
    with jax.enable_x64(True):
        unknowns, at = jnp.asarray(truth.unknowns), terms_of(truth, points)
        np.testing.assert_allclose(
            jacobian(unknowns, at), jax.jacfwd(predict)(unknowns, at), atol=1e-12
        )


def _coloured(truth: Truth) -> Truth:
    """The same truth in three channels."""
    tints = np.array([1.0, 0.8, 0.6])
    return truth._replace(
        ka=truth.ka * tints,
        kd=truth.kd * tints,
        ks=truth.ks * tints[::-1],
        intensities=truth.intensities * tints,
    )


def _interleaved(turns: list[dict[str, Callable[[], Any]]], rounds: int) -> dict[str, list[float]]:
    """Seconds by name, one for each round and set of turns, all names in turn within each."""
    seen = in_turn(
        {(k, name): calls[name] for k, calls in enumerate(turns) for name in calls}, rounds
    )
    each = range(len(turns))
    return {
        name: [seen[k, name][number] for number in range(rounds) for k in each] for name in turns[0]
    }


def run(truths: int = 5, rounds: int = 5, start: str = "guess") -> dict[str, Any]:
    """In a process of its own, in float32; the rivals start from "guess" or "random"."""
    return ask("fit_speed", truths=truths, rounds=rounds, start=start)


def figures(results: dict[str, Any]) -> list[Figure]:
    """Ratios to the rivals with their times and errors, and of sizes and colours."""
    seconds, sizes = results["seconds"], results["sizes"]
    rows = []
    for name, times in seconds.items():
        rows += [
            Figure(f"{name}: time", 1e3 * median(times), "ms"),
            Figure(f"{name}: median error", median(results["errors"][name])),
            Figure(f"{name}: largest error", max(results["errors"][name])),
        ]
    for name, least in SPEEDUP.items():
        rows.append(
            Figure(f"{name} / ours", paired_ratio(seconds[name], seconds[OURS]), least=least)
        )
    return [
        *rows,
        Figure("RGB / grey", paired_ratio(sizes["RGB"], sizes["grey"]), most=2),
        Figure(
            "1024 x 1024 / 256 x 256",
            paired_ratio(sizes["1024 x 1024"], sizes["grey"]),
            most=30,
        ),
    ]
