"""Certificates over random truths with one shininess to search: how many are proven, and is any wrong.

The lights' attenuation is known. Each truth is fitted as it is, and with noise of a thousandth of the
image's maximum. A certificate is wrong where a dense scan over the shininess, with the columns of
`plain_phong` in float64, finds less than what is proven, or something within the tolerance outside of
its interval.

    python -m benchmarks.certificates --count 200 --size 64
"""

import argparse
import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

import fitting
from benchmarks.figures import Figure, ask, median, table
from benchmarks.fit_truths import Ball, Truth, ball, draw, observe, scene, terms_of
from benchmarks.plain_phong import Terms
from fitting.certificate import Certificate
from fitting.linear import bounded_least_squares

__all__ = ["figures", "run"]

NOISES = (0.0, 1e-3)
"""In units of the image's maximum."""
SCANNED = 2000
PROVEN = 95
"""Per cent of the truths, at the least."""
SLACK = 1e-7
"""Of the scan's own rounding: the residual comes from Gram matrices of what was observed."""


@jax.jit
def grams(nodes: jax.Array, observed: jax.Array, at: Terms) -> jax.Array:
    """Of the columns of ka, kd and ks, and what was observed [C, P], at each node of log n."""

    def of_node(u: jax.Array) -> jax.Array:
        lobe = jnp.where(at.bright, jnp.exp(jnp.exp(u) * at.log_r_dot_v), 0)
        columns = jnp.ones_like(observed), at.intensity @ at.n_dot_l, at.intensity @ lobe
        rows = jnp.stack([*columns, observed], axis=1)
        return jnp.einsum("cip,cjp->cij", rows, rows)

    return lax.map(of_node, nodes)


def residuals(image: np.ndarray, truth: Truth, surface: Ball, nodes: np.ndarray) -> np.ndarray:
    """What the best coefficients within 0 and 1 leave at each node of log n, relative."""
    with jax.enable_x64(True):
        observed = image[surface.inside].T.astype(np.float64)
        total = np.asarray(grams(nodes, observed, terms_of(truth, surface.points)))
    gram, moment = total[..., :3, :3], total[..., :3, 3]
    k, _ = bounded_least_squares(gram, moment, np.zeros_like(moment), np.ones_like(moment))
    inner = np.einsum("nci,ncij,ncj->n", k, gram, k) - 2 * np.einsum("nci,nci->n", k, moment)
    square = total[..., 3, 3].sum(axis=-1)
    return np.sqrt(np.maximum(square + inner, 0) / square)


def wrong(
    certificate: Certificate, shininess: float, image: np.ndarray, truth: Truth, surface: Ball
) -> bool:
    """Whether a dense scan finds what the certificate says is not there."""
    best = np.log(shininess)
    around = best + np.linspace(-0.3, 0.3, SCANNED // 4)
    over = np.linspace(np.log(0.1), np.log(1e5), SCANNED - len(around) - 1)
    nodes = np.clip(np.concatenate([[best], around, over]), np.log(0.1), np.log(1e5))
    left = residuals(image, truth, surface, nodes)
    assert certificate.interval is not None
    low, high = certificate.interval
    n = np.exp(nodes)
    outside = (n < low * (1 - 1e-6)) | (n > high * (1 + 1e-6))
    missed = certificate.proven and bool((left < left[0] - certificate.tolerance - SLACK).any())
    return missed or bool((left[outside] <= left[0] + certificate.tolerance - SLACK).any())


def measure(count: int, size: int) -> dict[str, Any]:
    """One to four lights in turn, grey and RGB; every tenth truth has no highlight."""
    surface = ball(size)
    rng = np.random.default_rng(0)
    rows: list[dict[str, Any]] = []
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
            began = time.perf_counter()
            fit = fitting.fit(image, surface.gbuffer, scene(truth), certify=True)
            seconds = time.perf_counter() - began
            certificate = fit.certificate
            assert certificate is not None
            found = float(fit.coefficients["specular.0.shininess"])
            rows.append(
                {
                    **kind,
                    "noise": noise,
                    "shininess": truth.shininess,
                    "seconds": seconds,
                    "proven": certificate.proven,
                    "evaluations": certificate.evaluations,
                    "interval": certificate.interval,
                    "reason": certificate.reason,
                    "wrong": wrong(certificate, found, image, truth, surface),
                }
            )
    return {"truths": rows}


def run(count: int = 200, size: int = 64) -> dict[str, Any]:
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
            Figure(f"{name}: fit with proof, median", median(1e3 * r["seconds"] for r in of), "ms"),
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
    main()
