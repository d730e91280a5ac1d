"""Variable projection: the linear coefficients eliminated, streamed over blocks of pixels.

For a given u the best linear coefficients k(u) solve a small bounded least-squares problem in each
channel. What is left, |y - A(u) k(u)|^2, is a nonlinear least-squares problem in u alone (Golub and
Pereyra 1973), whose Gauss-Newton model needs only the Gram matrix of A, of dA/du and of a residual
(Kaufman 1975). One pass over the data sums it, block by block; nothing as large as an image is ever
formed. Its Cholesky factor then stands for the residual: as many numbers as there are unknowns, and one.

The residual that is summed is that of a `reference` k near the solution, y - A k_ref. Subtracting Gram
matrices of y itself would leave nothing of a small residual in float32.
"""

from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from diffshade import guard
from diffshade.channels import Channels, per_channel
from fitting.linear import bounded_least_squares, solve_positive
from fitting.model import Model
from fitting.observation import Group
from fitting.stream import Block, sum_over_blocks
from fitting.weights import Judge

__all__ = ["Linearised", "Problem", "compressed_residual", "cost", "linearise", "predict"]


class Problem(eqx.Module):
    """A model, the observations in groups of one structure, and the bounds on linear coefficients."""

    model: Model
    groups: tuple[Group, ...]
    lower: Float[Array, "C p"]
    upper: Float[Array, "C p"]
    reference: Float[Array, "C p"]  # linear coefficients near the solution
    norm: Float[Array, ""]  # of everything observed: the unit of the residual
    most_blocks: Int[Array, ""]  # that are looked at, of each group
    judge: Judge | None = None  # by which observations are weighed
    gains: Float[Array, "K"] | None = None  # of each image's lights, in the order of the groups

    def each_group(self) -> Iterator[tuple[Group, Float[Array, "K"] | None]]:
        """The groups, with the gains of their images."""
        first = 0
        for group in self.groups:
            last = first + len(group.weight)
            yield group, None if self.gains is None else self.gains[first:last]
            first = last


class Gains(NamedTuple):
    """Where the strength g of each image's lights is unknown: what fits best at this k and u.

    `crossed` holds the products of d(A k)/dg with [A, J] in each channel, `square` its own square.
    """

    best: Float[Array, "K"]
    crossed: Float[Array, "K C m"]
    square: Float[Array, "K"]


class Linearised(eqx.Module):
    """The fit around u: |r + J du|^2 = cost - 2 gradient.du + du.hessian.du, k eliminated.

    `information` holds the Gram matrix of [A, J, r] in each channel, k not eliminated;
    `image_cost` the |r|^2 of each image, in the order of the groups. `reference_cost` is that of the
    reference: the cost comes of subtracting from it, and is no more precise than it.
    """

    k: Float[Array, "C p"]
    free: Bool[Array, "C p"]
    cost: Float[Array, ""]
    gradient: Float[Array, "q"]
    hessian: Float[Array, "q q"]
    information: Float[Array, "C n n"]
    image_cost: Float[Array, "K"]
    reference_cost: Float[Array, ""]
    gains: Gains | None


class Sums(NamedTuple):
    """Of rows R and the residual r, over the pixels of each of K images: R R', R r and r r.

    G is 1 where all channels share their rows, else C.
    """

    rows: Float[Array, "K G m m"]
    moment: Float[Array, "K C m"]
    square: Float[Array, "K C"]


def cost(problem: Problem, u: Float[Array, "q"]) -> tuple[Float[Array, ""], Float[Array, "C p"]]:
    """min over k of |y - A(u) k|^2, and that k; one pass over the data."""
    sums = _total(_sums(problem, u, derivatives=False))
    change, _ = _solve(problem, sums)
    return jnp.sum(_square(sums, change)), problem.reference + change


def linearise(problem: Problem, u: Float[Array, "q"]) -> Linearised:
    """k(u) and the Gauss-Newton model around u; one pass over the data."""
    model, (channel_count, p) = problem.model, problem.lower.shape
    each = _sums(problem, u, derivatives=True)
    sums = _total(each)
    change, free = _solve(problem, sums)
    k = _snapped(problem, problem.reference + change, free)

    # From rows [A, dA/du] to [A, J], J = dA/du k: one column a direction.
    m, q = model.direction_count, u.size
    dtype = u.dtype
    moves = np.zeros((len(model.moves), m, p))
    for row, (direction, column) in enumerate(model.moves):
        moves[row, direction, column] = 1
    derivative = jnp.einsum("rdc,gc->grd", jnp.asarray(moves, dtype), k)
    # and from directions to unknowns; those that are held or dependent get a column of zeros
    derivative = derivative @ model.slots.astype(dtype)
    n = p + q + 1

    size = sums.rows.shape[-1]
    to = jnp.zeros((channel_count, size, n), dtype)
    to = to.at[:, :p, :p].set(jnp.eye(p, dtype=dtype)).at[:, p:, p : p + q].set(derivative)
    rows = jnp.broadcast_to(sums.rows, (channel_count, size, size))
    moment = sums.moment - jnp.einsum("cij,cj->ci", rows[:, :, :p], change)
    gram = jnp.einsum("cia,cij,cjb->cab", to, rows, to)
    side = jnp.einsum("cia,ci->ca", to, moment)
    gram = gram.at[:, -1, :].set(side).at[:, :, -1].set(side)
    gram = gram.at[:, -1, -1].set(_square(sums, change))

    def eliminate(gram: Array, free: Array) -> tuple[Array, Array]:
        keep = free.astype(dtype)
        inner = gram[:p, :p] * jnp.outer(keep, keep) + jnp.diag(1 - keep)
        scale = 1 / jnp.sqrt(jnp.diagonal(inner))
        inner = inner * jnp.outer(scale, scale)
        side = gram[:p, p:] * (keep * scale)[:, None]
        solved = solve_positive(inner, side)
        return gram[p:, p:] - side.T @ solved, solved[:, q] * scale * keep

    # k refined once against the residual that was actually left
    schur, refinement = jax.vmap(eliminate)(gram, free)
    total = jnp.sum(schur, axis=0)
    return Linearised(
        k=jnp.clip(k + refinement, problem.lower, problem.upper),
        free=free,
        cost=jnp.maximum(total[q, q], 0),
        gradient=total[:q, q],
        hessian=total[:q, :q],
        information=gram,
        image_cost=jnp.sum(jax.vmap(_square, (0, None))(each, change), axis=-1),
        reference_cost=jnp.sum(sums.square),
        gains=None if problem.gains is None else _gains(problem, each, change, k, to[:, :, :-1]),
    )


def compressed_residual(
    u: Float[Array, "q"], problem: Problem
) -> tuple[Float[Array, "m"], Linearised]:
    """q + 1 numbers with the norm and the Gauss-Newton model of the whole residual; and that model.

    Its derivative in u is the Jacobian that the data gave, not that of the eliminations above.
    """
    here = lax.stop_gradient(u)
    at = linearise(problem, here)
    residual, jacobian = _compress(at, problem.model.held)
    return (residual + jacobian @ (u - here)) / problem.norm, at


def _compress(
    at: Linearised, held: Bool[np.ndarray, "q"]
) -> tuple[Float[Array, "m"], Float[Array, "m q"]]:
    """r and J with J'J = H, J'r = -g and r.r = cost: a Cholesky factor, scaled and guarded.

    An unknown that is held or depends on others, or that the data see only within rounding, has no
    column. The diagonal is raised by what rounding may have taken from it: eliminating k leaves of a
    column's square `raw` only its `curvature`, with errors in proportion to `raw`.
    """
    q = at.gradient.size
    eps = jnp.finfo(at.gradient.dtype).eps
    curvature = jnp.diagonal(at.hessian)
    p = at.k.shape[1]
    raw = jnp.sum(jnp.diagonal(at.information, axis1=1, axis2=2)[:, p : p + q], axis=0)
    alive = ~held & (curvature > 30 * eps * raw)
    scale = jnp.sqrt(jnp.where(alive, curvature, 1))
    keep = alive.astype(at.gradient.dtype)
    matrix = at.hessian / jnp.outer(scale, scale) * jnp.outer(keep, keep)
    raised = 1 + 20 * eps * jnp.where(alive, raw / jnp.where(alive, curvature, 1), 1)
    diagonal = jnp.eye(q, dtype=matrix.dtype)
    matrix = matrix * (1 - diagonal) + raised[:, None] * diagonal
    factor = jnp.linalg.cholesky(matrix)
    z = jax.scipy.linalg.solve_triangular(factor, at.gradient * keep / scale, lower=True)
    rest = jnp.sqrt(jnp.maximum(at.cost - z @ z, 0))
    residual = jnp.append(z, rest)
    jacobian = jnp.append(-factor.T * (scale * keep)[None, :], jnp.zeros((1, q), z.dtype), axis=0)
    return residual, jacobian


def _total(sums: Sums) -> Sums:
    """Over all images."""
    return Sums(*(jnp.sum(of_images, axis=0) for of_images in sums))


def _solve(problem: Problem, sums: Sums) -> tuple[Float[Array, "C p"], Bool[Array, "C p"]]:
    """The change of the reference that fits best within the bounds, and which of it is free."""
    channel_count, p = problem.lower.shape
    gram = jnp.broadcast_to(sums.rows[:, :p, :p], (channel_count, p, p))
    return jax.vmap(bounded_least_squares)(
        gram,
        sums.moment[:, :p],
        problem.lower - problem.reference,
        problem.upper - problem.reference,
    )


def _snapped(problem: Problem, k: Float[Array, "C p"], free: Bool[Array, "C p"]) -> Array:
    """k with what lies on a bound exactly there, whatever rounding made of it."""
    nearest = jnp.where(k - problem.lower <= problem.upper - k, problem.lower, problem.upper)
    near = jnp.abs(k - nearest) <= 1e-3 * jnp.abs(problem.reference - nearest)
    return jnp.where(
        ~free & near & jnp.isfinite(nearest), nearest, jnp.clip(k, problem.lower, problem.upper)
    )


def _gains(
    problem: Problem,
    each: Sums,
    change: Float[Array, "C p"],
    k: Float[Array, "C p"],
    to: Float[Array, "C r m"],
) -> Gains:
    """Of an image I_a k_a + g L, L its lit part: g follows by least squares from <L, r> and <L, L>.

    The mean is kept at 1.
    """
    assert problem.gains is not None
    p = k.shape[1]
    lit = k * np.array(problem.model.lit, float).astype(k.dtype)[None]
    rows = jnp.broadcast_to(each.rows, (len(each.rows), len(k), *each.rows.shape[2:]))
    moment = each.moment[:, :, :p] - jnp.einsum("gcij,cj->gci", rows[:, :, :p, :p], change)
    along = jnp.einsum("gcij,cj->gci", rows[:, :, :, :p], lit)
    square = jnp.einsum("ci,gci->g", lit, along[:, :, :p])
    step = guard.reciprocal(square) * jnp.einsum("ci,gci->g", lit, moment)
    better = problem.gains * jnp.maximum(1 + step, 0)
    return Gains(
        best=better * guard.reciprocal(jnp.mean(better)),
        crossed=jnp.einsum("gci,cim->gcm", along, to)
        * guard.reciprocal(problem.gains)[:, None, None],
        square=square * guard.reciprocal(problem.gains) ** 2,
    )


def _square(sums: Sums, change: Float[Array, "C p"]) -> Float[Array, "C"]:
    """|r - A change|^2 in each channel."""
    p = change.shape[1]
    rows = jnp.broadcast_to(sums.rows[:, :p, :p], (change.shape[0], p, p))
    crossed = jnp.einsum("ci,ci->c", change, sums.moment[:, :p])
    return sums.square - 2 * crossed + jnp.einsum("ci,cij,cj->c", change, rows, change)


def _sums(problem: Problem, u: Float[Array, "q"], *, derivatives: bool) -> Sums:
    """The sums of [A] or [A, dA/du] and the residual of the reference, image by image."""
    model, judge = problem.model, problem.judge
    channel_count = len(problem.reference)
    moves = model.moves if derivatives else ()
    directions = model.directions.astype(u.dtype)

    def of_block(block: Block, gain: Float[Array, ""] | None) -> Sums:
        columns, push = jax.linearize(lambda u: model.columns(u, block, gain), u)
        moved = [push(direction) for direction in directions] if moves else []
        present = (*columns, *(moved[i][j] for i, j in moves))
        residual = block.observed - predict(columns, problem.reference)
        if judge is None:
            weights, sets = block.weight[None], len(columns[0])
        else:
            judged = predict(model.columns(judge.u, block, gain), judge.k)
            weights = judge.weights(judged, block.observed, block.clipped) * block.weight[None]
            sets = channel_count
        # One product of tall matrices for each set of rows, the residuals among them.
        size, grams = len(present), []
        for g in range(sets):
            planes = [row[min(g, len(row) - 1)] for row in present]
            left = residual if sets < channel_count else residual[g : g + 1]
            rows = jnp.stack([*planes, *left])
            weighed = rows * weights[min(g, len(weights) - 1)][None]
            grams.append(jnp.matmul(weighed, rows.T, precision=lax.Precision.HIGHEST))
        gram = jnp.stack(grams)
        return Sums(
            gram[:, :size, :size],
            jnp.swapaxes(gram[:, :size, size:], 1, 2).reshape(channel_count, size),
            jnp.diagonal(gram[:, size:, size:], axis1=1, axis2=2).reshape(channel_count),
        )

    each = [
        sum_over_blocks(group, of_block, problem.most_blocks, gains)
        for group, gains in problem.each_group()
    ]
    # Groups whose lights have one colour share their rows; beside others each channel has its own.
    sets = max(sums.rows.shape[1] for sums in each)
    each = [
        sums._replace(
            rows=jnp.broadcast_to(sums.rows, (len(sums.rows), sets, *sums.rows.shape[2:]))
        )
        for sums in each
    ]
    return Sums(*(jnp.concatenate(of_groups) for of_groups in zip(*each, strict=True)))


def predict(columns: tuple[Channels, ...], k: Float[Array, "C p"]) -> Float[Array, "C P"]:
    """The image A k."""
    each = (per_channel(column, len(k)) for column in columns)
    terms = [jnp.stack(planes) * ks[:, None] for planes, ks in zip(each, k.T, strict=True)]
    return sum(terms[1:], terms[0])
