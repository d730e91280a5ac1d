"""Error against run time: precision and path, shading frequency, lights left out, pixels used by a fit.

    python -m benchmarks.suite trade-offs        measures, and draws shading.png

Curves of points (label, milliseconds, error), one core, CPU time. Errors are the largest, over pixels
and channels, beside the image in float64 of the plain path or of the true sphere; those of a fit are the
largest relative ones over its coefficients.
"""

import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

import diffshade as ds
import fitting
from benchmarks import many_lights
from benchmarks.figures import Figure, ask, in_turn, median
from benchmarks.mesh import icosphere
from benchmarks.scenes import EYE, Case, ours, perspective

__all__ = ["figures", "run"]

Point = tuple[str, float, float]
ROUNDS = 7
FREQUENCIES = {
    "flat": ds.FlatShading(),
    "Gouraud": ds.GouraudShading(),
    "Phong": ds.PhongShading(),
}


def measure(what: str) -> dict[str, list[Point]]:
    """Curves by name."""
    return MEASURED[what]()


def paths() -> dict[str, list[Point]]:
    """This process's precision, plain and led, from 128 x 128 to 1,024 x 1,024."""
    bits = 64 if jax.config.jax_enable_x64 else 32
    curves: dict[str, list[Point]] = {}
    for size in (128, 256, 512, 1024):
        with jax.enable_x64(True):
            exact = np.asarray(ds.render(*_ball(size), plain=True))
        arguments = _ball(size)
        calls = {
            f"float{bits}, {name}": _rendered(*arguments, plain=plain)
            for name, plain in (("led", False), ("plain", True))
        }
        for name, milliseconds in _timed(calls).items():
            error = float(np.abs(np.asarray(calls[name]()) - exact).max())
            curves.setdefault(name, []).append((f"{size}", milliseconds, error))
    return curves


def frequencies() -> dict[str, list[Point]]:
    """A sphere's triangles shaded once a face, a vertex and a pixel: beside the sphere itself."""
    size = 512
    camera = ds.OrthographicCamera(size, size, 2.2)
    _, scene, material = ours(Case(size=size))
    exact = np.asarray(ds.render(ds.gbuffer(ds.Sphere(), camera), scene, material))
    curves: dict[str, list[Point]] = {}
    for levels in (2, 3, 4, 5, 6):
        mesh = icosphere(levels)
        surfaces = {
            name: ds.gbuffer(mesh, camera, shading=frequency)
            for name, frequency in FREQUENCIES.items()
        }
        calls = {name: _rendered(g, scene, material) for name, g in surfaces.items()}
        for name, milliseconds in _timed(calls).items():
            off = np.asarray(calls[name]()) - exact
            both = surfaces[name].mask & (exact.sum(-1) > 0)  # the silhouette is another question
            error = float(np.sqrt((off[both] ** 2).mean()))
            curves.setdefault(name, []).append((f"{20 * 4**levels:,}", milliseconds, error))
    return curves


def tolerances() -> dict[str, list[Point]]:
    """A thousand lights, and how many of them a tile may leave out."""
    found = {
        kind: many_lights.measured(512, 1024, kind == many_lights.FINITE, 3)[0]
        for kind in (many_lights.FINITE, many_lights.INVERSE_SQUARE)
    }
    return {
        kind: [(row.name, row.milliseconds, row.error) for row in rows]
        for kind, rows in found.items()
    }


def fits() -> dict[str, list[Point]]:
    """A fit of noisy observations, of all of the pixels and of ever fewer."""
    size = 512
    gbuffer, scene, material = ours(Case(size=size), perspective(Case(size)))
    exact = np.asarray(ds.render(gbuffer, scene, material))
    rng = np.random.default_rng(0)
    noisy = (exact + rng.normal(0, 0.005, exact.shape)).astype(exact.dtype)
    truth = {"kd": material.kd, "specular.0.shininess": material.specular[0].shininess}
    inside = np.flatnonzero(np.asarray(gbuffer.mask))
    position, normal = (
        np.asarray(gbuffer.to_image((v.x, v.y, v.z))) for v in (gbuffer.position, gbuffer.normal)
    )
    points: list[Point] = []
    for share in (64, 16, 4, 1):
        chosen = np.zeros(size * size, bool)
        chosen[rng.permutation(inside)[: len(inside) // share]] = True
        few = ds.GBuffer.from_arrays(position, normal, chosen.reshape(size, size), eye=EYE)

        def fit(few: ds.GBuffer = few) -> fitting.Fit:
            return fitting.fit(noisy, few, scene)

        milliseconds = _timed({"fit": fit})["fit"]
        found = fit().coefficients
        error = max(
            float(np.abs(np.asarray(found[name]) / np.asarray(value) - 1).max())
            for name, value in truth.items()
        )
        points.append((f"1/{share}" if share > 1 else "all", milliseconds, error))
    return {"k_d and n, noise 0.005": points}


MEASURED: dict[str, Callable[[], dict[str, list[Point]]]] = {
    "precision and path": paths,
    "shading frequency over triangles": frequencies,
    "1,024 lights over the tolerance": tolerances,
    "fit over the pixels used": fits,
}


def _ball(size: int) -> tuple[Any, Any, Any]:
    case = Case(size=size)
    return ours(case, perspective(case))


def _rendered(g: Any, scene: Any, material: Any, plain: bool = False) -> Callable[[], Any]:
    return lambda: ds.render(g, scene, material, plain=plain).block_until_ready()


def _timed(calls: dict[str, Callable[[], Any]]) -> dict[str, float]:
    """Median milliseconds."""
    seen = in_turn(calls, ROUNDS, time.process_time)
    return {name: 1e3 * median(times) for name, times in seen.items()}


def run() -> dict[str, Any]:
    """Each curve in a process of its own, the first in both precisions."""
    found = {what: ask("trade_offs", cores=1, what=what) for what in MEASURED}
    first = next(iter(MEASURED))
    found[first] |= ask("trade_offs", cores=1, precision=64, what=first)
    return found


def figures(results: dict[str, Any]) -> list[Figure]:
    """The errors: times depend on the machine."""
    return [
        Figure(f"{what}, {name}, {label}: error", error, tolerance=0.5)
        for what, curves in results.items()
        for name, points in curves.items()
        for label, _, error in points
    ]
