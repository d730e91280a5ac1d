"""Whether the images show LIGHT-12's clamp min(1/(c0 + c1 d + c2 d^2), 1) at work.

Where it acts at some of the lit points, a law without it leaves a kink in the residual, and a law with
it has a scale: f is 1 where it is clamped. The law without has a free scale, one unknown less, and is
fitted first. Then a score test (Rao 1948) asks, on one block of each image, whether a clamp could explain
what is left: for each distance where it may begin, D is how the image would change if f stayed
constant below, and

    (D.r)^2 / (D.D),   D with A and J projected out, r the residual,

is by how much |r|^2 would fall to first order. Only where that is far above the noise is the clamped law
searched, from a grid of where the clamp begins; and only where it has the better information criterion
by far is it taken.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from fitting.distances import Distances
from fitting.gauge import PolynomialGauge
from fitting.model import Model
from fitting.project import Problem, predict
from fitting.search import Found
from fitting.sharding import over_devices
from fitting.stream import Block, sum_over_blocks

__all__ = ["CLEAR", "may_show", "with_clamp"]

PLACES = 8
"""Where the clamp may begin, from the nearest to the farthest lit point."""
NOTED = 10.0
"""Of the noise's variance: what the clamp must seem to explain. By chance once in 500 fits."""
CLEAR = 10.0
"""By which the criterion must be better: "very strong" evidence (Kass and Raftery 1995)."""
SEEN = 1e-3
"""Of |D|^2: what must be left of it, or a change of the coefficients does the same."""


def with_clamp(model: Model) -> Model | None:
    """The model with the clamp, and a scale of its own; None where there is none to add."""
    gauge = model.gauge
    if not isinstance(gauge, PolynomialGauge) or not gauge.floating:
        return None
    clamped = replace(gauge, scale_known=True)
    return replace(model, gauge=clamped, dependent=None) if clamped.clamped else None


def may_show(problem: Problem, found: Found, distances: Distances, noise: float) -> bool:
    """Whether a clamp could explain what a fit without one left, at a `noise` per observation."""
    part = replace(
        problem,
        model=replace(problem.model, dependent=found.dependent),
        judge=found.judge,
        gains=found.gains,
    )
    ends = jnp.asarray(np.array([distances.farthest, distances.nearest], found.u.dtype))
    grams = _gram(part, found.u, found.at.k, ends)
    explained = _explained(np.asarray(grams, np.float64), np.asarray(found.at.free))
    return bool(explained > NOTED * noise**2)


def _explained(grams: Float[np.ndarray, "C s s"], free: np.ndarray) -> float:
    """The most that a column D takes from |r|^2; rows are [A, J, D, r]."""
    p = free.shape[1]
    each = [_projected(gram, p, keep) for gram, keep in zip(grams, free, strict=True)]
    total = np.sum(each, axis=0)
    raw = np.diagonal(grams.sum(axis=0))[-1 - PLACES : -1]
    rest = _projected(total, len(total) - 1 - PLACES, np.ones(len(total) - 1 - PLACES, bool))
    square, score = np.diagonal(rest)[:-1], rest[:-1, -1]
    told = (square > SEEN * raw) & (score > 0)
    return float(np.max(np.where(told, score**2 / np.where(told, square, 1), 0)))


def _projected(
    gram: Float[np.ndarray, "s s"], count: int, keep: np.ndarray
) -> Float[np.ndarray, "t t"]:
    """The Gram matrix of what the first `count` rows, those of `keep`, leave of the others."""
    scale = np.sqrt(np.diagonal(gram)[:count])
    inverse = np.where(keep & (scale > 0), 1 / np.where(scale > 0, scale, 1), 0)
    inner = gram[:count, :count] * np.outer(inverse, inverse)
    side = gram[:count, count:] * inverse[:, None]
    return gram[count:, count:] - side.T @ np.linalg.pinv(inner, 1e-6, hermitian=True) @ side


@over_devices
def _gram(
    problem: Problem,
    u: Float[Array, "q"],
    k: Float[Array, "C p"],
    ends: Float[Array, "2"],
) -> Float[Array, "C s s"]:
    """Of [A, J, D, r] in each channel, D one row a ceiling of f, between f at both `ends`."""
    model, judge = problem.model, problem.judge
    clamped, law = with_clamp(model), model.unpack(u)[1]
    assert clamped is not None
    assert law is not None
    far, near = jnp.log(law(ends))
    places = jnp.asarray((np.arange(PLACES) + 0.5) / PLACES, u.dtype)
    ceilings = jnp.exp(far + places * (near - far))
    count, lit = len(model.searched), jnp.array(model.lit)

    def of_block(block: Block, gain: Float[Array, ""] | None) -> Float[Array, "C s s"]:
        columns = model.columns(u, block, gain)
        predicted, push = jax.linearize(lambda u: predict(model.columns(u, block, gain), k), u)
        moved = [push(direction) for direction in model.directions.astype(u.dtype)]

        def change(ceiling: Float[Array, ""]) -> Float[Array, "C P"]:
            # min(f, ceiling) is the clamped law of ceiling / f, times the ceiling.
            v = u.at[count:].multiply(ceiling)
            scaled = jnp.where(lit, ceiling * k, k)
            return predict(clamped.columns(v, block, gain), scaled) - predicted

        one = jnp.ones((len(k), 1), u.dtype)
        each = [predict((column,), one) for column in columns]
        rows = jnp.stack([*each, *moved, *lax.map(change, ceilings), block.observed - predicted], 1)
        weights = block.weight[None]
        if judge is not None:
            weights = weights * judge.weights(predicted, block.observed, block.clipped)
        weighed = rows * weights[:, None]
        return jnp.einsum("cip,cjp->cij", weighed, rows, precision=lax.Precision.HIGHEST)

    first = jnp.ones_like(problem.most_blocks)
    each = [
        jnp.sum(sum_over_blocks(group, of_block, first, gains), axis=0)
        for group, gains in problem.each_group()
    ]
    return sum(each[1:], each[0])
