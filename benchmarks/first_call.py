"""What comes before the first answer: imports, help, and compiling for one light or a thousand.

    python -m benchmarks.first_call

Each process is timed from its start to its end, as its user waits (wall) and as its processors work
(CPU, user and system); the processes take turns, and a figure is the median over the rounds. A first
render is of 256 x 256 pixels under four lights; where JAX's cache is on disk, an earlier process has
filled it. To trace and to compile is measured in seconds of CPU, in all threads together.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.figures import ROOT, Figure, ask, median
from benchmarks.first_fit import CACHE

RENDER = "from benchmarks.scenes import Case, ours; g = ours(Case(256)); import diffshade as ds; "
RENDER += "ds.render(*g).block_until_ready()"
PROCESSES = {
    "the interpreter alone": ("-c", "pass"),
    "`diffshade --help`": ("-m", "diffshade", "--help"),
    "`diffshade fit --help`": ("-m", "diffshade", "fit", "--help"),
    "`import diffshade, fitting`": ("-c", "import diffshade, fitting"),
    "`import jax`": ("-c", "import jax"),
    "`import jax, equinox`": ("-c", "import jax, equinox"),
    "`import diffshade; diffshade.render`": ("-c", "import diffshade; diffshade.render"),
    "`import fitting; fitting.fit`": ("-c", "import fitting; fitting.fit"),
    "a first render": ("-c", RENDER),
}
MOST = {"`diffshade --help`": 0.2, "`import diffshade; diffshade.render`": 1.0}
ON_DISK = "a first render, with the cache on disk"
LIGHTS = (1, 4, 16, 64, 1024)


class Seconds(NamedTuple):
    """Of one process."""

    wall: float
    cpu: float


def process(*words: str, **environment: str) -> Seconds:
    """A Python with these arguments, from its start to its end."""
    inherited = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        [sys.executable, "-P", *words],
        cwd=ROOT,
        env={**inherited, "PYTHONPATH": str(ROOT), "JAX_ENABLE_X64": "0", **environment},
        stdout=subprocess.DEVNULL,
        check=True,
    )
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Seconds(wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def processes(rounds: int) -> dict[str, list[Seconds]]:
    """All of them in turn."""
    seen: dict[str, list[Seconds]] = {name: [] for name in (*PROCESSES, ON_DISK)}
    with tempfile.TemporaryDirectory() as folder:
        cached = {**CACHE, "JAX_COMPILATION_CACHE_DIR": str(Path(folder))}
        process("-c", RENDER, **cached)
        for _ in range(rounds):
            for name, words in PROCESSES.items():
                seen[name].append(process(*words))
            seen[ON_DISK].append(process("-c", RENDER, **cached))
    return seen


def compiling(lights: int, rounds: int) -> list[float]:
    """Seconds to trace and seconds to compile `render`, and then those of a gradient.

    It is that of `mean_squared_error` in the coefficients of the material.
    """
    import jax

    import diffshade as ds
    from benchmarks.scenes import Case, ours

    case = ours(Case(size=256, lights=lights))
    observed = jax.numpy.zeros((3, case[0].pixel_count))
    gradient = jax.value_and_grad(ds.mean_squared_error, argnums=2)
    programs: tuple[tuple[Any, tuple[Any, ...]], ...] = (
        (ds.render, case),
        (gradient, (*case, observed)),
    )
    seen = []
    for _ in range(rounds):
        times = []
        for program, arguments in programs:
            jax.clear_caches()
            clock = [time.process_time()]
            lowered = jax.jit(program, compiler_options=ds.compiler_options()).lower(*arguments)
            clock.append(time.process_time())
            lowered.compile()
            clock.append(time.process_time())
            times += [clock[1] - clock[0], clock[2] - clock[1]]
        seen.append(times)
    return [median(column) for column in zip(*seen, strict=True)]


def measure(lights: int, rounds: int) -> dict[str, Any]:
    """Seconds to trace and compile, by program."""
    compiling(2, 1)  # what the first of all pays for
    traced, compiled, gradient_traced, gradient_compiled = compiling(lights, rounds)
    return {"render": traced + compiled, "gradient": gradient_traced + gradient_compiled}


def run(rounds: int = 5, few: int = 16, many: int = 256) -> dict[str, Any]:
    """Processes in turn, and compilations of a few lights and of many."""
    found = processes(rounds)
    return {
        "processes": {name: median(s.wall for s in seen) for name, seen in found.items()},
        "compiling": {lights: ask("first_call", lights=lights, rounds=1) for lights in (few, many)},
    }


def figures(results: dict[str, Any]) -> list[Figure]:
    """Seconds of processes, and how compilation grows with the lights."""
    rows = [
        Figure(name, seconds, "s", most=MOST.get(name))
        for name, seconds in results["processes"].items()
    ]
    (few, of_few), (many, of_many) = results["compiling"].items()
    return rows + [
        Figure(f"compiling of {what}, {many} lights over {few}", of_many[what] / of_few[what])
        for what in of_few
    ]


def main() -> None:
    """Measure, and print two tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=15, help="of the processes")
    parser.add_argument("--compilations", type=int, default=3, help="of each program")
    options = parser.parse_args()
    print("| process | wall, s | CPU, s |\n|---|---|---|")
    for name, found in processes(options.rounds).items():
        wall, cpu = (median(times) for times in zip(*found, strict=True))
        print(f"| {name} | {wall:.3f} | {cpu:.3f} |")
    print("\n| lights | `render`: traced, s | compiled, s | gradient: traced, s | compiled, s |")
    print("|---|---|---|---|---|")
    compiling(2, 1)  # what the first of all pays for
    for lights in LIGHTS:
        times = " | ".join(f"{t:.2f}" for t in compiling(lights, options.compilations))
        print(f"| {lights} | {times} |", flush=True)


if __name__ == "__main__":
    main()
