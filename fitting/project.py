"""Variable projection: the linear coefficients eliminated, streamed over blocks of pixels.

For a given u the best linear coefficients k(u) solve a small bounded least-squares problem in each
channel, whose Gram matrix is summed over blocks, images and channels; nothing as large as an image is
ever formed. What is left, |y - A(u) k(u)|^2, is a nonlinear least-squares problem in u alone. Its
Gauss-Newton model needs only a Gram matrix with the derivative columns in it (Kaufman 1975), whose
Cholesky factor stands for the residual: as many numbers as there are unknowns, and one.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from diffshade.geometry.gbuffer import GBuffer
from diffshade.scene import Scene
from fitting.linear import bounded_least_squares, solve_positive
from fitting.model import Model
from fitting.observation import Group

__all__ = ["Linearised", "Problem", "compressed_residual", "cost", "linearise"]


class Problem(eqx.Module):
    """A model, the observations in groups of one structure, and the bounds on linear coefficients."""

    model: Model
    groups: tuple[Group, ...]
    lower: Float[Array, "C p"]
    upper: Float[Array, "C p"]
    norm: Float[Array, ""]  # of everything observed: the unit of the residual
    block_share: Float[Array, ""]  # in [0, 1]: the share of the blocks looked at, one at the least


class Linearised(eqx.Module):
    """The fit around u: |r + J du|^2 = cost - 2 gradient.du + du.hessian.du, k eliminated.

    `information` holds the Gram matrix of [A, J, r] in each channel, k not eliminated.
    """

    k: Float[Array, "C p"]
    free: Bool[Array, "C p"]
    cost: Float[Array, ""]
    gradient: Float[Array, "q"]
    hessian: Float[Array, "q q"]
    information: Float[Array, "C n n"]


def cost(problem: Problem, u: Float[Array, "q"]) -> Float[Array, ""]:
    """min over k of |y - A(u) k|^2; one pass over the data."""
    gram = _gram(problem, u)
    k, _ = _solve(problem, gram)
    ends = jnp.append(k, -jnp.ones((k.shape[0], 1), k.dtype), axis=1)
    return jnp.einsum("ci,cij,cj->", ends, gram, ends)  # |A k - y|^2


def linearise(problem: Problem, u: Float[Array, "q"]) -> Linearised:
    """k(u) and the Gauss-Newton model around u; two passes over the data.

    The second pass sums the actual residual: subtracting Gram matrices from each other would leave
    nothing of a small residual in float32.
    """
    k, _ = _solve(problem, _gram(problem, u))
    gram = _gram_with_derivatives(problem, u, k)
    p, q = k.shape[1], u.size
    # One refinement of k against the residual that was actually left, then which of it is free.
    at_lower, at_upper = k <= problem.lower, k >= problem.upper
    seen = jnp.diagonal(gram, axis1=1, axis2=2)[:, :p] > 0
    free = ~at_lower & ~at_upper & seen

    def eliminate(gram: Array, free: Array) -> tuple[Array, Array]:
        keep = free.astype(gram.dtype)
        inner = gram[:p, :p] * jnp.outer(keep, keep) + jnp.diag(1 - keep)
        scale = 1 / jnp.sqrt(jnp.diagonal(inner))
        inner = inner * jnp.outer(scale, scale)
        side = gram[:p, p:] * (keep * scale)[:, None]
        solved = solve_positive(inner, side)
        return gram[p:, p:] - side.T @ solved, solved[:, q] * scale * keep

    schur, change = jax.vmap(eliminate)(gram, free)
    total = jnp.sum(schur, axis=0)
    k = jnp.clip(k + change, problem.lower, problem.upper)
    return Linearised(k, free, jnp.maximum(total[q, q], 0), total[:q, q], total[:q, :q], gram)


def compressed_residual(
    u: Float[Array, "q"], problem: Problem
) -> tuple[Float[Array, "m"], Linearised]:
    """q + 1 numbers with the norm and the Gauss-Newton model of the whole residual; and that model.

    Its derivative in u is the Jacobian that the data gave, not that of the eliminations above.
    """
    here = jax.lax.stop_gradient(u)
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


def _solve(problem: Problem, gram: Array) -> tuple[Array, Array]:
    p = problem.lower.shape[1]
    return jax.vmap(bounded_least_squares)(
        gram[:, :p, :p], gram[:, :p, p], problem.lower, problem.upper
    )


def _gram(problem: Problem, u: Array) -> Float[Array, "C n n"]:
    """The Gram matrix of [A, y], summed over everything observed."""

    def rows(gbuffer: GBuffer, scene: Scene, observed: Array) -> Float[Array, "C n P"]:
        columns = problem.model.columns(u, gbuffer, scene)
        return jnp.concatenate([columns, observed[:, None]], axis=1)

    return _sum_grams(problem, rows, problem.lower.shape[1] + 1)


def _gram_with_derivatives(problem: Problem, u: Array, k: Array) -> Float[Array, "C n n"]:
    """The Gram matrix of [A, J, r], with J = d(A k)/du at fixed k and r = y - A k."""

    def rows(gbuffer: GBuffer, scene: Scene, observed: Array) -> Float[Array, "C n P"]:
        def image(u: Array) -> tuple[Array, tuple[Array, Array]]:
            columns = problem.model.columns(u, gbuffer, scene)
            predicted = jnp.einsum("cpi,cp->ci", columns, k)
            return predicted, (predicted, columns)

        jacobian, (predicted, columns) = jax.jacfwd(image, has_aux=True)(u)
        residual = observed - predicted
        return jnp.concatenate([columns, jnp.moveaxis(jacobian, -1, 1), residual[:, None]], axis=1)

    return _sum_grams(problem, rows, k.shape[1] + u.size + 1)


def _sum_grams(
    problem: Problem, rows: Callable[[GBuffer, Scene, Array], Array], size: int
) -> Float[Array, "C n n"]:
    """The sum of R W R' over blocks and images, R the rows of one block, W its pixels' weights."""
    total = jnp.zeros((problem.lower.shape[0], size, size), problem.lower.dtype)
    for group in problem.groups:
        total = total + _sum_group(group, problem.block_share, rows, total)
    return total


def _sum_group(
    group: Group,
    share: Float[Array, ""],
    rows: Callable[[GBuffer, Scene, Array], Array],
    zero: Float[Array, "C n n"],
) -> Float[Array, "C n n"]:
    block_count = group.observed.shape[1]
    # How many blocks are visited is a value, not a shape: few and all run in one program.
    visited = jnp.maximum(1, jnp.round(share * block_count).astype(int))

    def add_image(total: Array, image: tuple[Scene, Array, Array]) -> tuple[Array, None]:
        scene, observed, weight = image

        def add_block(b: Array, total: Array) -> Array:
            gbuffer = jax.tree.map(lambda plane: plane[b], group.blocks)
            r = rows(gbuffer, scene, observed[b])
            return total + jnp.einsum("cip,p,cjp->cij", r, weight[b], r)

        return jax.lax.fori_loop(0, visited, add_block, total), None

    return jax.lax.scan(add_image, zero, (group.scenes, group.observed, group.weight))[0]
