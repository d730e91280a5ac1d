"""Whether the images show LIGHT-12's clamp min(1/(c0 + c1 d + c2 d^2), 1) at work.

Where it acts at some of the lit points, a law without it leaves a kink in the residual, and a law with
it has a scale: f is 1 where it is clamped. The law without has a free scale, one unknown less, and is
fitted first. Then a score test (Rao 1948) asks, on a sample of each image, whether a clamp could explain
what is left: for each distance where it may begin, D is how the image would change if f stayed
constant below, and

    (D.r)^2 / (D.D),   D with A and J projected out, r the residual,

is by how much |r|^2 would fall to first order. Only where that is far above the noise is the clamped law
searched, from a grid of where the clamp begins; and only where it has the better information criterion
by far is it taken. To first order alone that fails where the clamp acts strongly, and has pulled
everything else away: what a fit leaves that is `MISFIT` of the images or more is always tried.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Float

from diffshade.channels import per_channel
from fitting.arrays import Array
from fitting.columns import Scenery, images_of, predict
from fitting.gauge import PolynomialGauge
from fitting.model import Model
from fitting.observation import Group
from fitting.observed import Observed
from fitting.pages import in_double
from fitting.polish import Minimum
from fitting.project import weights_of
from fitting.weights import Judge

__all__ = ["CLEAR", "may_show", "with_clamp"]

PLACES = 8
"""Where the clamp may begin, from the nearest to the farthest lit point."""
NOTED = 10.0
"""Of the noise's variance: what the clamp must seem to explain. By chance once in 500 fits."""
CLEAR = 10.0
"""By which the criterion must be better: "very strong" evidence (Kass and Raftery 1995)."""
MISFIT = 5e-3
"""Of the images: a relative residual that noise alone seldom leaves."""
SEEN = 1e-3
"""Of |D|^2: what must be left of it, or a change of the coefficients does the same."""


def with_clamp(model: Model) -> Model | None:
    """The model with the clamp, and a scale of its own; None where there is none to add."""
    gauge = model.gauge
    if not isinstance(gauge, PolynomialGauge) or not gauge.floating:
        return None
    clamped = replace(gauge, scale_known=True)
    return replace(model, gauge=clamped, dependent=None) if clamped.clamped else None


def may_show(minimum: Minimum, observed: Observed) -> bool:
    """Whether a clamp could explain what a fit without one left."""
    if minimum.cost > MISFIT**2 * minimum.square:
        return True
    ends = np.array([minimum.farthest, minimum.nearest])
    with jax.enable_x64(True):
        grams = _gram(
            minimum.problem.model,
            observed.sample,
            minimum.gains,
            minimum.u,
            minimum.k,
            ends,
            minimum.judge,
        )
    explained = _explained(np.asarray(grams), minimum.at.free)
    return bool(explained > NOTED * minimum.cost / observed.count)


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


@jax.jit
def _gram(
    model: Model,
    sample: tuple[Group, ...],
    gains: Float[Array, "K"] | None,
    u: Float[Array, "q"],
    k: Float[Array, "C p"],
    ends: Float[Array, "2"],
    judge: Judge | None,
) -> Float[Array, "C s s"]:
    """Of [A, J, D, r] in each channel, D one row a ceiling of f, between f at both `ends`."""
    model, sample, judge = in_double((model, sample, judge))
    clamped, law = with_clamp(model), model.unpack(u)[1]
    assert clamped is not None
    assert law is not None
    far, near = jnp.log(law(ends))
    ceilings = jnp.exp(far + (np.arange(PLACES) + 0.5) / PLACES * (near - far))
    count, channel_count = len(model.searched), len(k)
    lit = np.array(model.lit)

    def of_image(at: Scenery) -> Float[Array, "C s s"]:
        columns = model.columns(u, at)
        predicted = jnp.stack(predict(columns, k))
        slopes = jnp.stack([jnp.stack(moved) for moved in model.slopes(u, k, at)], axis=-1)
        moved = jnp.moveaxis(model.pushed(slopes), -1, 1)

        def change(ceiling: Float[Array, ""]) -> Float[Array, "C P"]:
            # min(f, ceiling) is the clamped law of ceiling / f, times the ceiling.
            v = u.at[count:].multiply(ceiling)
            scaled = jnp.where(lit, ceiling * k, k)
            return jnp.stack(predict(clamped.columns(v, at), scaled)) - predicted

        each = [jnp.stack(per_channel(column, channel_count)) for column in columns]
        rows = jnp.concatenate(
            [
                jnp.stack(each, axis=1),
                moved,
                jnp.moveaxis(lax.map(change, ceilings), 0, 1),
                (at.photo.observed - predicted)[:, None],
            ],
            axis=1,
        )
        weighed = rows * weights_of(model, at, judge)[:, None]
        return jnp.einsum("cip,cjp->cij", weighed, rows, precision=lax.Precision.HIGHEST)

    fair = tuple(group.part(slice(0, group.fair)) for group in sample)
    return images_of(fair, model.material, gains).sum(of_image)
