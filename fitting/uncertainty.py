"""How far to trust each coefficient: standard errors, and what the images cannot tell."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from fitting.project import Linearised

__all__ = ["Uncertainty", "propagate"]

Reported = Mapping[str, Float[Array, "..."]]


@dataclass(frozen=True)
class Uncertainty:
    """Standard errors of what is reported, in its shapes: infinite where the images do not tell.

    `unit_errors` are those for noise of standard deviation 1; `blind` names, for each direction in
    which coefficients can move without changing the images, the coefficients that move.
    """

    standard_errors: dict[str, np.ndarray]
    unit_errors: dict[str, np.ndarray]
    blind: tuple[tuple[str, ...], ...]
    noise: float


def propagate(
    at: Linearised,
    u: Float[Array, "q"],
    known: Bool[np.ndarray, "n"],
    observations: int,
    report: Callable[[Array, Array], Reported],
) -> Uncertainty:
    """From the information matrix at the minimum to the errors of `report(k, u)`.

    The covariance of k and u is sigma^2 I^-1 (Cramer and Rao), I the Gram matrix of all derivatives;
    a function of them moves by its Jacobian. `known` marks, of k and then of u, what is held or
    depends on others. Directions without information are left out of I^-1, and make infinite what
    depends on them.
    """
    c, p = at.k.shape
    q = u.size
    information = _information(np.asarray(at.information, np.float64), c, p, q)
    # `report` of a flat vector of all unknowns, and its Jacobian, one row a reported number
    flat = np.concatenate([np.asarray(at.k).ravel(), np.asarray(u)])

    def reported(unknowns: Array) -> Reported:
        return report(unknowns[: c * p].reshape(c, p), unknowns[c * p :])

    rows = {
        name: np.asarray(row, np.float64).reshape(-1, flat.size)
        for name, row in jax.jacfwd(reported)(jax.numpy.asarray(flat, at.k.dtype)).items()
    }
    shapes = {name: np.shape(value) for name, value in report(at.k, u).items()}

    free = ~known
    scale = np.sqrt(np.diagonal(information))
    scale = np.where(scale > 0, scale, 1.0)
    scaled = (information / np.outer(scale, scale))[np.ix_(free, free)]
    values, vectors = np.linalg.eigh(scaled)
    threshold = 8 * flat.size * float(np.finfo(at.k.dtype).eps)
    null = values <= threshold
    root = vectors[:, ~null] / np.sqrt(values[~null])

    sigma = float(np.sqrt(max(float(at.cost), 0.0) / max(observations - int(free.sum()), 1)))
    unit: dict[str, np.ndarray] = {}
    moved: list[list[str]] = [[] for _ in range(int(null.sum()))]
    for name, row in rows.items():
        direction = (row / scale)[:, free]
        error = np.linalg.norm(direction @ root, axis=1)
        size = np.linalg.norm(direction, axis=1, keepdims=True)
        along = np.abs(direction @ vectors[:, null]) > 0.03 * np.maximum(size, 1e-300)
        unit[name] = np.where(along.any(axis=1), np.inf, error).reshape(shapes[name])
        for k in np.flatnonzero(along.any(axis=0)):
            moved[k].append(name)
    blind = tuple(dict.fromkeys(tuple(names) for names in moved if names))
    errors = {
        name: np.where(np.isinf(error), np.inf, sigma * np.where(np.isinf(error), 0, error))
        for name, error in unit.items()
    }
    return Uncertainty(errors, unit, blind, sigma)


def _information(grams: np.ndarray, c: int, p: int, q: int) -> np.ndarray:
    """One matrix over all unknowns: the channels' blocks, and the u that they share."""
    n = c * p + q
    information = np.zeros((n, n))
    shared = slice(c * p, n)
    for channel, gram in enumerate(grams):
        own = slice(channel * p, (channel + 1) * p)
        information[own, own] = gram[:p, :p]
        information[own, shared] = gram[:p, p : p + q]
        information[shared, own] = gram[p : p + q, :p]
        information[shared, shared] += gram[p : p + q, p : p + q]
    return information
