"""How time and memory grow: over cores, over the size of the image, and around the kernel.

    python -m benchmarks.scale

512 x 512 unless said, 4 point lights with attenuation, perspective view, float32. With one core and with
two are processes of their own, which take turns; a ratio is that of their best rounds.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import numpy as np

import diffshade as ds
from benchmarks import our_shading
from benchmarks.figures import Figure, ask, in_turn, paired_ratio, table
from benchmarks.scenes import Case, numbers, ours, perspective
from diffshade.shading.image import image_planes
from diffshade.shading.kept_geometry import KeptGeometry

__all__ = ["figures", "run"]

KINDS = {"one colour": False, "RGB": True}
LEAST = {"forward": 1.6, "gradient": 1.5}


def measure(rounds: int) -> dict[str, Any]:
    """Seconds on the cores of this process, and bytes."""
    calls: dict[str, Callable[[], Any]] = {}
    pixels = {}
    for kind, coloured in KINDS.items():
        for size in (512, 2048):
            case = Case(size, 4, coloured)
            gbuffer, scene, material = ours(case, perspective(case))
            surface = KeptGeometry(gbuffer, None)
            kernel = jax.jit(
                partial(image_planes, plain=False), compiler_options=ds.compiler_options()
            )
            name = f"{size}, {kind}"
            calls[f"{name}: forward"] = _waited(kernel, surface, scene, material)
            calls[f"{name}: render"] = _waited(ds.render, gbuffer, scene, material)
            calls[f"{name}: gradient"] = _gradient(gbuffer, case)
            pixels[name] = gbuffer.pixel_count
    return {"seconds": in_turn(calls, rounds), "pixels": pixels}


def _waited(f: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
    return lambda: jax.block_until_ready(f(*arguments))


def _gradient(gbuffer: ds.GBuffer, case: Case) -> Callable[[], Any]:
    assert gbuffer.position is not None
    points, normals = (np.asarray(v.to_array()).T for v in (gbuffer.position, gbuffer.normal))
    target = np.full_like(points, 0.3)
    eye = np.asarray(perspective(case).position)
    return our_shading.gradient(points, normals, eye, numbers(case), target)


def run(turns: int = 3, rounds: int = 12) -> dict[str, Any]:
    """One core and two, in turn."""
    found: dict[str, Any] = {"1": [], "2": []}
    for _ in range(turns):
        for cores, seen in found.items():
            seen.append(ask("scale", cores=int(cores), rounds=rounds))
    return found


def figures(results: dict[str, Any]) -> list[Figure]:
    """Ratios."""
    rows = []
    one, two = (
        {
            name: min(min(found["seconds"][name]) for found in results[cores])
            for name in results[cores][0]["seconds"]
        }
        for cores in ("1", "2")
    )
    for kind in KINDS:
        for what, least in LEAST.items():
            name = f"512, {kind}: {what}"
            rows.append(
                Figure(f"{kind}: {what}, one core over two", one[name] / two[name], least=least)
            )
    alone = results["1"][-1]
    seen, pixels = alone["seconds"], alone["pixels"]
    for kind in KINDS:
        small, large = f"512, {kind}", f"2048, {kind}"
        more = pixels[large] / pixels[small]
        for what in LEAST:
            times = paired_ratio(seen[f"{large}: {what}"], seen[f"{small}: {what}"])
            name = f"{kind}: {what}, a pixel at 2,048 x 2,048 over one at 512 x 512"
            rows.append(Figure(name, times / more, most=1.5))
        over = paired_ratio(seen[f"{small}: render"], seen[f"{small}: forward"])
        rows.append(Figure(f"{kind}: ds.render over the kernel", over, most=1.3))
    return rows


if __name__ == "__main__":
    print(table(figures(run())))
