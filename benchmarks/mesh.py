"""The G-buffer of a mesh: its time over that of the bare ray cast, and where the time goes.

    python -m benchmarks.mesh

The bare cast is Embree's alone, of ready rays in single precision at a scene that is built: one call,
on one core, of the rays of all pixels. The G-buffer is cast on all cores, and only with rays that meet
the ball around the mesh; what each of the two does for the bare cast is shown below it. Every figure is
a median over rounds in which all that is compared takes its turn; ratios are medians of the rounds' own.
Open3D and Mitsuba cast the same rays where they are installed, on all cores: `taskset -c 0` for one.
"""

import argparse
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import trimesh

import diffshade as ds
from benchmarks import casters
from benchmarks.figures import Figure, ask, in_turn, median, paired_ratio
from diffshade.fusion import processors
from diffshade.geometry import raycast

__all__ = ["figures", "icosphere", "run"]

Turns = dict[str, Callable[[], Any]]

EXTENT = 2.4
"""The image's width, in radii of the sphere."""
BARE, BUILT = "bare cast", "bare cast and building the scene"
GBUFFER, UNCHANGED = "G-buffer", "unchanged geometry"


def icosphere(levels: int) -> ds.Mesh:
    """20 * 4**levels triangles, with all vertices on the unit sphere, in single precision."""
    ball = trimesh.creation.icosphere(subdivisions=levels)
    return ds.Mesh(ball.vertices.astype(np.float32), ball.faces)


def rays(mesh: ds.Mesh, camera: ds.OrthographicCamera) -> tuple[np.ndarray, ...]:
    """Vertices, triangles, and the rays' origins and directions."""
    origin, direction = (
        np.broadcast_to(np.asarray(plane.to_array(), np.float32), (camera.width**2, 3)).copy()
        for plane in camera.rays(jnp.arange(camera.width**2))
    )
    origin += np.float32([0, 0, 2])  # in front of the sphere
    return np.asarray(mesh.vertices), np.asarray(mesh.faces), origin, direction


def others(mesh: ds.Mesh, camera: ds.OrthographicCamera) -> Turns:
    """The casts of others that are installed; prints how far their hits are from ours."""
    seen, found = ds.visibility(mesh, camera), ds.gbuffer(mesh, camera)
    face, position = np.full(camera.width**2, -1), np.zeros((camera.width**2, 3))
    face[seen.index], position[seen.index] = seen.face, found.position.to_array()
    turns: Turns = {}
    for name, make in casters.CASTERS.items():
        try:
            caster = make(*rays(mesh, camera))
        except ImportError as missing:
            print(f"{name}: {missing}")
            continue
        print(f"{name}: {casters.difference(caster.hits(caster.cast()), face, position)}")
        turns[name] = caster.cast
    return turns


def measured(mesh: ds.Mesh, camera: ds.OrthographicCamera) -> Turns:
    """What takes its turn in a round."""
    points, triangles, origin, direction = rays(mesh, camera)
    meets = np.flatnonzero(np.hypot(origin[:, 0], origin[:, 1]) <= 1)
    fewer = origin[meets], direction[meets]
    cores = processors()
    threads = ThreadPoolExecutor(cores)
    parts = np.array_split(origin, cores), np.array_split(direction, cores)
    scene = raycast._embree(points, triangles)
    target = raycast._target(mesh.vertices, mesh.faces)
    seen = ds.visibility(mesh, camera)

    def built_and_cast() -> None:
        raycast._embree(points, triangles).run(origin, direction)

    def cast(make: Callable[..., Any]) -> Callable[[], Any]:
        def again() -> Any:
            target.views.clear()
            return jax.block_until_ready(make(mesh, camera))

        return again

    def from_new_arrays() -> Any:
        new = ds.Mesh(jnp.array(mesh.vertices), jnp.array(mesh.faces))
        return jax.block_until_ready(ds.gbuffer(new, camera))

    return {
        BARE: lambda: scene.run(origin, direction),
        "bare cast, of rays that meet the ball": lambda: scene.run(*fewer),
        "bare cast, on all cores": lambda: list(threads.map(scene.run, *parts)),
        GBUFFER: cast(ds.gbuffer),
        "of it the visibility": cast(ds.visibility),
        "of it the interpolation": lambda: jax.block_until_ready(ds.gbuffer(mesh, camera, seen)),
        UNCHANGED: lambda: jax.block_until_ready(ds.gbuffer(mesh, camera)),
        BUILT: built_and_cast,
        "G-buffer of new geometry": from_new_arrays,
    }


def table(seen: dict[str, list[float]]) -> str:
    """Milliseconds, and the ratio to the bare cast, as Markdown."""
    lines = ["| | ms | over the bare cast | over it and building |", "|---|---|---|---|"]
    for name, times in seen.items():
        ratios = (paired_ratio(times, seen[bare]) for bare in (BARE, BUILT))
        cells = " | ".join(f"{ratio:.2f}" for ratio in ratios)
        lines.append(f"| {name} | {1e3 * median(times):.1f} | {cells} |")
    return "\n".join(lines)


def measure(levels: int, size: int, rounds: int) -> dict[str, Any]:
    """Seconds by name, of our own part."""
    mesh, camera = icosphere(levels), ds.OrthographicCamera(size, size, EXTENT)
    return in_turn(measured(mesh, camera), rounds)


def run(levels: int = 6, size: int = 512, rounds: int = 40) -> dict[str, Any]:
    """In a process of its own."""
    return ask("mesh", levels=levels, size=size, rounds=rounds)


def figures(results: dict[str, Any]) -> list[Figure]:
    """Ratios to the bare cast."""
    return [
        Figure(f"{name} over the bare cast", paired_ratio(results[name], results[BARE]), most=most)
        for name, most in ((GBUFFER, 1.3), (UNCHANGED, None))
    ]


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--levels", type=int, default=6, help="subdivisions of the icosahedron")
    parser.add_argument("--size", type=int, default=512, help="pixels a side")
    parser.add_argument("--rounds", type=int, default=25)
    options = parser.parse_args()
    mesh = icosphere(options.levels)
    camera = ds.OrthographicCamera(options.size, options.size, EXTENT)
    print(
        f"{mesh.faces.shape[0]} triangles, {options.size} x {options.size} pixels, of which"
        f" {ds.gbuffer(mesh, camera).pixel_count} see the mesh; {processors()} cores, load"
        f" {os.getloadavg()[0]:.1f}"
    )
    turns = measured(mesh, camera) | others(mesh, camera)
    print("\n" + table(in_turn(turns, options.rounds)))


if __name__ == "__main__":
    main()
