"""Many materials or scenes: `jax.vmap` and `jax.lax.map` over a loop of compiled calls.

    taskset -c 0 python -m benchmarks.batches

One core, CPU time a scene, float32. All ways take their turn in every round; figures are medians.
"""

import argparse
import os
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

import diffshade as ds
from benchmarks.figures import in_turn, median, paired_ratio
from benchmarks.scenes import Case, ours
from diffshade.fusion import processors


def ways(f: Callable[[Any], Any], items: list[Any]) -> dict[str, Callable[[], Any]]:
    """`f` of all items, in three ways."""

    def jitted(f: Callable[[Any], Any]) -> Callable[[Any], Any]:
        return jax.jit(f, compiler_options=ds.compiler_options())

    together = jax.tree.map(lambda *leaves: jnp.stack(leaves), *items)
    one, batched, mapped = jitted(f), jitted(jax.vmap(f)), jitted(lambda x: lax.map(f, x))
    return {
        "loop": lambda: jax.block_until_ready([one(item) for item in items]),
        "vmap": lambda: jax.block_until_ready(batched(together)),
        "lax.map": lambda: jax.block_until_ready(mapped(together)),
    }


def cases(size: int, count: int) -> dict[str, dict[str, Callable[[], Any]]]:
    """What is computed of many, and the ways to."""
    gbuffer, scene, material = ours(Case(size=size))
    observed = 0.9 * gbuffer.from_image(ds.render(gbuffer, scene, material))

    def error(scene: ds.Scene, material: ds.Material) -> jax.Array:
        return ds.mean_squared_error(gbuffer, scene, material, observed)

    def several(tree: Any) -> list[Any]:
        return [jax.tree.map(lambda x: x * (1 + 0.01 * k), tree) for k in range(count)]  # noqa: B023

    found = {}
    for name, f in (
        ("render", lambda s, m: ds.render(gbuffer, s, m)),
        ("squared error", error),
        ("its gradient in the material", jax.value_and_grad(error, 1)),
    ):
        found[f"{name}, materials"] = ways(lambda m, f=f: f(scene, m), several(material))
        found[f"{name}, scenes"] = ways(lambda s, f=f: f(s, material), several(scene))
    return found


def row(turns: dict[str, Callable[[], Any]], count: int, rounds: int) -> str:
    """Milliseconds a scene in a loop, and the ratios of the others."""
    seen = in_turn(turns, rounds, time.process_time)
    loop = seen.pop("loop")
    ratios = (paired_ratio(times, loop) for times in seen.values())
    figures = [1e3 * median(loop) / count, *ratios]
    return " | ".join(f"{figure:.2f}" for figure in figures)


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--sizes", type=int, nargs="+", default=[128, 512], help="pixels a side")
    parser.add_argument("--counts", type=int, nargs="+", default=[8, 64], help="of a batch")
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    if processors() > 1:
        parser.error(f"{processors()} cores: choose one, as in `taskset -c 0`")
    print(f"JAX {jax.__version__}, load {os.getloadavg()[0]:.1f}\n")
    print("| | batch | loop, ms each | vmap over loop | lax.map over loop |\n|---|---|---|---|---|")
    for size in options.sizes:
        for count in options.counts:
            for name, turns in cases(size, count).items():
                figures = row(turns, count, options.rounds)
                print(f"| {size} x {size}: {name} | {count} | {figures} |", flush=True)


if __name__ == "__main__":
    main()
