"""A material for every pixel: fits a second, beside the error and the share that is identified.

    python -m benchmarks.maps                    65,536 pixels, 24 observations, grey, float32
    python -m benchmarks.maps --channels 3       colour; JAX_ENABLE_X64=1 for float64

k_d, k_s and the shininess of every pixel are drawn anew, n from 2 to 200. The ways take turns in every
round, and the figures are medians: of the whole call, from images to maps, and of its compiled program
alone, on arrays that are in memory. Errors are the largest over what is identified, without noise. The
share identified is counted by `interface.md`'s rule, for noise of a thousandth of the images' maximum.
"""

import argparse
import os
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

import diffshade as ds
import fitting
from benchmarks.figures import Figure, ask, in_turn, median, table
from fitting import pixel_maps

__all__ = ["figures", "measure", "run"]

WAYS: dict[str, int | None] = {"Optimistix": None, "6 steps": 6, "8 steps": 8}
LEAST = {"Optimistix": 200_000.0, "6 steps": 1_000_000.0}
NAMES = ("kd", "specular.0.ks", "specular.0.shininess")


def flat(count: int, rng: np.random.Generator) -> ds.GBuffer:
    """Pixels with normals of their own, spread over the cone about the view, 60 degrees to each side."""
    z, turn = rng.uniform(0.5, 1, count), rng.uniform(0, 2 * np.pi, count)
    side = np.sqrt(1 - z**2)
    normal = np.stack([side * np.cos(turn), side * np.sin(turn), z], -1)
    return ds.GBuffer.from_arrays(None, normal[None])


def lights(count: int, rng: np.random.Generator) -> list[ds.Scene]:
    """One parallel light an image, over the upper three quarters of the hemisphere."""
    z, turn = rng.uniform(0.25, 1, count), rng.uniform(0, 2 * np.pi, count)
    side = np.sqrt(1 - z**2)
    towards = np.stack([side * np.cos(turn), side * np.sin(turn), z], -1)
    return [ds.Scene(lights=ds.ParallelLight(direction)) for direction in towards]


def measure(pixels: int, images: int, channels: int, rounds: int) -> dict[str, Any]:
    """Seconds of each way, its largest errors, and what is identified."""
    rng = np.random.default_rng(3)
    gbuffer, scenes = flat(pixels, rng), lights(images, rng)
    truth = ds.Material(
        kd=rng.uniform(0.1, 0.9, (channels, pixels)),
        specular=ds.Phong(
            ks=np.exp(rng.uniform(np.log(0.05), np.log(0.9), (channels, pixels))),
            shininess=np.exp(rng.uniform(np.log(2), np.log(200), (1, pixels))),
        ),
    )
    captured = [np.asarray(ds.render(gbuffer, scene, truth)) for scene in scenes]
    lobe: Any = truth.specular[0]
    expected = dict(zip(NAMES, (truth.kd, lobe.ks, lobe.shininess), strict=True))

    calls: dict[str, Callable[[], fitting.Maps]] = {}
    programs: dict[str, Callable[[], Any]] = {}
    for way, steps in WAYS.items():
        calls[way] = _call(captured, gbuffer, scenes, steps, pixels)
        programs[way] = _program(calls[way])
    found = {way: call() for way, call in calls.items()}
    both = {(way, "whole"): call for way, call in calls.items()}
    both |= {(way, "alone"): program for way, program in programs.items()}
    seen = in_turn(both, rounds)
    return {
        way: {
            "pixels": pixels,
            "whole": median(seen[way, "whole"]),
            "alone": median(seen[way, "alone"]),
            "errors": {
                name: _worst(found[way], name, np.asarray(value))
                for name, value in expected.items()
            },
            "identified": {name: float(np.mean(found[way].identified[name])) for name in NAMES},
            "converged": float(np.mean(found[way].converged)),
        }
        for way in WAYS
    }


def _call(
    images: list[np.ndarray],
    gbuffer: ds.GBuffer,
    scenes: list[ds.Scene],
    steps: int | None,
    block: int,
) -> Callable[[], fitting.Maps]:
    return lambda: fitting.fit_maps(images, gbuffer, scenes, steps=steps, block=block)


def _program(call: Callable[[], fitting.Maps]) -> Callable[[], Any]:
    """The compiled program of a call, on arrays that are in memory."""
    real, seen = pixel_maps.fit_block, []

    def spy(*arguments: Any) -> Any:
        seen.append(arguments)
        return real(*arguments)

    pixel_maps.fit_block = spy
    try:
        call()
    finally:
        pixel_maps.fit_block = real
    return lambda: real(*seen[0])()


def _worst(maps: fitting.Maps, name: str, expected: np.ndarray) -> float:
    """The largest relative error over what is identified."""
    off = np.abs(maps.coefficients[name] / expected - 1)
    return float(np.max(off, where=maps.identified[name], initial=0))


def run(
    pixels: int = 65_536, images: int = 24, channels: int = 1, rounds: int = 7
) -> dict[str, Any]:
    """In a process of its own, in float32."""
    return ask("maps", pixels=pixels, images=images, channels=channels, rounds=rounds)


def figures(results: dict[str, Any]) -> list[Figure]:
    """Fits a second of each way, with errors and shares."""
    rows = []
    for way, result in results.items():
        rows += [
            Figure(
                f"{way}: program",
                result["pixels"] / result["alone"],
                "fits/s",
                least=LEAST.get(way),
            ),
            Figure(f"{way}: from images to maps", result["pixels"] / result["whole"], "fits/s"),
            Figure(f"{way}: converged", 100 * result["converged"], "%"),
        ]
        for name in NAMES:
            rows += [
                Figure(f"{way}: {name}, largest error", result["errors"][name], most=1e-3),
                Figure(f"{way}: {name}, identified", 100 * result["identified"][name], "%"),
            ]
    return rows


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--pixels", type=int, default=65_536)
    parser.add_argument("--images", type=int, default=24)
    parser.add_argument("--channels", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    results = measure(**vars(options))
    cores, load = len(os.sched_getaffinity(0)), os.getloadavg()[0]
    print(
        f"{options.pixels} pixels, {options.images} observations in {options.channels} channels,"
        f" float{64 if jax.config.jax_enable_x64 else 32}, {cores} cores, load {load:.1f}\n"
    )
    print(table(figures(results)))


if __name__ == "__main__":
    main()
