"""Success over random truths, without noise: what is identified comes back, and is not disowned.

A coefficient is identified when its Cramer-Rao standard error at the truth is under 10 %, for noise
of a thousandth of the image's maximum; one that is 0, when the error is under 10 % of its scale (1 for
l0, l1, l2, for k_s the largest k). It must come back within 1e-3, and not be among `unidentified`.
"""

from typing import Any

import jax
import numpy as np

import diffshade as ds
import fitting
from benchmarks.figures import Figure, ask
from benchmarks.fit_truths import (
    BOUNDARIES,
    Ball,
    Truth,
    ball,
    draw,
    errors,
    magnitude,
    observe,
    reported,
    scene,
    standard_errors,
)

__all__ = ["figures", "judge", "run"]

NOISE, IDENTIFIED, WITHIN = 1e-3, 0.10, 1e-3
EXACT = {64: 1e-9, 32: 1e-4}


def judge(fit: fitting.Fit, truth: Truth, ball: Ball, brightest: float) -> dict[str, Any]:
    """The largest error among what is identified, and what of it the fit calls unidentified."""
    assert fit.reference_distance is not None
    d0 = fit.reference_distance
    bounds, off = standard_errors(truth, ball, d0), errors(fit.coefficients, truth, d0)
    true = reported(truth.unknowns, d0)
    disowned = {name for item in fit.unidentified for name in item.coefficients}
    known_errors: dict[str, float] = {}
    told, refused = 0, []
    for name, value in true.items():
        scale = np.where(value == 0, magnitude(name, true), np.abs(value))
        known = NOISE * brightest * bounds[name] / scale < IDENTIFIED
        told += int(np.sum(known))
        known_errors[name] = float(np.max(np.where(known, off[name], 0)))
        # A coefficient of 0 has no relative error: to report it either way is right.
        if np.all(known & (value != 0)) and name in disowned:
            refused.append(name)
    worst = max(known_errors, key=lambda name: np.nan_to_num(known_errors[name], nan=np.inf))
    return {
        "error": known_errors[worst],
        "worst": worst,
        "identified": told,
        "refused": refused,
    }


def measure(count: int, size: int) -> dict[str, Any]:
    """`count` truths in turn inner and on each boundary, under one to four lights, grey and RGB."""
    surface = ball(size)
    rng = np.random.default_rng(0)
    dtype = np.float64 if jax.config.jax_enable_x64 else np.float32
    rows = []
    for k in range(count):
        kind: dict[str, Any] = {
            "boundary": BOUNDARIES[k % 5],
            "lights": k // 5 % 4 + 1,
            "channels": (1, 3)[k // 20 % 2],
        }
        truth = draw(rng, **kind)
        image = observe(truth, surface).astype(dtype)
        fit = fitting.fit(image, surface.gbuffer, scene(truth), attenuation=ds.QuadraticAttenuation)
        judged = judge(fit, truth, surface, float(image.max()))
        success = judged["error"] < WITHIN and not judged["refused"]
        rows.append({**kind, **judged, "success": success, "shininess": truth.shininess})
    return {"truths": rows}


def run(count: int = 200, size: int = 128) -> dict[str, Any]:
    """Both precisions, each in its own process."""
    return {
        str(precision): ask("fit_accuracy", precision=precision, count=count, size=size)["truths"]
        for precision in (64, 32)
    }


def figures(results: dict[str, Any]) -> list[Figure]:
    """Success in per cent, and the largest error, by precision."""
    rows = []
    for precision, truths in results.items():
        name = f"{len(truths)} random truths, float{precision}"
        success = 100 * float(np.mean([truth["success"] for truth in truths]))
        worst = float(np.max([truth["error"] for truth in truths]))
        rows += [
            Figure(f"{name}: success", success, "%", least=100),
            Figure(f"{name}: largest error", worst, most=EXACT[int(precision)]),
            Figure(
                f"{name}: reported unidentified, but identified",
                sum(len(truth["refused"]) for truth in truths),
                most=0,
            ),
        ]
    return rows
