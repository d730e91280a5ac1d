"""What is absent is not paid for: the time of shading without a part, over that of the whole.

    taskset -c 0 python -m benchmarks.skipping

One core, CPU time, float32. All cases take their turn in every round; times and ratios are medians
over the rounds. A case is a row of `cases`: what it is called, what it is compared with, and the call.
"""

import argparse
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import diffshade as ds
from benchmarks.figures import Figure, ask, in_turn, median, paired_ratio
from benchmarks.mesh import icosphere
from benchmarks.scenes import Case as Ball
from benchmarks.scenes import ours
from diffshade.fusion import processors
from diffshade.shading.image import image_planes
from diffshade.shading.kept_geometry import KeptGeometry

__all__ = ["Case", "cases", "figures", "run"]


class Case(NamedTuple):
    """A call that waits for its result; `against` is the name of the case that it is compared with."""

    name: str
    against: str
    call: Callable[[], Any]


WHOLE = "the whole: 4 RGB point lights, attenuation, ambient, diffuse, Phong"
GRADIENT = "gradient of the squared error in all 13 coefficients"
PIXELS = "a mesh shaded once a pixel (Phong)"
KEPT = "basis kept"
FULL = "no background: every pixel is shaded"
MOST = {KEPT: 0.15}


def cases(size: int) -> Iterator[Case]:
    """All that is compared."""
    gbuffer, scene, material = ours(Ball(size=size))
    bare = tuple(replace(light, attenuation=None) for light in scene.lights)
    parallel = tuple(ds.ParallelLight(light.position, light.intensity) for light in scene.lights)
    white = tuple(replace(light, intensity=light.intensity[0]) for light in scene.lights)

    # Parts of the equation
    yield Case(WHOLE, WHOLE, shaded(gbuffer, scene, material))
    for name, less, of in (
        ("no ambient term", replace(scene, ambient=None), replace(material, ka=None)),
        ("no diffuse term", scene, replace(material, kd=None)),
        ("no lobe", scene, replace(material, specular=())),
        ("no attenuation", replace(scene, lights=bare), material),
        ("parallel lights", replace(scene, lights=parallel), material),
        ("lights of one colour", replace(scene, lights=white), material),
        ("one light of the four", replace(scene, lights=scene.lights[:1]), material),
    ):
        yield Case(name, WHOLE, shaded(gbuffer, less, of))

    # Pixels
    yield Case(FULL, FULL, shaded(slab(size), scene, material))
    left = np.arange(size) < size // 2
    yield Case(
        "half of them background",
        FULL,
        shaded(slab(size, np.broadcast_to(left, (size, size))), scene, material),
    )

    # Shading frequency
    mesh, camera = icosphere(4), ds.OrthographicCamera(size, size, 2.2)
    for name, frequency in (
        (PIXELS, ds.PhongShading()),
        ("once a vertex (Gouraud), 2,562 vertices", ds.GouraudShading()),
        ("once a face (flat), 5,120 faces", ds.FlatShading()),
    ):
        yield Case(
            name, PIXELS, shaded(ds.gbuffer(mesh, camera, shading=frequency), scene, material)
        )

    # What is known already
    kept = ds.keep_geometry(gbuffer, scene, material)
    yield Case("geometry kept", WHOLE, shaded(kept, scene, material))
    contract = jitted(ds.contract)
    yield Case(KEPT, WHOLE, partial(contract, ds.basis(gbuffer, scene, material), material))

    # Coefficients that a gradient is not asked for
    observed = 0.9 * jnp.stack(shaded(gbuffer, scene, material)())
    law = scene.lights[0].attenuation
    every = {
        "ka": material.ka,
        "kd": material.kd,
        "ks": material.specular[0].ks,
        "shininess": material.specular[0].shininess,
        "law": law,
    }
    for name, free, surface in (
        (GRADIENT, tuple(every), gbuffer),
        ("all but k_d held", ("kd",), gbuffer),
        ("all but k_d and k_s held", ("kd", "ks"), gbuffer),
        ("shininess alone", ("shininess",), gbuffer),
        ("all 13, geometry kept", tuple(every), kept),
    ):
        yield Case(name, GRADIENT, gradient(surface, scene, every, free, observed))


def jitted(f: Callable[..., Any]) -> Callable[..., Any]:
    """Compiled with the options for the platform, and waited for."""
    program = jax.jit(f, compiler_options=ds.compiler_options())
    return lambda *arguments: jax.block_until_ready(program(*arguments))


def shaded(
    surface: ds.GBuffer | ds.KeptGeometry, scene: ds.Scene, material: ds.Material
) -> Callable[[], Any]:
    """The image's planes: what `render` computes, without their placing into an image."""
    one = KeptGeometry(surface, None) if isinstance(surface, ds.GBuffer) else surface
    return partial(jitted(partial(image_planes, plain=False)), one, scene, material)


def slab(size: int, mask: np.ndarray | None = None) -> ds.GBuffer:
    """A wavy surface that fills the image."""
    y, x = np.mgrid[1 : -1 : size * 1j, -1 : 1 : size * 1j].astype(np.float32)
    normal = np.stack([0.3 * np.sin(5 * x), 0.3 * np.sin(5 * y), np.ones_like(x)], -1)
    return ds.GBuffer.from_arrays(np.stack([x, y, np.zeros_like(x)], -1), normal, mask)


def gradient(
    surface: ds.GBuffer | ds.KeptGeometry,
    scene: ds.Scene,
    every: dict[str, Any],
    free: tuple[str, ...],
    observed: jax.Array,
) -> Callable[[], Any]:
    """The squared error and its gradient in the `free` coefficients; the others are held."""

    def loss(moving: dict[str, Any], held: dict[str, Any], surface: Any, observed: Any) -> Any:
        c = moving | held
        lights = tuple(replace(light, attenuation=c["law"]) for light in scene.lights)
        lobe = ds.Phong(c["ks"], c["shininess"])
        material = ds.Material(c["ka"], c["kd"], lobe)
        return ds.mean_squared_error(surface, replace(scene, lights=lights), material, observed)

    moving = {name: every[name] for name in free}
    held = {name: x for name, x in every.items() if name not in free}
    return partial(jitted(jax.value_and_grad(loss)), moving, held, surface, observed)


def measure(size: int, rounds: int) -> dict[str, Any]:
    """CPU seconds of each case, and what it is compared with."""
    rows = tuple(cases(size))
    seen = in_turn({case.name: case.call for case in rows}, rounds, time.process_time)
    return {case.name: {"seconds": seen[case.name], "against": case.against} for case in rows}


def run(size: int = 512, rounds: int = 25) -> dict[str, Any]:
    """In a process of its own, on one core."""
    return ask("skipping", cores=1, size=size, rounds=rounds)


def ratio(results: dict[str, Any], name: str) -> float:
    """Of a case to the one that it is compared with."""
    found = results[name]
    return paired_ratio(found["seconds"], results[found["against"]]["seconds"])


def figures(results: dict[str, Any]) -> list[Figure]:
    """The ratios."""
    return [
        Figure(f"{name}, over: {found['against']}", ratio(results, name), most=MOST.get(name))
        for name, found in results.items()
        if name != found["against"]
    ]


def table(results: dict[str, Any]) -> str:
    """CPU time and its ratio to that of the case compared with, as Markdown."""
    lines = ["| | ms | over the whole |", "|---|---|---|"]
    for name, found in results.items():
        shown = f"**{name}**" if name == found["against"] else name
        times = f"{1e3 * median(found['seconds']):.2f}"
        lines.append(f"| {shown} | {times} | {ratio(results, name):.2f} |")
    return "\n".join(lines)


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--size", type=int, default=512, help="pixels a side")
    parser.add_argument("--rounds", type=int, default=25)
    options = parser.parse_args()
    if processors() > 1:
        parser.error(f"{processors()} cores: choose one, as in `taskset -c 0`")
    print(
        f"{options.size} x {options.size}, JAX {jax.__version__}, load {os.getloadavg()[0]:.1f};"
        " each row is compared with the bold one above it, or with the first\n"
    )
    print(table(measure(options.size, options.rounds)))


if __name__ == "__main__":
    main()
