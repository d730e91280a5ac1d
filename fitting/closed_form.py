"""Least squares with a handful of unknowns, for many problems at once, in closed form over planes.

A matrix is a list of rows of planes, one number a problem; a vector a list of planes. All is written
out: a library call for each small matrix would cost a hundred times as much. The planes are JAX's or
NumPy's.
"""

import operator
from collections.abc import Sequence
from functools import reduce

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Bool, Float

from fitting.arrays import Array

__all__ = ["Matrix", "Plane", "Vector", "bounded", "objective", "own_share", "rounding", "solve"]

Plane = Float[Array, "..."]
Mask = Bool[Array, "..."]
Vector = list[Plane]
Matrix = list[Vector]
Interval = tuple[float | Plane, float | Plane]


def _where(condition: Mask, a: Plane | float, b: Plane | float) -> Plane:
    """`where` of planes of one shape, or numbers: JAX's own takes several times as long to trace."""
    if isinstance(condition, (np.ndarray, np.generic)):
        return np.where(condition, a, b)
    like = next(x for x in (a, b) if not isinstance(x, float))
    a, b = (lax.full_like(like, x) if isinstance(x, float) else x for x in (a, b))
    shape = np.broadcast_shapes(condition.shape, a.shape, b.shape)
    return lax.select(*(jnp.broadcast_to(x, shape) for x in (condition, a, b)))


def solve(matrix: Matrix, right: Vector, free: Sequence[Mask] | None = None) -> Vector:
    """x with Mx = b for a positive semidefinite M, over the unknowns that are `free`; the others are 0.

    Gauss's elimination. An unknown whose column depends on those before it within rounding gets 0.
    """
    size = len(right)
    m, b = [list(row) for row in matrix], list(right)
    inverse = []
    for j in range(size):
        independent = m[j][j] > rounding(matrix[j][j])
        if free is not None:
            independent = independent & free[j]
        inverse.append(_where(independent, 1 / _where(independent, m[j][j], 1.0), 0.0))
        for i in range(j + 1, size):
            share = m[i][j] * inverse[j]
            for k in range(j + 1, size):
                m[i][k] = m[i][k] - share * m[j][k]
            b[i] = b[i] - share * b[j]
    x: Vector = []
    for j in reversed(range(size)):
        left = b[j]
        for k, x_k in zip(range(j + 1, size), x, strict=True):
            left = left - m[j][k] * x_k
        x.insert(0, left * inverse[j])
    return x


def own_share(matrix: Matrix, index: int) -> Plane:
    """What of a column's square no other column explains; 0 where that is within rounding.

    M is the Gram matrix of the columns. One over it is the diagonal entry of the inverse of M: the
    variance of that unknown for noise 1 (Cramer and Rao).
    """
    others = [i for i in range(len(matrix)) if i != index]
    own = matrix[index][index]
    if not others:
        return own
    across = [matrix[i][index] for i in others]
    explained = solve([[matrix[i][j] for j in others] for i in others], across)
    left = own - sum(a * x for a, x in zip(across, explained, strict=True))
    return _where(left > rounding(own), left, 0.0)


def bounded(matrix: Matrix, moment: Vector, bounds: Sequence[Interval]) -> tuple[Vector, Plane]:
    """The k that minimises k'Mk/2 - m'k within bounds, and that minimum.

    The free solution where it lies within. Else at least one of those that it carries beyond a bound
    lies on that bound: for on the way from the minimum to the free solution, which is downhill, a
    bound is met at once. Each of these is tried, a problem of one unknown fewer.
    """
    xp = moment[0].__array_namespace__()
    best = solve(matrix, moment)
    within = [
        xp.minimum(xp.maximum(x, low), high) for x, (low, high) in zip(best, bounds, strict=True)
    ]
    if len(moment) == 1:
        return within, objective(matrix, moment, within)
    beyond = [x != y for x, y in zip(best, within, strict=True)]
    if isinstance(best[0], np.ndarray) and not np.any(beyond):
        return best, objective(matrix, moment, best)
    least = _where(reduce(operator.or_, beyond), np.inf, objective(matrix, moment, best))
    for i, (edge, tried) in enumerate(zip(within, beyond, strict=True)):
        others = [j for j in range(len(moment)) if j != i]
        inner = [[matrix[a][b] for b in others] for a in others]
        right = [moment[j] - edge * matrix[j][i] for j in others]
        k, value = bounded(inner, right, [bounds[j] for j in others])
        value = value + edge * (0.5 * matrix[i][i] * edge - moment[i])
        better = tried & (value < least)
        least = _where(better, value, least)
        k.insert(i, edge)
        best = [_where(better, new, old) for new, old in zip(k, best, strict=True)]
    return best, least


def objective(matrix: Matrix, moment: Vector, k: Vector) -> Plane:
    """k'Mk/2 - m'k"""
    terms = []
    for i, k_i in enumerate(k):
        slope = 0.5 * matrix[i][i] * k_i - moment[i]
        for j in range(i):
            slope = slope + k[j] * matrix[i][j]
        terms.append(k_i * slope)
    return reduce(operator.add, terms)


def rounding(square: Plane) -> Plane:
    """What of a column's square may be rounding, or underflow."""
    info = np.finfo(square.dtype)
    xp = square.__array_namespace__()
    return xp.maximum(30 * float(info.eps) * square, float(info.tiny / info.eps))
