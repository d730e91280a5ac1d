"""Captures of many sizes: programs that are compiled for them, and seconds.

    python -m benchmarks.sizes                 a hundred sizes
    python -m benchmarks.sizes --without 5     of which five without buckets

Each function is called outermost, once for every size, in one process that starts without a cache of
compiled programs. Without buckets: with arrays that are committed to a device, which are not padded, so
that every size has its own program; `fit`, which pads what it is given itself, has no such column.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

import diffshade as ds
import fitting
from benchmarks.figures import Figure, ask

__all__ = ["figures", "run"]

SCENE = ds.Scene(
    ambient=0.3,
    lights=(
        ds.PointLight((1.0, 2.0, 3.0), (0.9, 0.7, 0.5), ds.QuadraticAttenuation(1.0, 0.05, 0.02)),
        ds.ParallelLight((0.0, 1.0, 1.0), 0.5),
    ),
)
MATERIAL = ds.Material(ka=0.1, kd=(0.6, 0.5, 0.4), specular=ds.Phong(0.3, 20.0))
Arguments = tuple[ds.GBuffer, ds.Scene, ds.Material, jax.Array]

CALLS: dict[str, Callable[..., Any]] = {
    "GBuffer.from_image": lambda g, scene, material, image: g.from_image(image),
    "render": lambda g, scene, material, image: ds.render(g, scene, material),
    "mean_squared_error": ds.mean_squared_error,
    "keep_geometry": lambda g, scene, material, image: ds.keep_geometry(g, scene, material),
    "basis": lambda g, scene, material, image: ds.basis(g, scene, material),
    "GBuffer.to_image": lambda g, scene, material, image: g.to_image((g.normal.x, g.normal.z)),
}


def size(k: int) -> tuple[int, int]:
    """Width and height of image number k: the foreground grows by a few pixels in a hundred."""
    return 128 + 3 * k, 120 + 2 * k


class Count:
    """Programs that XLA has compiled, and seconds, so far."""

    def __init__(self) -> None:
        self.programs, self.seconds = 0, 0.0
        jax.monitoring.register_event_duration_secs_listener(self._note)
        self._on = False

    def _note(self, event: str, *_: Any, **__: Any) -> None:
        if event == "/jax/core/compile/backend_compile_duration":
            self.programs += self._on

    def __enter__(self) -> None:
        self._on, self._started = True, time.perf_counter()

    def __exit__(self, *_: object) -> None:
        self.seconds += time.perf_counter() - self._started
        self._on = False


def surfaces(count: int, counted: Count) -> list[Arguments]:
    """A ball in images of as many sizes."""
    found = []
    for k in range(count):
        camera = ds.OrthographicCamera(*size(k), 2.4)
        with counted:
            g = jax.block_until_ready(ds.gbuffer(ds.Sphere(), camera))
        image = np.linspace(0, 1, 3 * camera.width * camera.height, dtype=g.normal.x.dtype)
        found.append((g, SCENE, MATERIAL, jax.numpy.asarray(image.reshape(*g.shape, 3))))
    return found


def called(function: Callable[..., Any], each: list[Any]) -> Count:
    """Each in turn."""
    counted = Count()
    for arguments in each:
        with counted:
            jax.block_until_ready(function(*arguments))
    return counted


def fitted(g: ds.GBuffer, image: np.ndarray) -> None:
    fitting.fit(image, g, SCENE)


def table(count: int, without: int) -> list[str]:
    """The rows in Markdown."""
    geometry = Count()
    each = surfaces(count, geometry)
    print(
        f"{count} sizes, {each[0][0].pixel_count} to {each[-1][0].pixel_count} pixels of foreground"
    )
    rows = ["| called outermost | programs | seconds a size | without: programs a size | seconds |"]
    rows += ["| --- | ---: | ---: | ---: | ---: |"]
    rows += [f"| gbuffer | {geometry.programs} | {geometry.seconds / count:.4f} | | |"]
    committed = jax.device_put(each[:: max(count // without, 1)][:without], jax.devices()[0])
    for name, function in CALLS.items():
        ours, theirs = called(function, each), called(function, committed)
        rows += [
            f"| {name} | {ours.programs} | {ours.seconds / count:.4f}"
            f" | {theirs.programs / without:.2f} | {theirs.seconds / without:.4f} |"
        ]
    photographs = [(g, np.array(ds.render(g, SCENE, MATERIAL))) for g, *_ in each]
    fits = called(fitted, photographs)
    return [*rows, f"| fitting.fit | {fits.programs} | {fits.seconds / count:.4f} | | |"]


def measure(count: int) -> dict[str, int]:
    """Programs of each function over so many sizes."""
    geometry = Count()
    each = surfaces(count, geometry)
    found = {"gbuffer": geometry.programs}
    found |= {name: called(function, each).programs for name, function in CALLS.items()}
    photographs = [(g, np.array(ds.render(g, SCENE, MATERIAL))) for g, *_ in each]
    return found | {"fitting.fit": called(fitted, photographs).programs}


def run(count: int = 100) -> dict[str, Any]:
    """In a process of its own."""
    return ask("sizes", count=count)


def figures(results: dict[str, Any]) -> list[Figure]:
    """Counts, which do not vary: no more than the buckets that the sizes fall into."""
    return [
        Figure(f"{name}: programs for a hundred sizes", programs, most=14, tolerance=0)
        for name, programs in results.items()
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--sizes", type=int, default=100, help="how many")
    parser.add_argument("--without", type=int, default=10, help="how many of them without buckets")
    chosen = parser.parse_args()
    print("\n".join(table(chosen.sizes, chosen.without)))


if __name__ == "__main__":
    main()
