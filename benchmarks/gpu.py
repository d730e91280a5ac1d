"""Shading on a GPU: time, and bandwidth beside that of a copy on the device and the roofline.

    python -m benchmarks.gpu            on JAX's default device (a CUDA one, or it says so and ends)
    python -m benchmarks.gpu --led      the program that a CPU gets, too

`bandwidth` is what must be moved, positions and normals in and the image's planes out, over the time
that it took; `of copy` is its share of what a copy on the device reaches. `of roofline` is the share
of the time that neither memory (at the speed of the copy) nor arithmetic (at the speed of a measured
polynomial, over the flops that the compiler counts) could go below. `plain` is the program as XLA fuses
it, which is what a GPU gets; `led` (pages, stored nodes, short chunks of lights), which a CPU gets, shows
that the choice is right.
"""

import argparse
import statistics
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any
from unittest import mock

import jax
import jax.numpy as jnp
import numpy as np

import diffshade as ds
from benchmarks.scenes import Case, ours, perspective
from diffshade.shading import image
from diffshade.shading import lights as shading_lights
from diffshade.shading.kept_geometry import KeptGeometry

CALLS = 20


def seconds(call: Callable[[], Any]) -> float:
    """The median over rounds of the mean time of calls that are queued one after the other."""
    jax.block_until_ready(call())
    rounds = []
    for _ in range(7):
        start = time.perf_counter()
        last = None
        for _ in range(CALLS):
            last = call()
        jax.block_until_ready(last)
        rounds.append((time.perf_counter() - start) / CALLS)
    return statistics.median(rounds)


def copy_speed() -> float:
    """Bytes a second, read and written, of a copy of 1 GiB on the device."""
    x = jnp.ones(2**28, jnp.float32)
    negative = jax.jit(jnp.negative)
    return 2 * x.nbytes / seconds(lambda: negative(x))


def arithmetic_speed() -> float:
    """Flops a second of two polynomials of degree 513 at 16 million points."""
    x = jnp.linspace(0, 1, 2**24, dtype=jnp.float32)

    @jax.jit
    def polynomial(x: jax.Array) -> jax.Array:
        y = z = x
        for k in range(512):
            y, z = y * x + (k + 1.0), z * x - (k + 1.0)
        return y + z

    return 2048 * x.size / seconds(lambda: polynomial(x))


def compiled(f: Callable[..., Any], *arguments: Any) -> Any:
    return jax.jit(f, compiler_options=ds.compiler_options()).lower(*arguments).compile()


def programs(case: Case, ways: Sequence[str]) -> tuple[dict[Any, Any], int]:
    """Forward, and value and gradient, compiled in these ways, with their arguments; and the pixels."""
    gbuffer, scene, material = ours(case, perspective(case))
    surface = KeptGeometry(gbuffer, None)
    target = tuple(0.9 * x for x in image.image_planes(surface, scene, material, True))
    observed = jnp.stack(target)

    def forward(surface: Any, scene: Any, material: Any) -> Any:
        return image.image_planes(surface, scene, material, False)

    def coefficients(material: Any, surface: Any, scene: Any, observed: Any) -> Any:
        return ds.mean_squared_error(surface, scene, material, observed)

    def everything(moving: Any, index: Any, observed: Any) -> Any:
        normal, position, scene, material = moving
        surface = KeptGeometry(
            ds.GBuffer(gbuffer.shape, normal, gbuffer.viewer, position, index), None
        )
        return ds.mean_squared_error(surface, scene, material, observed)

    moving = (gbuffer.normal, gbuffer.position, scene, material)
    tasks = {
        "forward": (forward, (surface, scene, material)),
        "gradient of coefficients": (
            jax.value_and_grad(coefficients),
            (material, surface, scene, observed),
        ),
        "gradient of everything": (
            jax.value_and_grad(everything),
            (moving, gbuffer.index, observed),
        ),
    }
    found = {}
    for name, (f, arguments) in tasks.items():
        for way in ways:
            jax.clear_caches()
            with ExitStack() as stack:
                for module in (image, shading_lights):
                    stack.enter_context(
                        mock.patch.object(module, "is_led", lambda way=way: way == "led")
                    )
                found[name, way] = compiled(f, *arguments), arguments
    return found, gbuffer.pixel_count


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--sizes", type=int, nargs="+", default=[512, 2048, 4096])
    parser.add_argument("--lights", type=int, nargs="+", default=[1, 4, 16])
    parser.add_argument("--any-device", action="store_true", help="run where there is no GPU too")
    parser.add_argument("--led", action="store_true", help="the program of a CPU too")
    options = parser.parse_args()
    device = jax.devices()[0]
    if device.platform != "gpu" and not options.any_device:
        raise SystemExit(f"JAX's default device is {device}: this benchmark is for a GPU")
    copy, arithmetic = copy_speed(), arithmetic_speed()
    print(f"{device.device_kind}, JAX {jax.__version__}, float32, perspective view, attenuation")
    print(f"copy {copy / 1e9:.0f} GB/s, polynomial {arithmetic / 1e12:.1f} Tflop/s\n")
    print(
        "| size | lights | what | program | ms | ns a pixel and light | GB/s | of copy | of roofline |"
        "\n|---|---|---|---|---|---|---|---|---|"
    )
    for size in options.sizes:
        for lights in options.lights:
            case = Case(size=size, lights=lights)
            found, pixels = programs(case, ("plain", "led") if options.led else ("plain",))
            for (name, how), (program, arguments) in found.items():
                spent = seconds(lambda p=program, a=arguments: p(*a))
                planes = 9 if name != "gradient of everything" else 15
                moved = 4 * planes * pixels
                cost = program.cost_analysis()
                flops = (cost[0] if isinstance(cost, list) else cost).get("flops", np.nan)
                least = max(moved / copy, flops / arithmetic)
                print(
                    f"| {size} | {lights} | {name} | {how} | {1e3 * spent:.3f}"
                    f" | {1e9 * spent / pixels / lights:.4f} | {moved / spent / 1e9:.0f}"
                    f" | {moved / spent / copy:.2f} | {least / spent:.2f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
