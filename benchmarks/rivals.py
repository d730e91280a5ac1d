"""Rivals in shading beside the exact image and gradient: LIGHT-13 in C, PyTorch, Dr.Jit and Mitsuba.

    python -m benchmarks.rivals                      all that are installed
    python -m benchmarks.rivals ceiling --lights 4   some

Every rival gets planes [3, P] of foreground pixels in float32 and as many threads as the process may
run on cores (`taskset -c 0` for one). Times are nanoseconds per pixel and light. With more threads,
name one rival a run: pools of threads that wait for work by spinning slow down each other.
"""

import argparse
import importlib
import os
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from diffshade.fusion import processors

__all__ = ["RIVALS", "exact", "threads"]

RIVALS = {
    "diffshade": "benchmarks.our_shading",
    "ceiling": "benchmarks.ceiling",
    "torch": "benchmarks.torch_shading",
    "drjit": "benchmarks.drjit_shading",
    "mitsuba": "benchmarks.mitsuba_shading",
}
EYE = np.array([0.0, 0.0, 6.0])


def threads() -> int:
    """As many as the process may run on cores, or what OMP_NUM_THREADS says."""
    asked = os.environ.get("OMP_NUM_THREADS")
    return int(asked) if asked else processors()


def exact(
    points: np.ndarray,
    normals: np.ndarray,
    eye: np.ndarray,
    scene: dict[str, Any],
    target: np.ndarray | None = None,
) -> tuple[np.ndarray, float, np.ndarray]:
    """The image [3, P], the loss and its gradient [13], in float64."""
    p, normal = points.astype(np.float64), normals.astype(np.float64)
    v = np.reshape(eye, (3, 1)) - p
    v /= np.linalg.norm(v, axis=0)
    ka, kd, ks = (np.reshape(scene[k], (3, 1)) for k in ("ka", "kd", "ks"))
    constants, n = scene["constants"] or (1.0, 0.0, 0.0), scene["shininess"]
    diffuse, specular, by_n = (np.zeros_like(p) for _ in range(3))
    by_constants = [np.zeros_like(p) for _ in range(3)]
    for position, intensity in zip(scene["positions"], scene["intensities"], strict=True):
        colour = np.reshape(np.broadcast_to(intensity, 3), (3, 1))
        s = np.reshape(position, (3, 1)) - p
        d = np.linalg.norm(s, axis=0)
        l = s / d
        n_dot_l = (normal * l).sum(axis=0)
        r_dot_v = np.maximum(((2 * n_dot_l * normal - l) * v).sum(axis=0), 0)
        bright = (n_dot_l > 0) & (r_dot_v > 0)
        lobe = np.where(bright, r_dot_v**n, 0)
        logarithm = np.log(np.where(bright, r_dot_v, 1))
        q = constants[0] + constants[1] * d + constants[2] * d * d
        f = np.minimum(1 / q, 1)
        lit = np.maximum(n_dot_l, 0)
        diffuse += colour * f * lit
        specular += colour * f * lobe
        by_n += colour * f * lobe * logarithm
        by_f = colour * (kd * lit + ks * lobe)
        for k in range(3):
            by_constants[k] -= by_f * np.where(q > 1, f**2, 0) * d**k
    image = scene["ambient"] * ka + kd * diffuse + ks * specular
    e = image - (0 if target is None else target)
    parts = [scene["ambient"] * e, diffuse * e, specular * e]
    scalars = [(ks * by_n * e).sum(), *((x * e).sum() for x in by_constants)]
    slope = np.concatenate([*(x.sum(axis=1) for x in parts), scalars])
    return image, float((e**2).mean()), 2 * slope / e.size


def _seconds(calls: list[Callable[[], Any]], rounds: int) -> list[list[float]]:
    """Each call once a round, in turn."""
    times: list[list[float]] = [[] for _ in calls]
    for _ in range(rounds):
        for seen, call in zip(times, calls, strict=True):
            started = time.perf_counter()
            call()
            seen.append(time.perf_counter() - started)
    return times


def main() -> None:
    """Check and time, and print a table."""
    from benchmarks import numpy_shading
    from benchmarks.scenes import Case, numbers

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="rival", default=[], help=", ".join(RIVALS))
    parser.add_argument("--lights", type=int, nargs="*", default=[4, 16])
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--rounds", type=int, default=40)
    options = parser.parse_args()
    modules = {}
    for name in options.names or RIVALS:
        try:
            modules[name] = importlib.import_module(RIVALS[name])
        except ImportError as missing:
            print(f"{name}: {missing}")
    single, _ = numpy_shading.points(options.size, 2.0, np.float32)
    points = np.ascontiguousarray(single.T)
    print(f"{threads()} threads, {points.shape[1]} pixels; median (least) of {options.rounds}\n")
    print("| lights | rival | forward | gradient | error | error of the gradient |")
    print("|---|---|---|---|---|---|")
    for lights in options.lights:
        for coloured in (False, True):
            scene = numbers(Case(size=options.size, lights=lights, coloured=coloured))
            image, *_ = exact(points, points, EYE, scene)
            target = (0.9 * image).astype(np.float32)
            _, loss, slope = exact(points, points, EYE, scene, target)
            calls: list[Callable[[], Any]] = []
            errors = []
            for module in modules.values():
                shade = module.forward(points, points, EYE, scene)
                step = module.gradient(points, points, EYE, scene, target)
                found_loss, found = step()
                errors.append(
                    (
                        np.abs(np.asarray(shade()) - image).max(),
                        max(np.abs(found / slope - 1).max(), abs(found_loss / loss - 1)),
                    )
                )
                calls += [shade, step]
            seen = _seconds(calls, options.rounds)
            scale = 1e9 / points.shape[1] / lights
            cells = [f"{scale * statistics.median(t):.2f} ({scale * min(t):.2f})" for t in seen]
            kind = f"{lights}, {'RGB' if coloured else 'one colour'}"
            for k, (name, (error, error_of_slope)) in enumerate(zip(modules, errors, strict=True)):
                times = " | ".join(cells[2 * k : 2 * k + 2])
                print(f"| {kind} | {name} | {times} | {error:.1e} | {error_of_slope:.1e} |")


if __name__ == "__main__":
    main()
