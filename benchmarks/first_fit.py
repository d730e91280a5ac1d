"""The first fit in a fresh process, import and compilation included, 256 x 256, RGB, three lights.

Over the time of a process that imports JAX and compiles one small function, the two started in turn.
With the on-disk compilation cache it has been filled by an earlier process.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import numpy_shading
from benchmarks.figures import ROOT, Figure, median, paired_ratio
from benchmarks.scenes import Case, numbers, ours

__all__ = ["figures", "run"]

CASE = Case(size=256, lights=3)
MOST = {"with the on-disk cache": 3.0, "without a cache": 8.0}
CACHE = {
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
}


def small_function() -> None:
    """The yardstick."""
    import jax

    jax.jit(lambda x: 2 * x + 1)(jax.numpy.ones(8)).block_until_ready()


def first_fit() -> None:
    """Import, geometry, fit; the image is read from standard input."""
    image = np.load(sys.stdin.buffer)
    clock = [time.perf_counter()]
    import jax  # noqa: F401

    clock.append(time.perf_counter())
    import diffshade as ds
    import fitting

    run_fit = fitting.fit  # resolves the lazy import
    gbuffer, scene, _ = ours(CASE)
    clock.append(time.perf_counter())
    fit = run_fit(image, gbuffer, scene, attenuation=ds.QuadraticAttenuation)
    clock.append(time.perf_counter())
    assert fit.converged
    phases = ("import jax", "import and geometry", "fit")
    print(json.dumps(dict(zip(phases, np.diff(clock).tolist(), strict=True))))


PROCESSES: dict[str, Callable[[], None]] = {"small": small_function, "fit": first_fit}


def run(rounds: int = 5) -> dict[str, Any]:
    """Both processes in turn, with a cache and without."""
    plain = numbers(CASE)
    points, inside = numpy_shading.points(CASE.size, plain["extent"], np.float64)
    image = np.zeros((*inside.shape, 3), np.float32)
    image[inside] = numpy_shading.shade(points, plain)
    results: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "image.npy"
        np.save(picture, image)
        cached = {**CACHE, "JAX_COMPILATION_CACHE_DIR": str(Path(folder) / "cache")}
        for kind, environment in zip(MOST, (cached, {}), strict=True):
            if environment:
                for what in PROCESSES:
                    _seconds(what, picture, environment)
            seen: dict[str, list[float]] = {what: [] for what in PROCESSES}
            phases = []
            for _ in range(rounds):
                for what in PROCESSES:
                    seconds, printed = _seconds(what, picture, environment)
                    seen[what].append(seconds)
                    phases += [json.loads(printed)] if printed else []
            results[kind] = {
                "seconds": seen,
                "phases": {name: median(phase[name] for phase in phases) for name in phases[0]},
            }
    return results


def _seconds(what: str, picture: Path, environment: dict[str, str]) -> tuple[float, str]:
    """The time from the start of a process to its end, and what it printed."""
    inherited = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    with picture.open("rb") as image:
        started = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-P", "-m", "benchmarks.first_fit", what],
            cwd=ROOT,
            env={**inherited, **environment, "PYTHONPATH": str(ROOT), "JAX_ENABLE_X64": "0"},
            stdin=image,
            stdout=subprocess.PIPE,
            check=True,
            text=True,
        )
        return time.perf_counter() - started, done.stdout


def figures(results: dict[str, Any]) -> list[Figure]:
    """The ratios, the times, and where the time of a first fit goes."""
    rows = []
    for kind, found in results.items():
        seconds = found["seconds"]
        rows += [
            Figure(
                f"first fit {kind}, over a process with one small function",
                paired_ratio(seconds["fit"], seconds["small"]),
                most=MOST[kind],
            ),
            Figure(f"first fit {kind}", median(seconds["fit"]), "s"),
            Figure(f"one small function {kind}", median(seconds["small"]), "s"),
        ]
        rows += [
            Figure(f"first fit {kind}: {phase}", value, "s")
            for phase, value in found["phases"].items()
        ]
    return rows


if __name__ == "__main__":
    PROCESSES[sys.argv[1]]()
