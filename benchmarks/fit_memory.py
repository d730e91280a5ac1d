"""Peak memory of a fit beyond its inputs, which must not grow with the number of observations.

The peak is that of the process while it fits, over what it held before: image, G-buffer, and the
libraries, after a fit of more than one page has loaded and compiled all there is. On Linux only, where a
process can set its peak back.
"""

import gc
import resource
from pathlib import Path
from typing import Any

import numpy as np

import diffshade as ds
import fitting
from benchmarks import numpy_shading
from benchmarks.figures import Figure, ask
from benchmarks.scenes import Case, numbers, ours

__all__ = ["figures", "run"]

SIZES = (720, 1440, 2880)
"""Pixels across, of which about 65 % show the ball: 1, 4 and 16 million observations in RGB."""
MEGABYTE = 2.0**20


def measure(size: int) -> dict[str, Any]:
    """One RGB image of size x size pixels under three lights, whose attenuation is fitted too."""
    _fit(*_inputs(512))
    image, gbuffer, scene = _inputs(size)
    gc.collect()
    before = _resident()
    Path("/proc/self/clear_refs").write_text("5")  # the peak is set back to what is held now
    _fit(image, gbuffer, scene)
    peak = 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    observations = 3 * gbuffer.pixel_count
    planes = 6 * gbuffer.pixel_count * 4  # positions and normals
    return {
        "observations": observations,
        "inputs": (image.nbytes + planes) / MEGABYTE,
        "beyond": (peak - before) / MEGABYTE,
        "bytes an observation": (peak - before) / observations,
    }


def _inputs(size: int) -> tuple[np.ndarray, ds.GBuffer, ds.Scene]:
    case = Case(size=size, lights=3)
    plain = numbers(case)
    points, inside = numpy_shading.points(size, plain["extent"], np.float32)
    image = np.zeros((size, size, 3), np.float32)
    image[inside] = numpy_shading.shade(points, plain)
    gbuffer, scene, _ = ours(case)
    return image, gbuffer, scene


def _fit(image: np.ndarray, gbuffer: ds.GBuffer, scene: ds.Scene) -> None:
    fit = fitting.fit(image, gbuffer, scene, attenuation=ds.QuadraticAttenuation)
    assert fit.converged


def _resident() -> float:
    """Bytes that the process holds."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return float(pages * resource.getpagesize())


def run() -> dict[str, Any]:
    """Each size in a process of its own."""
    return {str(size): ask("fit_memory", size=size) for size in SIZES}


def figures(results: dict[str, Any]) -> list[Figure]:
    """Memory beyond the inputs by size, and how it grows from the least size to the largest."""
    rows = [
        Figure(f"memory beyond the inputs, {found['observations'] / 1e6:.0f} million", value, "MiB")
        for found in results.values()
        for value in (found["beyond"],)
    ]
    found = list(results.values())
    growth = (found[-1]["beyond"] - found[0]["beyond"]) * MEGABYTE
    more = found[-1]["observations"] - found[0]["observations"]
    return [*rows, Figure("bytes more for each further observation", growth / more, most=1)]
