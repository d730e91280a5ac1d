"""Where a lit ball and its lamps fit best, and how well that is known; formulae in `near_lights`."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from fitting.calibrate.lit_ball import OF_LAMP, LitBall, Pulls, pulls
from fitting.intervals import quantile
from fitting.null_space import spectrum

__all__ = ["Minimum", "descended"]

CODE = 0.2
"""The standard deviation of a code of 8 bits, from what it should be at a level."""
MAX_STEPS = 64
ARRIVED = 1e-3
"""Of the noise's variance: what the sum of squares has left to fall."""


class Minimum(NamedTuple):
    """theta, its covariance, and what says how far to trust them."""

    theta: Float[np.ndarray, "n"]
    covariance: Float[np.ndarray, "n n"]
    reach: float
    square: float
    converged: bool


def descended(
    seen: LitBall,
    theta: Float[np.ndarray, "n"],
    box: tuple[Float[np.ndarray, "n"], ...],
    sigma: Float[np.ndarray, "n"],
) -> Minimum:
    """Levenberg's and Marquardt's method in a box; what rests on a bound stays there."""
    lower, upper = box
    dtype = seen.distances.dtype
    eps, variable = float(jnp.finfo(dtype).eps), lower < upper

    def at(theta: Float[np.ndarray, "n"]) -> _Pulled:
        return _assembled(seen, pulls(seen, jnp.asarray(theta, dtype)))

    here, damping, converged = at(theta), 1e-3, False
    for _ in range(MAX_STEPS):
        noise = _noise(here, variable, eps)
        prior = noise / sigma**2
        pull = here.pull + prior * theta
        free = variable & ~((theta <= lower) & (pull > 0) | (theta >= upper) & (pull < 0))
        hessian = (here.gram + np.diag(prior))[np.ix_(free, free)]
        scale = np.sqrt(np.maximum(np.diagonal(hessian), np.finfo(float).tiny))
        scaled = hessian / np.outer(scale, scale) + damping * np.eye(len(scale))
        step = np.zeros_like(theta)
        step[free] = -np.linalg.solve(scaled, pull[free] / scale) / scale
        there = np.clip(theta + step, lower, upper)
        found = at(there)
        converged = bool(pull @ (theta - there) < ARRIVED * noise)
        if here.square + prior @ theta**2 >= found.square + prior @ there**2:
            theta, here, damping = there, found, max(damping / 10, 1e-9)
        else:
            damping *= 10
        if converged:
            break
    noise = _noise(here, variable, eps)
    known = np.diag(noise / sigma**2)
    told = spectrum(here.gram + known, variable, eps)
    inverse = told.root @ told.root.T
    used = np.count_nonzero(here.blocks.any(axis=1))
    degrees = float(max(used - told.root.shape[1], 1))
    covariance = inverse @ (here.spread + noise * known) @ inverse
    blind = np.abs(told.null).max(axis=1, initial=0) > told.tolerance
    covariance[blind, blind] = np.inf
    return Minimum(theta, covariance, quantile(degrees), here.square, converged)


class _Pulled(NamedTuple):
    """`Pulls` over all unknowns."""

    gram: Float[np.ndarray, "n n"]
    blocks: Float[np.ndarray, "B n"]
    square: float
    codes: Float[np.ndarray, "s n"]

    @property
    def pull(self) -> Float[np.ndarray, "n"]:
        """J'r."""
        return np.asarray(self.blocks.sum(axis=0))

    @property
    def spread(self) -> Float[np.ndarray, "n n"]:
        """M, the covariance of J'r."""
        return self.blocks.T @ self.blocks + CODE**2 * self.codes.T @ self.codes


def _noise(at: _Pulled, variable: Bool[np.ndarray, "n"], eps: float) -> float:
    """s^2, of as many directions as the images tell."""
    root = spectrum(at.gram, variable, eps).root
    return float(np.sum((at.spread @ root) * root) / max(root.shape[1], 1))


def _assembled(seen: LitBall, each: Pulls) -> _Pulled:
    """The images' own, each lamp in its place."""
    images, count = len(each.square), seen.shared
    total = count + OF_LAMP * images
    own = [np.r_[:count, count + OF_LAMP * k : count + OF_LAMP * (k + 1)] for k in range(images)]

    def spread(rows: Float[Array, "K r n"]) -> Float[np.ndarray, "K r m"]:
        out = np.zeros((*rows.shape[:2], total))
        for k, row in enumerate(np.asarray(rows, float)):
            out[k][:, own[k]] = row
        return out

    gram = np.zeros((total, total))
    for at, matrix in zip(own, np.asarray(each.gram, float), strict=True):
        gram[np.ix_(at, at)] += matrix
    codes = np.zeros((0, total)) if each.codes is None else spread(each.codes).sum(axis=0)
    return _Pulled(gram, spread(each.blocks).reshape(-1, total), float(each.square.sum()), codes)
