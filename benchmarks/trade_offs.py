"""Error against run time: precision and path, shading frequency, lights left out, pixels used by a fit.

    python -m benchmarks.suite trade-offs        measures, and draws trade-offs.png

Curves of points (label, milliseconds, error), one core, CPU time. Errors are the largest, over pixels
and channels, beside the image in float64 of the plain path; of shading frequencies the root mean square,
beside the true sphere; of fits the largest relative ones of k_d and n.
"""

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import jax
import numpy as np

import diffshade as ds
import fitting
from benchmarks import many_lights
from benchmarks.figures import Figure, ask, in_turn, median
from benchmarks.mesh import icosphere
from benchmarks.scenes import EYE, ours, perspective
from benchmarks.scenes import Case as Ball

__all__ = ["figures", "run"]

Case = tuple[str, str]
"""The name of a curve, and a label on it."""
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
    calls, exact = {}, {}
    for size in (128, 256, 512, 1024):
        with jax.enable_x64(True):
            image = np.asarray(ds.render(*_ball(size), plain=True))
        arguments = _ball(size)
        for path, plain in (("led", False), ("plain", True)):
            case = f"float{bits}, {path}", f"{size}"
            calls[case], exact[case] = _rendered(*arguments, plain=plain), image

    def error(case: Case) -> float:
        return float(np.abs(np.asarray(calls[case]()) - exact[case]).max())

    return _curves(calls, error)


def frequencies() -> dict[str, list[Point]]:
    """A sphere's triangles shaded once a face, a vertex and a pixel: beside the sphere itself."""
    camera = ds.OrthographicCamera(512, 512, 2.2)
    _, scene, material = ours(Ball(size=512))
    exact = np.asarray(ds.render(ds.gbuffer(ds.Sphere(), camera), scene, material))
    calls, both = {}, {}
    for levels in (2, 3, 4, 5, 6):
        mesh = icosphere(levels)
        for name, frequency in FREQUENCIES.items():
            case = name, f"{20 * 4**levels:,}"
            surface = ds.gbuffer(mesh, camera, shading=frequency)
            calls[case] = _rendered(surface, scene, material)
            both[case] = surface.mask & (exact.sum(-1) > 0)  # silhouettes are another question

    def error(case: Case) -> float:
        off = np.asarray(calls[case]()) - exact
        return float(np.sqrt((off[both[case]] ** 2).mean()))

    return _curves(calls, error)


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
    gbuffer, scene, material = ours(Ball(size=size), perspective(Ball(size)))
    exact = np.asarray(ds.render(gbuffer, scene, material))
    rng = np.random.default_rng(0)
    noisy = (exact + rng.normal(0, 0.005, exact.shape)).astype(exact.dtype)
    truth = {"kd": material.kd, "specular.0.shininess": material.specular[0].shininess}
    inside = np.flatnonzero(np.asarray(gbuffer.mask))
    position, normal = (
        np.asarray(gbuffer.to_image((v.x, v.y, v.z))) for v in (gbuffer.position, gbuffer.normal)
    )
    calls: dict[Case, Callable[[], fitting.Fit]] = {}
    for share in (64, 16, 4, 1):
        chosen = np.zeros(size * size, bool)
        chosen[rng.permutation(inside)[: len(inside) // share]] = True
        few = ds.GBuffer.from_arrays(position, normal, chosen.reshape(size, size), eye=EYE)
        label = f"1/{share}" if share > 1 else "all"
        calls["k_d and n, noise 0.005", label] = partial(fitting.fit, noisy, few, scene)

    def error(case: Case) -> float:
        found = calls[case]().coefficients
        return max(
            float(np.abs(np.asarray(found[name]) / np.asarray(value) - 1).max())
            for name, value in truth.items()
        )

    return _curves(calls, error)


MEASURED: dict[str, Callable[[], dict[str, list[Point]]]] = {
    "precision and path": paths,
    "shading frequency over triangles": frequencies,
    "1,024 lights over the tolerance": tolerances,
    "fit over the pixels used": fits,
}


def _ball(size: int) -> tuple[Any, Any, Any]:
    case = Ball(size=size)
    return ours(case, perspective(case))


def _rendered(g: Any, scene: Any, material: Any, plain: bool = False) -> Callable[[], Any]:
    return lambda: ds.render(g, scene, material, plain=plain).block_until_ready()


def _curves(
    calls: Mapping[Case, Callable[[], Any]], error: Callable[[Case], float]
) -> dict[str, list[Point]]:
    """Median times, all in turn, and errors, by the names of the curves."""
    curves: dict[str, list[Point]] = {}
    for case, times in in_turn(calls, ROUNDS, time.process_time).items():
        name, label = case
        curves.setdefault(name, []).append((label, 1e3 * median(times), error(case)))
    return curves


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
