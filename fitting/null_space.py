"""The null space of a symmetric matrix, and a basis of it that can be read."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

__all__ = ["Spectrum", "sparse_basis", "spectrum"]

PIVOT = 0.3
"""A pivot is no less than this share of the largest entry."""

ZERO = 0.02


class Spectrum(NamedTuple):
    """A symmetric positive semidefinite matrix as N N' = null space and R R' = pseudo-inverse.

    The matrix is scaled to a diagonal of ones first, so that units do not matter; rows of N are in
    the scaled unknowns, rows of R in the unknowns as they are. `tolerance` is what counts as zero
    in N: the square root of what counts as a zero eigenvalue.
    """

    null: Float[np.ndarray, "n d"]
    root: Float[np.ndarray, "n r"]
    scale: Float[np.ndarray, "n"]
    tolerance: float


def spectrum(matrix: Float[np.ndarray, "n n"], free: Bool[np.ndarray, "n"], eps: float) -> Spectrum:
    """Of the rows and columns that are free; `eps` is the rounding with which the matrix was summed.

    >>> found = spectrum(np.array([[1.0, 2.0], [2.0, 4.0]]), np.array([True, True]), 2e-16)
    >>> bool(np.allclose(np.abs(found.null), 0.5**0.5))
    True
    """
    scale = np.sqrt(np.diagonal(matrix))
    scale = np.where(scale > 0, scale, 1.0)
    at = np.flatnonzero(free)
    values, vectors = np.linalg.eigh(matrix[np.ix_(at, at)] / np.outer(scale[at], scale[at]))
    threshold = 8 * len(free) * eps
    zero = values <= threshold
    null = np.zeros((len(free), int(zero.sum())))
    root = np.zeros((len(free), int((~zero).sum())))
    null[at] = vectors[:, zero]
    root[at] = vectors[:, ~zero] / np.sqrt(values[~zero]) / scale[at, None]
    return Spectrum(null, root, scale, max(threshold**0.5, 1e-4))


def sparse_basis(
    vectors: Float[np.ndarray, "m d"],
    order: Float[np.ndarray, "m"],
    *,
    beside: Float[np.ndarray, "m b"] | None = None,
) -> Float[np.ndarray, "m d2"]:
    """A basis of the same space with many zeros: its reduced row echelon form.

    Pivots are taken among the largest entries, of these the one of the least `order`. Parts of the
    space that share no coordinate come apart exactly. The largest entry of each vector is 1; what is
    under a fiftieth of it is 0. `beside` is such a basis of another space, whose vectors may be
    added to these.

    >>> mixed = np.array([[1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [0.0, 0.0]])
    >>> sparse_basis(mixed, np.arange(4.0)).T
    array([[1., 1., 0., 0.],
           [0., 0., 1., 0.]])
    """
    rows = np.array(vectors.T, float)
    if beside is not None and rows.size:
        for other in beside.T:
            candidates = np.flatnonzero(np.abs(other) > PIVOT)
            column = candidates[np.argmin(order[candidates])]
            rows -= np.outer(rows[:, column] / other[column], other)
    rows = rows / np.maximum(np.max(np.abs(rows), axis=1, keepdims=True, initial=0), 1e-300)
    kept = 0
    for _ in range(len(rows)):
        rest = np.abs(rows[kept:])
        largest = rest.max(axis=0)
        if largest.max() < 1e-9:
            break
        candidates = np.flatnonzero(largest > PIVOT * largest.max())
        column = candidates[np.argmin(order[candidates])]
        pivot = kept + int(np.argmax(rest[:, column]))
        rows[[kept, pivot]] = rows[[pivot, kept]]
        rows[kept] /= rows[kept, column]
        others = np.arange(len(rows)) != kept
        rows[others] -= np.outer(rows[others, column], rows[kept])
        kept += 1
    rows = rows[:kept]
    rows = rows / np.take_along_axis(rows, np.abs(rows).argmax(axis=1)[:, None], axis=1)
    return np.where(np.abs(rows) < ZERO, 0, rows).T
