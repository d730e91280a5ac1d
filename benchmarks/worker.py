"""One implementation, timed in a process of its own: started by `benchmarks.shading`.

Reads requests, one JSON object a line, from standard input, and answers each with one line, so that
two versions of the package can be timed in turn, in one run.
"""

import json
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks import numpy_shading
from benchmarks.scenes import Case, numbers, ours

SECONDS = 0.4
"""Spent on one measurement."""


def seconds(f: Callable[[], Any]) -> float:
    """The median time of a call, over as many as fit, at least three."""
    times: list[float] = []
    start = time.perf_counter()
    while len(times) < 3 or time.perf_counter() - start < SECONDS:
        before = time.perf_counter()
        f()
        times.append(time.perf_counter() - before)
    return statistics.median(times)


def forward(case: Case) -> tuple[Callable[[], Any], int]:
    """Our `render`, called outermost, and how many foreground pixels it shades."""
    import diffshade as ds

    gbuffer, scene, material = ours(case)
    return lambda: ds.render(gbuffer, scene, material).block_until_ready(), gbuffer.pixel_count


def gradient(case: Case) -> tuple[Callable[[], Any], int]:
    """Squared error and its gradient in ka, kd, ks, n and the attenuation's constants.

    The loss is written over the image of `render`, as every version can.
    """
    import diffshade as ds

    def loss(gbuffer: Any, scene: Any, material: Any, target: Any) -> Any:
        return ((ds.render(gbuffer, scene, material) - target) ** 2).mean()

    return _gradient(case, loss, lambda gbuffer, image: image)


def squared_error(case: Case) -> tuple[Callable[[], Any], int]:
    """The same by `mean_squared_error`."""
    import diffshade as ds

    return _gradient(case, ds.mean_squared_error, lambda gbuffer, image: gbuffer.from_image(image))


def _gradient(
    case: Case, error: Callable[..., Any], observed: Callable[..., Any]
) -> tuple[Callable[[], Any], int]:
    import jax

    import diffshade as ds

    gbuffer, scene, material = ours(case)
    target = observed(gbuffer, ds.render(gbuffer, scene, material) * 0.9)
    law = scene.lights[0].attenuation

    def loss(unknown: Any) -> jax.Array:
        material, law = unknown
        lights = tuple(ds.PointLight(x.position, x.intensity, law) for x in scene.lights)
        return error(gbuffer, ds.Scene(scene.ambient, lights), material, target)

    options = getattr(ds, "compiler_options", dict)()
    step = jax.jit(jax.value_and_grad(loss), compiler_options=options)
    return lambda: jax.block_until_ready(step((material, law))), gbuffer.pixel_count


def in_numpy(case: Case) -> tuple[Callable[[], Any], int]:
    """The rival in float32."""
    scene = numbers(case)
    p, _ = numpy_shading.points(case.size, scene["extent"], np.float32)
    return lambda: numpy_shading.shade(p, scene), len(p)


def error(case: Case) -> dict[str, float]:
    """The largest absolute error of our image and of NumPy's, both float32, against float64."""
    scene = numbers(case)
    p, inside = numpy_shading.points(case.size, scene["extent"], np.float64)
    exact = numpy_shading.shade(p, scene)
    single = numpy_shading.shade(p.astype(np.float32), scene)
    image = np.asarray(forward(case)[0]())[inside]
    return {
        "ours": float(np.abs(image - exact).max()),
        "numpy": float(np.abs(single - exact).max()),
    }


MEASURED = {
    "forward": forward,
    "gradient": gradient,
    "squared error": squared_error,
    "numpy": in_numpy,
}


def main() -> None:
    """Answer requests until standard input ends; the argument is the tree that holds the package."""
    tree = sys.argv[1]
    sys.path.insert(0, tree)
    import diffshade

    assert str(diffshade.__file__).startswith(tree), f"{diffshade.__file__} is not of {tree}"
    prepared: dict[str, tuple[Callable[[], Any], int]] = {}
    for line in sys.stdin:
        request = json.loads(line)
        case = Case(**request["case"])
        if request["what"] == "error":
            answer: dict[str, Any] = error(case)
        else:
            if line not in prepared:
                started = time.perf_counter()
                run, pixels = MEASURED[request["what"]](case)
                run()
                prepared[line] = run, pixels
                answer = {"first_call": time.perf_counter() - started}
            run, pixels = prepared[line]
            answer = {"seconds": seconds(run), "evaluations": pixels * case.lights}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
