"""What every guard costs: the time of shading without it, over that of the whole.

    PYTHONPATH=tests taskset -c 0 python -m benchmarks.guards

Takes one guard after the other out of a copy of the package (`tests/fuzz/guards.py`) and compiles the
forward render of four RGB lights with attenuation. One core, CPU time, float32. Each takes turns with
the whole; times and ratios are medians over the rounds.
"""

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
from fuzz.guards import GUARDS, PACKAGE, without

from benchmarks.figures import in_turn, median, paired_ratio
from benchmarks.scenes import Case, ours
from diffshade.fusion import processors

__all__ = ["compiled", "cost"]


def compiled(folder: Path, size: int) -> tuple[str, Callable[[], Any]]:
    """The program of the package that lies in a folder, and a call that waits for its image."""
    for name in [n for n in sys.modules if n.partition(".")[0] == PACKAGE.name]:
        del sys.modules[name]
    sys.path.insert(0, str(folder))
    try:
        import diffshade as ds
        from diffshade.shading.image import image_planes
        from diffshade.shading.kept_geometry import KeptGeometry

        assert Path(str(ds.__file__)).parent == folder / PACKAGE.name
        gbuffer, scene, material = ours(Case(size=size))
        arguments = KeptGeometry(gbuffer, None), scene, material
        traced = jax.jit(lambda *given: image_planes(*given, plain=False)).lower(*arguments)
        program = traced.compile(ds.compiler_options())
    finally:
        sys.path.remove(str(folder))
    return traced.as_text(), lambda: jax.block_until_ready(program(*arguments))


def cost(whole: Callable[[], Any], less: Callable[[], Any], rounds: int) -> tuple[float, float]:
    """The median time without a guard, and by what it makes the whole longer."""
    seen = in_turn({"whole": whole, "less": less}, rounds, time.process_time)
    return median(seen["less"]), paired_ratio(seen["whole"], seen["less"]) - 1


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--size", type=int, default=512, help="pixels a side")
    parser.add_argument("--rounds", type=int, default=51)
    options = parser.parse_args()
    if processors() > 1:
        parser.error(f"{processors()} cores: choose one, as in `taskset -c 0`")
    print(
        f"{options.size} x {options.size}, JAX {jax.__version__}, load {os.getloadavg()[0]:.1f}\n\n"
        "| without | ms | the guard costs |\n|---|---|---|"
    )
    absent = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder).resolve()
        shutil.copytree(PACKAGE, copy / PACKAGE.name)
        text, whole = compiled(copy, options.size)
        _, noise = cost(whole, compiled(copy, options.size)[1], options.rounds)
        print(f"| nothing: what noise makes of it | | {100 * noise:+.1f} % |", flush=True)
        for guard in GUARDS:
            with without(guard, copy / PACKAGE.name):
                bare, less = compiled(copy, options.size)
            if bare == text:
                absent.append(guard.name)
                continue
            seconds, more = cost(whole, less, options.rounds)
            print(f"| {guard.name} | {1e3 * seconds:.2f} | {100 * more:+.1f} % |", flush=True)
    print(f"\nNot in this program: {'; '.join(absent)}.")


if __name__ == "__main__":
    main()
