"""Thousands of fits in one process: does it use more memory, compile more, or take longer?

    PYTHONPATH=tests python -m stress.soak --fits 10000

Sizes, numbers of images, channels, lights and materials are drawn anew for each fit. Prints ten rows of
as many fits each: how many were right, the programs compiled meanwhile, the peak of the process's memory
so far, and the median CPU time of a fit. What is drawn first compiles and fills caches: the second half
is held against the middle.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from compilations import compilations

import diffshade as ds
import fitting

__all__ = ["Stretch", "soak", "steady"]

LARGEST = 160
"""Pixels a side."""
KB = 1 if sys.platform != "darwin" else 1024


class Stretch(NamedTuple):
    """So many fits, one after the other."""

    fits: int
    right: int
    compilations: int
    peak: float
    """MiB, of the process so far."""
    seconds: float
    """CPU time of a fit, the median."""

    def __str__(self) -> str:
        return (
            f"{self.fits} fits, {self.right} right, {self.compilations} programs compiled,"
            f" {self.peak:.0f} MiB at the most, {1e3 * self.seconds:.1f} ms each"
        )


def steady(stretches: list[Stretch]) -> list[str]:
    """What is wrong: memory or time that grows, programs without end, fits that err."""
    middle, last = stretches[len(stretches) // 2 - 1], stretches[-1]
    wrong = []
    if last.peak > 1.02 * middle.peak:
        wrong.append(
            f"memory grows: {middle.peak:.0f} MiB half way, {last.peak:.0f} MiB at the end"
        )
    if last.compilations > 0.01 * last.fits:
        wrong.append(f"the last {last.fits} fits still compile {last.compilations} programs")
    if last.seconds > 1.25 * middle.seconds:
        wrong.append(f"a fit takes {last.seconds / middle.seconds:.2f} times as long as half way")
    share = sum(s.right for s in stretches) / sum(s.fits for s in stretches)
    if share < 0.99:
        wrong.append(f"only {100 * share:.1f} % of the fits are right")
    return wrong


def soak(fits: int, stretches: int, seed: int) -> Iterator[Stretch]:
    """So many fits in each stretch; needs Unix, which tells of a process's memory."""
    import resource

    rng = np.random.default_rng(seed)
    for _ in range(stretches):
        right, times = 0, []
        with compilations() as compiled:
            for _ in range(fits):
                started = time.process_time()
                right += _fit(rng)
                times.append(time.process_time() - started)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / KB / 1024
        yield Stretch(fits, right, len(compiled), peak, statistics.median(times))


def _fit(rng: np.random.Generator) -> bool:
    """One fit of images with noise; whether its shininess is right within five standard errors."""
    size = [int(side) for side in rng.integers(16, LARGEST, 2)]
    channels, images = int(rng.choice([1, 3])), int(rng.integers(1, 4))
    camera = ds.OrthographicCamera(*size, 2.2 * size[0] / min(size))
    gbuffer = ds.gbuffer(ds.Sphere(), camera)
    shininess = float(np.exp(rng.uniform(np.log(3), np.log(60))))
    material = ds.Material(
        kd=rng.uniform(0.2, 0.8, channels), specular=ds.Phong(rng.uniform(0.2, 0.6), shininess)
    )
    directions = rng.normal(0, 0.4, (images, 3)) + np.array([0.3, 0.2, 1.5])
    scenes = [ds.Scene(lights=ds.ParallelLight(direction)) for direction in directions]
    seen = [np.asarray(ds.render(gbuffer, scene, material)) for scene in scenes]
    seen = [(image + rng.normal(0, 1e-3, image.shape)).astype(image.dtype) for image in seen]
    fit = fitting.fit(seen, gbuffer, scenes)
    error = abs(float(fit.coefficients["specular.0.shininess"]) - shininess)
    return fit.converged and error <= 5 * float(fit.standard_errors["specular.0.shininess"])


def main() -> int:
    """Print the stretches, and what is not steady."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--fits", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    stretches = []
    for stretch in soak(-(-options.fits // 10), 10, options.seed):
        stretches.append(stretch)
        print(stretch, flush=True)
    wrong = steady(stretches)
    print(*wrong, sep="\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
