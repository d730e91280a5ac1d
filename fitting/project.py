"""Variable projection: the linear coefficients eliminated, and all that is left in one small matrix.

For a given u the best linear coefficients k(u) solve a small bounded least-squares problem in each
channel. What is left, |y - A(u) k(u)|^2, is a nonlinear least-squares problem in u alone (Golub and
Pereyra 1973), whose Gauss-Newton model needs only the Gram matrix of A, of J = (dA/du) k and of the
residual r = y - A k (Kaufman 1975), summed over all pixels. Its Cholesky factor then stands for the
residual: as many numbers as there are unknowns, and one.

The residual that is summed is the one at a k near the best. Subtracting Gram matrices of y itself would
leave nothing of a small residual in float32.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Bool, Float

from diffshade.channels import Channels, per_channel
from fitting import closed_form
from fitting.arrays import Array
from fitting.columns import Scenery, predict
from fitting.linear import bounded_least_squares, planes_of
from fitting.model import Model
from fitting.weights import Judge

__all__ = [
    "Gains",
    "Linearised",
    "Problem",
    "best_linear",
    "compress",
    "gram",
    "gram_of",
    "linearise",
    "observed_gram",
    "raw_square",
    "weights_of",
]


LEAST_GAIN = 0.1
"""Times the last: what a gain may fall to in one step."""


class Problem(eqx.Module):
    """A model, and the bounds on its linear coefficients; `norm` of all that is observed is a unit."""

    model: Model
    lower: Float[Array, "C p"]
    upper: Float[Array, "C p"]
    norm: Float[Array, ""]


class Gains(NamedTuple):
    """Where the strength g of each image's lights is unknown: what fits best at this k and u.

    `crossed` holds the products of d(A k)/dg with [A, J] in each channel, `square` its own square.
    """

    best: Float[Array, "K"]
    crossed: Float[Array, "K C r"]
    square: Float[Array, "K"]


class Linearised(eqx.Module):
    """The fit around y: |r + J dy|^2 = cost - 2 gradient.dy + dy.hessian.dy, k eliminated.

    k moves by `slope` dy. `information` holds the Gram matrix of [A, J, r] in each channel, k not
    eliminated; `image_cost` the |r|^2 of each image.
    """

    k: Float[Array, "C p"]
    free: Bool[Array, "C p"]
    slope: Float[Array, "C p m"]
    cost: Float[Array, ""]
    gradient: Float[Array, "m"]
    hessian: Float[Array, "m m"]
    information: Float[Array, "C n n"]
    image_cost: Float[Array, "K"]
    gains: Gains | None


def observed_gram(
    model: Model, u: Float[Array, "q"], at: Scenery, judge: Judge | None = None
) -> Float[Array, "C n n"]:
    """Of the rows [A, y] of one image, weighed as `judge` says: what tells k(u)."""
    rows = [*model.columns(u, at), tuple(at.photo.observed)]
    return gram_of(rows, model.channel_count, weights_of(model, at, judge))


def gram(
    model: Model,
    u: Float[Array, "q"],
    k: Float[Array, "C p"],
    at: Scenery,
    judge: Judge | None = None,
) -> Float[Array, "C n n"]:
    """Of the rows [A, J, r] of one image, weighed as `judge` says.

    J has a row for each unknown, as if it depended on no other.
    """
    photo, count = at.photo, model.channel_count
    columns = model.columns(u, at)
    left = [y - p for y, p in zip(photo.observed, predict(columns, k), strict=True)]
    weights = weights_of(model, at, judge)
    return gram_of([*columns, *model.slopes(u, k, at), tuple(left)], count, weights)


def weights_of(model: Model, at: Scenery, judge: Judge | None) -> Float[Array, "_ P"]:
    """Of the observations of an image: one for all channels, or as `judge` says."""
    photo = at.photo
    if judge is None:
        return photo.weight[None]
    judged = jnp.stack(predict(model.columns(judge.u, at), judge.k))
    return photo.weight[None] * judge.weights(judged, photo.observed, photo.clipped)


def gram_of(
    rows: Sequence[Channels], count: int, weights: Float[Array, "_ P"]
) -> Float[Array, "C n n"]:
    """The products of rows in each of `count` channels, summed over the points with their weights."""
    planes = jnp.stack([jnp.stack(per_channel(row, count)) for row in rows], axis=1)
    weighed = planes * weights[:, None]
    return jnp.einsum("cip,cjp->cij", weighed, planes, precision=lax.Precision.HIGHEST)


def best_linear(
    problem: Problem, total: Float[Array, "*N C n n"]
) -> tuple[Float[Array, "*N C p"], Float[Array, "*N"]]:
    """k within its bounds, and the cost, from the Gram matrix of [A, y] over all images."""
    moment = total[..., :-1, -1]
    xp = moment.__array_namespace__()
    lower, upper = (xp.broadcast_to(x, moment.shape) for x in (problem.lower, problem.upper))
    k, _ = bounded_least_squares(total[..., :-1, :-1], moment, lower, upper)
    return k, _square(total, k).sum(axis=-1)


def linearise(
    problem: Problem,
    each: Float[Array, "K C n n"],
    k: Float[Array, "C p"],
    gains: Float[Array, "K"] | None = None,
) -> Linearised:
    """k(u) and the Gauss-Newton model around u, from the Gram matrices of every image at u and k.

    The arrays are JAX's or NumPy's.
    """
    xp, p = k.__array_namespace__(), k.shape[1]
    model, total = problem.model, each.sum(axis=0)
    change, free = bounded_least_squares(
        total[:, :p, :p], total[:, :p, -1], problem.lower - k, problem.upper - k
    )
    best = _snapped(problem, k, k + change, free)
    half = _onto(model, total, change[:, None])
    information = _onto(model, xp.matrix_transpose(half), change[:, None])

    # k refined once against the residual that was actually left
    across = information[:, :p, p:]
    inner = [[entry[:, None] for entry in row] for row in planes_of(information[:, :p, :p])]
    among = [each[:, None] for each in xp.unstack(free, axis=1)]
    solved = closed_form.solve(inner, list(xp.unstack(across, axis=1)), among)
    solution = xp.stack(solved, axis=1) if p else across
    schur = information[:, p:, p:] - xp.matmul(xp.matrix_transpose(across), solution)
    rest = schur.sum(axis=0)
    return Linearised(
        k=xp.clip(best + solution[:, :, -1], problem.lower, problem.upper),
        free=free,
        slope=-solution[:, :, :-1],
        cost=xp.maximum(rest[-1, -1], 0),
        gradient=rest[:-1, -1],
        hessian=rest[:-1, :-1],
        information=information,
        image_cost=_square(each, change[None]).sum(axis=-1),
        gains=None if gains is None else _gains(model, each, change, best, gains),
    )


def _onto(
    model: Model, rows: Float[Array, "*N n"], change: Float[Array, "*M p"]
) -> Float[Array, "*N r"]:
    """Products with [A, dA/du k, r] as products with [A, J, r - A change]."""
    xp, p = rows.__array_namespace__(), change.shape[-1]
    linear, unknown, left = rows[..., :p], rows[..., p:-1], rows[..., -1:]
    left = left - (linear * change).sum(axis=-1)[..., None]
    return xp.concatenate([linear, model.pushed(unknown), left], axis=-1)


def compress(at: Linearised, eps: float) -> tuple[Float[Array, "n"], Float[Array, "n m"]]:
    """r and J with J'J = H, J'r = -g and r.r = cost: a Cholesky factor, scaled and guarded.

    A coordinate that the data see only within their rounding `eps` has no column. The diagonal is
    raised by what rounding may have taken from it: eliminating k leaves of a column's square `raw`
    only its `curvature`, with errors in proportion to `raw`.
    """
    m = at.gradient.size
    curvature, raw = jnp.diagonal(at.hessian), raw_square(at)
    alive = curvature > 30 * eps * raw
    scale = jnp.sqrt(jnp.where(alive, curvature, 1))
    keep = alive.astype(at.gradient.dtype)
    matrix = at.hessian * jnp.outer(keep / scale, keep / scale)
    least = float(jnp.finfo(at.gradient.dtype).eps)
    raised = 1 + 20 * least * jnp.where(alive, raw / jnp.where(alive, curvature, 1), 1)
    diagonal = jnp.eye(m, dtype=matrix.dtype)
    factor = jnp.linalg.cholesky(matrix * (1 - diagonal) + raised[:, None] * diagonal)
    z = jax.scipy.linalg.solve_triangular(factor, at.gradient * keep / scale, lower=True)
    rest = jnp.sqrt(jnp.maximum(at.cost - z @ z, 0))
    jacobian = jnp.append(-factor.T * (scale * keep)[None], jnp.zeros((1, m), z.dtype), axis=0)
    return jnp.append(z, rest), jacobian


def raw_square(at: Linearised) -> Float[Array, "m"]:
    """Of each coordinate's column, before k is eliminated."""
    p = at.k.shape[1]
    diagonal = at.information.__array_namespace__().diagonal(at.information, axis1=1, axis2=2)
    return diagonal[:, p:-1].sum(axis=0)


def _snapped(
    problem: Problem, reference: Float[Array, "C p"], k: Float[Array, "C p"], free: Array
) -> Float[Array, "C p"]:
    """k with what lies on a bound exactly there, whatever rounding made of it."""
    xp, lower, upper = k.__array_namespace__(), problem.lower, problem.upper
    nearest = xp.where(k - lower <= upper - k, lower, upper)
    near = xp.abs(k - nearest) <= 1e-3 * xp.abs(reference - nearest)
    return xp.where(~free & near & xp.isfinite(nearest), nearest, xp.clip(k, lower, upper))


def _gains(
    model: Model,
    each: Float[Array, "K C n n"],
    change: Float[Array, "C p"],
    k: Float[Array, "C p"],
    gains: Float[Array, "K"],
) -> Gains:
    """Of an image I_a k_a + g L, L its lit part: g follows by least squares from <L, r> and <L, L>.

    The mean is kept at 1.
    """
    xp, p = k.__array_namespace__(), k.shape[1]
    lit = k * np.array(model.lit, k.dtype)
    along = _onto(model, (each[..., :p] * lit[:, None]).sum(axis=-1), change)
    square = (along[:, :, :p] * lit).sum(axis=(1, 2))
    left, dark = along[:, :, -1].sum(axis=1), square == 0
    # Not to 0 in one step: an image without light could not say that it has some.
    step = 1 + xp.where(dark, 0, left / xp.where(dark, 1, square))
    better = gains * xp.maximum(step, LEAST_GAIN)
    own = xp.where(gains == 0, 1, gains)
    return Gains(better / better.mean(), along[:, :, :-1] / own[:, None, None], square / own**2)


def _square(gram: Float[Array, "*N C n n"], change: Float[Array, "*M C p"]) -> Float[Array, "*N C"]:
    """|r - A change|^2 in each channel, r the last row."""
    p = change.shape[-1]
    crossed = (change * gram[..., :p, -1]).sum(axis=-1)
    inner = (change[..., :, None] * gram[..., :p, :p] * change[..., None, :]).sum(axis=(-1, -2))
    return gram[..., -1, -1] - 2 * crossed + inner
