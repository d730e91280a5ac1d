"""A thousand lights: what leaving out those that a tile can do without saves, beside its error.

    taskset -c 0 python -m benchmarks.many_lights

One core, CPU time, float32. All programs of a scene take their turn in every round; times and ratios are
medians over the rounds. The error is the largest difference from all lights, over pixels and channels.
"""

import argparse
import os
import time
from collections.abc import Callable
from typing import Any, NamedTuple
from unittest import mock

import jax
import numpy as np

import diffshade as ds
from benchmarks.figures import Figure, ask, in_turn, median, paired_ratio
from benchmarks.scenes import Case, perspective
from diffshade.fusion import processors
from diffshade.shading import image

__all__ = ["Row", "figures", "lit", "measured", "run", "table"]

TOLERANCES = (0.0, 1 / 2040, 1 / 510, 1 / 128, 1 / 32)
ALL = "all lights"
REACHING = "those that reach a tile"
ASKED = "tolerance 0.00781"
"""The largest tolerance whose error is below 1/510."""
MOST = {REACHING: 0.2, ASKED: 0.5}
FINITE, INVERSE_SQUARE = "of finite reach", "inverse square"


class Row(NamedTuple):
    """A program: milliseconds, their ratio to those of all lights, and the error."""

    name: str
    milliseconds: float
    ratio: float
    error: float


def lit(count: int, finite: bool) -> ds.Scene:
    """Lights around a unit ball: close above its visible half and of finite reach, or everywhere."""
    rng = np.random.default_rng(0)
    away = rng.normal(size=(count, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    strength = rng.uniform(0.01, 0.05, count)
    law: Any = ds.InverseSquare()
    height = rng.uniform(0.02, 2, count)
    if finite:
        away[:, 2] = np.abs(away[:, 2])
        height[:] = 0.1
        law = ds.Windowed(ds.QuadraticAttenuation(1, 0, 10), reach=0.34)
    else:
        strength *= height**2  # far lamps are strong ones
    places = (away * (1 + height[:, None])).tolist()
    lights = (ds.PointLight(p, float(i), law) for p, i in zip(places, strength, strict=True))
    return ds.Scene((0.3, 0.3, 0.3), tuple(lights))


def measured(size: int, count: int, finite: bool, rounds: int) -> tuple[list[Row], float]:
    """Each program's row, and which part of the pixels a light reaches."""
    gbuffer, scene = ds.gbuffer(ds.Sphere(), perspective(Case(size))), lit(count, finite)
    material = ds.Material(
        ka=(0.1, 0.08, 0.06), kd=(0.6, 0.4, 0.2), specular=ds.Phong((0.4, 0.4, 0.5), 32.0)
    )

    def compiled(tolerance: float | None) -> Callable[[], jax.Array]:
        def shade(gbuffer: ds.GBuffer, scene: ds.Scene, material: ds.Material) -> jax.Array:
            return ds.render(gbuffer, scene, material, tolerance=tolerance)

        step = jax.jit(shade, compiler_options=ds.compiler_options())
        program = step.lower(gbuffer, scene, material).compile()
        return lambda: jax.block_until_ready(program(gbuffer, scene, material))

    with mock.patch.object(image, "MANY", count + 1):  # nobody asks how far lights reach
        programs = {ALL: compiled(None)}
    jax.clear_caches()
    if finite:
        programs[REACHING] = compiled(None)
    else:
        programs |= {f"tolerance {t:.5f}": compiled(t) for t in TOLERANCES}
    exact = programs[ALL]()
    seen = in_turn(programs, rounds, time.process_time)
    rows = [
        Row(
            name,
            1e3 * median(times),
            paired_ratio(times, seen[ALL]),
            float(np.abs(programs[name]() - exact).max()),
        )
        for name, times in seen.items()
    ]
    return rows, reached(gbuffer, scene)


def reached(gbuffer: ds.GBuffer, scene: ds.Scene) -> float:
    """The part of the foreground to which a light's window lets it through, on average."""
    assert gbuffer.position is not None
    points = np.asarray(gbuffer.position.to_array())
    parts = []
    for light in scene.lights:
        assert isinstance(light, ds.PointLight)
        far = np.linalg.norm(points - np.asarray(light.position), axis=1)
        law = light.attenuation
        parts.append((far < float(law.reach)).mean() if isinstance(law, ds.Windowed) else 1.0)
    return float(np.mean(parts))


def measure(size: int, count: int, rounds: int) -> dict[str, Any]:
    """The rows of both kinds of lights."""
    return {
        kind: measured(size, count, kind == FINITE, rounds)[0] for kind in (FINITE, INVERSE_SQUARE)
    }


def run(size: int = 512, count: int = 1024, rounds: int = 7) -> dict[str, Any]:
    """In a process of its own, on one core."""
    return ask("many_lights", cores=1, size=size, count=count, rounds=rounds)


def figures(results: dict[str, Any]) -> list[Figure]:
    """Ratios to all lights, and errors."""
    found = []
    for kind, rows in results.items():
        for row in (Row(*row) for row in rows):
            if row.name != ALL:
                name = f"1,024 lights, {kind}, {row.name}"
                found += [
                    Figure(f"{name}, over all lights", row.ratio, most=MOST.get(row.name)),
                    Figure(f"{name}: error", row.error, tolerance=1.0),
                ]
    return found


def table(rows: list[Row]) -> str:
    """The rows as Markdown."""
    lines = ["| | ms | over all lights | error |", "|---|---|---|---|"]
    lines += [f"| {r.name} | {r.milliseconds:.0f} | {r.ratio:.2f} | {r.error:.1e} |" for r in rows]
    return "\n".join(lines)


def main() -> None:
    """Measure, and print tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--size", type=int, default=512, help="pixels a side")
    parser.add_argument("--lights", type=int, default=1024)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    if processors() > 1:
        parser.error(f"{processors()} cores: choose one, as in `taskset -c 0`")
    for finite in (True, False):
        rows, part = measured(options.size, options.lights, finite, options.rounds)
        kind = f"of finite reach, each to {part:.1%} of the pixels" if finite else "inverse square"
        print(f"{options.lights} lights, {kind}; load {os.getloadavg()[0]:.1f}\n\n{table(rows)}\n")


if __name__ == "__main__":
    main()
