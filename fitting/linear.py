"""Small least squares under bounds, exactly: the linear coefficients of a channel, the step of a search.

The arrays are JAX's or NumPy's.
"""

from itertools import product

import numpy as np
from jaxtyping import Bool, Float, Int

from fitting import closed_form
from fitting.arrays import Array
from fitting.closed_form import Plane, Vector

__all__ = ["bounded_least_squares", "damped_step", "planes_of"]

WRITTEN_OUT = 3
"""Unknowns up to which the closed form is the shorter program."""
FREE, AT_LOWER, AT_UPPER = 0, 1, 2


def bounded_least_squares(
    gram: Float[Array, "*N p p"],
    moment: Float[Array, "*N p"],
    lower: Float[Array, "*N p"],
    upper: Float[Array, "*N p"],
    *,
    nothing: float | None = None,
) -> tuple[Float[Array, "*N p"], Bool[Array, "*N p"]]:
    """The k that minimises k'Gk/2 - g'k within lower <= k <= upper, and which of its entries are free.

    G = A'A and g = A'y are the Gram matrix and the moment of least squares. p is small (one
    coefficient a term), so it is solved exactly, with no iteration and no start: in closed form, or
    else in each of the 3^p ways to hold entries at a bound, of which the best feasible one is taken.
    An entry whose column is zero, or so little of the largest that it is `nothing` (by default the
    precision), is held at its lower bound, or at 0; equal bounds hold an entry at their value.
    """
    xp, p = moment.__array_namespace__(), moment.shape[-1]
    if p == 0:
        return moment, moment < 0
    diagonal = xp.diagonal(gram, axis1=-2, axis2=-1)
    share = float(np.finfo(gram.dtype).eps) if nothing is None else nothing
    seen = diagonal > share**2 * xp.max(diagonal, axis=-1, keepdims=True)
    gram = xp.where(seen[..., None] & seen[..., None, :], gram, 0)
    rows, right = planes_of(gram), list(xp.unstack(xp.where(seen, moment, 0), axis=-1))
    low, high = (list(xp.unstack(edge, axis=-1)) for edge in (lower, upper))
    if p <= WRITTEN_OUT:
        each, _ = closed_form.bounded(rows, right, list(zip(low, high, strict=True)))
    else:
        each = _every_way(rows, right, low, high)
    k = xp.stack(each, axis=-1)
    return k, (lower < k) & (k < upper) & seen


def damped_step(
    hessian: Float[Array, "m m"],
    moment: Float[Array, "m"],
    damping: float | Float[Array, ""],
    lower: Float[Array, "m"],
    upper: Float[Array, "m"],
) -> Float[Array, "m"]:
    """The d within bounds that minimises d'Hd/2 - g'd + damping d'Dd/2, D the diagonal of H.

    Damped in proportion to the curvature (Marquardt 1963), so that units do not matter.
    """
    xp, info = moment.__array_namespace__(), np.finfo(moment.dtype)
    curvature = xp.diagonal(hessian)
    least = 1e-6 * xp.max(curvature, initial=0) + float(info.tiny) ** 0.5
    # In units in which every unknown has the same curvature
    unit = 1 / xp.sqrt(xp.maximum(curvature, least))
    scaled = hessian * unit[:, None] * unit[None] + damping * np.eye(len(unit), dtype=info.dtype)
    step, _ = bounded_least_squares(scaled, moment * unit, lower / unit, upper / unit)
    return xp.clip(step * unit, lower, upper)


def planes_of(matrix: Float[Array, "*N m n"]) -> list[list[Float[Array, "*N"]]]:
    """The entries of matrices, row by row."""
    xp = matrix.__array_namespace__()
    return [list(xp.unstack(row, axis=-1)) for row in xp.unstack(matrix, axis=-2)]


def _every_way(rows: list[Vector], right: Vector, low: Vector, high: Vector) -> Vector:
    """The best of the 3^p ways to hold entries at a bound or not."""
    xp, p = right[0].__array_namespace__(), len(right)
    ways = np.array(list(product((FREE, AT_LOWER, AT_UPPER), repeat=p))).T
    ways = xp.asarray(ways.reshape(p, *(1,) * right[0].ndim, -1))
    matrix = [[entry[..., None] for entry in row] for row in rows]
    low, high, moment = ([x[..., None] for x in planes] for planes in (low, high, right))
    free = [way == FREE for way in ways]
    edges = [
        xp.where(way == AT_LOWER, a, xp.where(way == AT_UPPER, b, 0))
        for way, a, b in zip(ways, low, high, strict=True)
    ]
    possible = [xp.isfinite(edge) for edge in edges]
    held = [xp.where(finite, edge, 0) for finite, edge in zip(possible, edges, strict=True)]
    left = [
        g - sum(row[j] * held[j] for j in range(p)) for g, row in zip(moment, matrix, strict=True)
    ]
    solved = closed_form.solve(matrix, left, free)
    feasible = possible[0]
    k: Vector = []
    for j in range(p):
        inside = xp.clip(solved[j], low[j], high[j])
        slack = 8 * float(np.finfo(inside.dtype).eps) * (1 + xp.abs(inside))
        within = ~free[j] | (xp.abs(solved[j] - inside) <= slack)
        feasible = feasible & possible[j] & within
        k.append(xp.where(free[j], inside, held[j]))
    value = closed_form.objective(matrix, moment, k)
    best = xp.argmin(xp.where(feasible & xp.isfinite(value), value, xp.inf), axis=-1)
    pick = best[..., None]
    return [_picked(x, pick) for x in k]


def _picked(plane: Plane, index: Int[Array, "*N 1"]) -> Plane:
    xp = plane.__array_namespace__()
    return xp.take_along_axis(plane, index, axis=-1)[..., 0]
