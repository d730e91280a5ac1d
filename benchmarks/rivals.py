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
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.figures import Figure, ask, in_turn, median, paired_ratio
from diffshade.fusion import processors

__all__ = ["RIVALS", "exact", "figures", "run", "threads"]

RIVALS = {
    "diffshade": "benchmarks.our_shading",
    "ceiling": "benchmarks.ceiling",
    "torch": "benchmarks.torch_shading",
    "drjit": "benchmarks.drjit_shading",
    "mitsuba": "benchmarks.mitsuba_shading",
}
OURS, FORWARD, GRADIENT = "diffshade", "forward", "gradient"
CASES = {
    f"{lights} lights, {'RGB' if coloured else 'one colour'}": {
        "lights": lights,
        "coloured": coloured,
    }
    for lights in (4, 16)
    for coloured in (False, True)
}
MOST = {
    ("4 lights, one colour", FORWARD, "ceiling"): 1.2,
    ("4 lights, RGB", FORWARD, "ceiling"): 2.2,
    ("16 lights, one colour", FORWARD, "ceiling"): 0.9,
    ("16 lights, RGB", FORWARD, "ceiling"): 1.9,
    ("4 lights, one colour", GRADIENT, "ceiling"): 1.7,
    ("4 lights, RGB", GRADIENT, "ceiling"): 2.1,
    ("4 lights, one colour", FORWARD, "torch"): 1.0,
    ("4 lights, one colour", FORWARD, "drjit"): 1.0,
    ("4 lights, RGB", FORWARD, "torch"): 1.4,
    ("4 lights, RGB", FORWARD, "drjit"): 1.4,
    (GRADIENT, "torch"): 0.67,
    (GRADIENT, "drjit"): 0.67,
}
"""Times ours may take of a rival's."""
MORE = {
    "4 lights, one colour": {"gradient, geometry kept": 1.2},
    "4 lights, RGB": {
        "gradient, geometry kept": 1.6,
        "gradient, and of colours": 2.7,
        "gradient, and of colours and positions": 4.3,
        "gradient of everything": 5.6,
    },
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


def measure(
    names: list[str], lights: int, coloured: bool, size: int, rounds: int
) -> dict[str, Any]:
    """Of each rival that is installed, seconds and errors; of ours, other gradients too."""
    from benchmarks import numpy_shading
    from benchmarks.scenes import Case, numbers

    single, _ = numpy_shading.points(size, 2.0, np.float32)
    points = np.ascontiguousarray(single.T)
    scene = numbers(Case(size=size, lights=lights, coloured=coloured))
    image, *_ = exact(points, points, EYE, scene)
    target = (0.9 * image).astype(np.float32)
    _, loss, slope = exact(points, points, EYE, scene, target)
    calls: dict[str, Callable[[], Any]] = {}
    errors, absent = {}, {}
    for name in names:
        try:
            module = importlib.import_module(RIVALS[name])
        except ImportError as missing:
            absent[name] = str(missing)
            continue
        shade = module.forward(points, points, EYE, scene)
        step = module.gradient(points, points, EYE, scene, target)
        found_loss, found = step()
        off = max(np.abs(found / slope - 1).max(), abs(found_loss / loss - 1))
        errors[name] = [float(np.abs(np.asarray(shade()) - image).max()), float(off)]
        calls |= {f"{name}: {FORWARD}": shade, f"{name}: {GRADIENT}": step}
        for more, call in getattr(module, "more", lambda *_: {})(
            points, points, EYE, scene, target
        ).items():
            calls[f"{name}: {more}"] = call
    clock = time.process_time if threads() == 1 else time.perf_counter
    seen = in_turn(calls, rounds, clock)
    return {
        "evaluations": points.shape[1] * lights,
        "seconds": seen,
        "errors": errors,
        "absent": absent,
    }


def run(size: int = 512, rounds: int = 40) -> dict[str, Any]:
    """Each number of lights in a process of its own, on one core."""
    found = {
        kind: ask("rivals", cores=1, names=list(RIVALS), size=size, rounds=rounds, **case)
        for kind, case in CASES.items()
    }
    for name, why in next(iter(found.values()))["absent"].items():
        print(f"without {name}: {why}", file=sys.stderr)
    return found


def figures(results: dict[str, Any]) -> list[Figure]:
    """Ratios of ours to the others', and errors."""
    rows = []
    for kind, found in results.items():
        seen = found["seconds"]
        for name in found["errors"]:
            if name != OURS:
                rows += [
                    Figure(
                        f"{kind}: {what} over {name}",
                        paired_ratio(seen[f"{OURS}: {what}"], seen[f"{name}: {what}"]),
                        most=MOST.get((kind, what, name), MOST.get((what, name))),
                    )
                    for what in (FORWARD, GRADIENT)
                ]
        if f"ceiling: {GRADIENT}" in seen:
            rows += [
                Figure(
                    f"{kind}: {what.removeprefix(f'{OURS}: ')} over the ceiling's gradient",
                    paired_ratio(times, seen[f"ceiling: {GRADIENT}"]),
                    most=MORE.get(kind, {}).get(what.removeprefix(f"{OURS}: ")),
                )
                for what, times in seen.items()
                if what.startswith(OURS) and not what.endswith((FORWARD, GRADIENT))
            ]
        forward, gradient = found["errors"][OURS]
        rows += [
            Figure(f"{kind}: error", forward, tolerance=0.5),
            Figure(f"{kind}: error of the gradient, relative", gradient, tolerance=0.5),
        ]
    return rows


def table(kind: str, results: dict[str, Any]) -> str:
    """A row for each rival and each further gradient of ours."""
    scale = 1e9 / results["evaluations"]
    cells = {
        name: f"{scale * median(times):.2f} ({scale * min(times):.2f})"
        for name, times in results["seconds"].items()
    }
    rows = []
    for name, (error, error_of_slope) in results["errors"].items():
        times = f"{cells.pop(f'{name}: {FORWARD}')} | {cells.pop(f'{name}: {GRADIENT}')}"
        rows.append(f"| {kind} | {name} | {times} | {error:.1e} | {error_of_slope:.1e} |")
    rows += [f"| {kind} | {name} | - | {cell} | - | - |" for name, cell in cells.items()]
    return "\n".join(rows)


def main() -> None:
    """Check and time, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="rival", default=[], help=", ".join(RIVALS))
    parser.add_argument("--lights", type=int, nargs="*", default=[4, 16])
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--rounds", type=int, default=40)
    options = parser.parse_args()
    print(f"{threads()} threads; median (least) of {options.rounds}\n")
    print("| lights | rival | forward | gradient | error | error of the gradient |")
    print("|---|---|---|---|---|---|")
    for lights in options.lights:
        for coloured in (False, True):
            names = options.names or list(RIVALS)
            found = measure(names, lights, coloured, options.size, options.rounds)
            print(table(f"{lights}, {'RGB' if coloured else 'one colour'}", found), flush=True)
    for name, why in found["absent"].items():
        print(f"\n{name}: {why}")


if __name__ == "__main__":
    main()
