"""Certificates over random truths with one shininess to search: how many are proven, and is any wrong.

The lights' attenuation is known. Each truth is fitted as it is, and with noise of a thousandth of the
image's maximum. A certificate is wrong where a dense scan over the shininess, by `project.cost` in
float64, finds less than what is proven, or something within the tolerance outside of its interval.

    python -m benchmarks.certificates --count 200 --size 64
"""

import argparse
import time
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

import diffshade as ds
from benchmarks.figures import Figure, answer, ask, median, table
from benchmarks.fit_truths import ball, draw, observe, scene
from fitting.certificate import Certificate, certify
from fitting.inputs import match, views
from fitting.limits import limits
from fitting.model import Model, default_material
from fitting.observation import group_views, in_precision
from fitting.project import Problem, cost
from fitting.search import ALL, search

__all__ = ["figures", "run"]

NOISES = (0.0, 1e-3)
"""In units of the image's maximum."""
SCANNED = 2000
PROVEN = 95
"""Per cent of the truths, at the least."""


def problem_of(image: np.ndarray, gbuffer: ds.GBuffer, lit: ds.Scene) -> tuple[Problem, Any, Any]:
    """What `fit` would search, its grid and its box: ambient, diffuse and one Phong lobe."""
    seen = views(match(image, gbuffer, lit, None))
    dtype = seen[0].gbuffer.normal.x.dtype
    start = default_material([lit])
    model = Model(material=start, searched=(0,), channel_count=image.shape[2])
    limit = limits(model, frozenset(), start, {}, start_given=False)
    norm = np.linalg.norm(image[gbuffer.mask])
    parts = model, limit.lower, limit.upper, np.zeros(limit.lower.shape), norm
    model, lower, upper, reference, norm = jax.device_put(in_precision(parts, dtype))
    groups, _ = group_views(seen)
    problem = Problem(model, groups, lower, upper, reference, norm, jnp.int32(ALL))
    return problem, *limit.searched(dtype)


@jax.jit
def scan(problem: Problem, nodes: jax.Array) -> jax.Array:
    """The residual at each node of log n, divided by the norm of what was observed."""
    costs = lax.map(lambda u: cost(problem, u[None])[0], nodes, batch_size=32)
    return jnp.sqrt(jnp.maximum(costs, 0)) / problem.norm


def in_double(tree: Any) -> Any:
    """The tree's floats in float64."""
    return jax.tree.map(
        lambda x: x.astype(jnp.float64) if jnp.issubdtype(x.dtype, jnp.floating) else x, tree
    )


def wrong(certificate: Certificate, problem: Problem, u: jax.Array, k: jax.Array) -> bool:
    """Whether a dense scan finds what the certificate says is not there."""
    with jax.enable_x64(True):
        exact = in_double(replace(problem, reference=k))
        best = float(u[0])
        around = best + np.linspace(-0.3, 0.3, SCANNED // 4)
        over = np.linspace(np.log(0.1), np.log(1e5), SCANNED - len(around) - 1)
        nodes = np.clip(np.concatenate([[best], around, over]), np.log(0.1), np.log(1e5))
        left = np.asarray(scan(exact, jnp.asarray(nodes)))
    assert certificate.interval is not None
    low, high = certificate.interval
    n = np.exp(nodes)
    outside = (n < low * (1 - 1e-6)) | (n > high * (1 + 1e-6))
    slack = 1e-9  # of the scan's own rounding
    missed = certificate.proven and bool((left < left[0] - certificate.tolerance - slack).any())
    return missed or bool((left[outside] <= left[0] + certificate.tolerance - slack).any())


def measure(count: int, size: int) -> dict[str, Any]:
    """One to four lights in turn, grey and RGB; every tenth truth has no highlight."""
    surface = ball(size)
    rng = np.random.default_rng(0)
    rows: list[dict[str, Any]] = []
    warm: set[tuple[int, int]] = set()
    for j in range(count):
        kind = {"lights": j % 4 + 1, "channels": (1, 3)[j // 4 % 2]}
        truth = draw(rng, **kind, boundary="ks = 0" if j % 10 == 9 else "inner")
        truth = truth._replace(c1=0.0, c2=0.0)
        exact = observe(truth, surface)
        for noise in NOISES:
            image = exact + surface.inside[..., None] * rng.normal(0, 1, exact.shape) * (
                noise * exact.max()
            )
            image = image.astype(surface.gbuffer.normal.x.dtype)
            problem, grid, box = problem_of(image, surface.gbuffer, scene(truth))
            found = search(problem, grid, box, None)
            if (*kind.values(),) not in warm:  # compiled once
                warm.add((*kind.values(),))
                certify(problem, found, box)
            began = time.perf_counter()
            certificate = certify(problem, found, box)
            rows.append(
                {
                    **kind,
                    "noise": noise,
                    "shininess": truth.shininess,
                    "seconds": time.perf_counter() - began,
                    "proven": certificate.proven,
                    "evaluations": certificate.evaluations,
                    "interval": certificate.interval,
                    "reason": certificate.reason,
                    "wrong": wrong(certificate, problem, found.u, found.at.k),
                }
            )
    return {"truths": rows}


def run(count: int, size: int) -> dict[str, Any]:
    """Fits in float32, in a process of their own; a proof is summed in float64 whatever the fit."""
    return ask("certificates", precision=32, count=count, size=size)


def figures(results: dict[str, Any]) -> list[Figure]:
    """Per cent proven, and how many are wrong; what a proof costs."""
    rows = []
    for noise in NOISES:
        of = [row for row in results["truths"] if row["noise"] == noise]
        name = f"certificates, {len(of)} truths, " + (f"noise {noise:g}" if noise else "no noise")
        rows += [
            Figure(f"{name}: proven", 100 * np.mean([r["proven"] for r in of]), "%", least=PROVEN),
            Figure(f"{name}: wrong", sum(r["wrong"] for r in of), most=0),
            Figure(f"{name}: evaluations, median", median(r["evaluations"] for r in of)),
            Figure(f"{name}: evaluations, most", max(r["evaluations"] for r in of)),
            Figure(f"{name}: time, median", median(1e3 * r["seconds"] for r in of), "ms"),
        ]
    return rows


def main() -> None:
    """Measure, and print the table; each that is not proven with the reason."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--size", type=int, default=64)
    options = parser.parse_args()
    results = run(options.count, options.size)
    for row in results["truths"]:
        if row["wrong"] or not row["proven"]:
            print(row)
    print(table(figures(results)))


if __name__ == "__main__":
    import sys

    if len(sys.argv) == 2 and sys.argv[1].startswith("{"):
        answer(measure)
    else:
        main()
