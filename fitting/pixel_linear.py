"""Least squares with two or three unknowns at each of many pixels, in closed form over planes.

A matrix is a list of rows of planes, one number a pixel; a vector a list of planes. All is written out,
as there are a handful of unknowns: a library call for each pixel's matrix would cost a hundred times
as much.
"""

import operator
from collections.abc import Sequence
from functools import reduce

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

__all__ = ["bounded", "own_share", "rounding", "solve"]

Plane = Float[Array, "..."]
Mask = Bool[Array, "..."]
Vector = list[Plane]
Matrix = list[Vector]
Interval = tuple[float, float]


def solve(matrix: Matrix, right: Vector, free: Sequence[Mask | bool] | None = None) -> Vector:
    """x with Mx = b for a positive semidefinite M, over the unknowns that are `free`; the others are 0.

    Gauss's elimination. An unknown whose column depends on those before it within rounding gets 0.
    """
    size = len(right)
    m, b = [list(row) for row in matrix], list(right)
    free = [True] * size if free is None else list(free)
    inverse = []
    for j in range(size):
        independent = (m[j][j] > rounding(matrix[j][j])) & free[j]
        inverse.append(jnp.where(independent, 1 / jnp.where(independent, m[j][j], 1), 0))
        for i in range(j + 1, size):
            share = m[i][j] * inverse[j]
            for k in range(j + 1, size):
                m[i][k] = m[i][k] - share * m[j][k]
            b[i] = b[i] - share * b[j]
    x: Vector = []
    for j in reversed(range(size)):
        known = sum(
            (m[j][k] * x_k for k, x_k in zip(range(j + 1, size), x, strict=True)),
            jnp.zeros_like(b[j]),
        )
        x.insert(0, (b[j] - known) * inverse[j])
    return x


def own_share(matrix: Matrix, index: int) -> Plane:
    """What of a column's square no other column explains; 0 where that is within rounding.

    M is the Gram matrix of the columns. One over it is the diagonal entry of the inverse of M: the
    variance of that unknown for noise 1 (Cramer and Rao).
    """
    others = [i for i in range(len(matrix)) if i != index]
    if not others:
        return matrix[index][index]
    across = [matrix[i][index] for i in others]
    explained = solve([[matrix[i][j] for j in others] for i in others], across)
    left = matrix[index][index] - sum(a * x for a, x in zip(across, explained, strict=True))
    return jnp.where(left > rounding(matrix[index][index]), left, 0)


def bounded(matrix: Matrix, moment: Vector, bounds: Sequence[Interval]) -> tuple[Vector, Plane]:
    """The k that minimises k'Mk/2 - m'k within bounds, and that minimum.

    The free solution where it lies within. Else at least one of those that it carries beyond a bound
    lies on that bound: for on the way from the minimum to the free solution, which is downhill, a
    bound is met at once. Each of these is tried, a problem of one unknown fewer.
    """
    best = solve(matrix, moment)
    beyond = [(x < low) | (x > high) for x, (low, high) in zip(best, bounds, strict=True)]
    within = [jnp.clip(x, low, high) for x, (low, high) in zip(best, bounds, strict=True)]
    if len(moment) == 1:
        return within, _objective(matrix, moment, within)
    least = jnp.where(reduce(operator.or_, beyond), jnp.inf, _objective(matrix, moment, best))
    for i, (edge, tried) in enumerate(zip(within, beyond, strict=True)):
        others = [j for j in range(len(moment)) if j != i]
        inner = [[matrix[a][b] for b in others] for a in others]
        right = [moment[j] - edge * matrix[j][i] for j in others]
        k, value = bounded(inner, right, [bounds[j] for j in others])
        value = value + edge * (0.5 * matrix[i][i] * edge - moment[i])
        better = tried & (value < least)
        least = jnp.where(better, value, least)
        k.insert(i, edge)
        best = [jnp.where(better, new, old) for new, old in zip(k, best, strict=True)]
    return best, least


def _objective(matrix: Matrix, moment: Vector, k: Vector) -> Plane:
    """k'Mk/2 - m'k"""
    value = jnp.zeros_like(k[0])
    for i, k_i in enumerate(k):
        value = value + k_i * (0.5 * matrix[i][i] * k_i - moment[i])
        for j in range(i):
            value = value + k_i * k[j] * matrix[i][j]
    return value


def rounding(square: Plane) -> Plane:
    """What of a column's square may be rounding, or underflow."""
    info = jnp.finfo(square.dtype)
    return jnp.maximum(30 * float(info.eps) * square, float(info.tiny / info.eps))
