"""Error bars from how images disagree, for least squares whose residual is no noise.

Where the model is not the whole truth neighbouring pixels err together, and sigma^2 (J'J)^-1 is far too
sure. The jackknife (Tukey 1958) leaves out one image at a time: with g = J'r and H = J'J of each image,
the estimate without image k is, by one step of Gauss and Newton,

    y_k = y - (H - H_k)^-1 (g - g_k),        cov = (K - 1)/K sum over k of (y_k - mean)(y_k - mean)'

Groups of any kind that share out the observations are compared likewise. Where observations err together
in two ways the variances of both groupings add (two-way clusters: Cameron, Gelbach and Miller 2011); the
third term, that of both at once, would be taken off: left out here, which is at most too cautious.
"""

import numpy as np
from jaxtyping import Float
from scipy.stats import t as student

from fitting.null_space import spectrum

__all__ = ["FEWEST", "covariance", "half_width"]

FEWEST = 4
"""Images that can be compared."""
ALONE = 1e-4
"""Share of what is known of a direction: where no more is left without a group, that tells it alone."""


def covariance(
    *groupings: tuple[Float[np.ndarray, "_ m m"], Float[np.ndarray, "_ m"]],
    noise: float,
    eps: float,
) -> Float[np.ndarray, "m m"]:
    """Of the estimate, whose gradients sum to about 0, by the H and the g of each group.

    By the jackknife, and in no direction less than `noise`^2 H^-1, that of independent errors of this
    standard deviation; by the latter alone where no grouping has four groups. Infinite on the
    diagonal where the observations do not tell a number, to the rounding `eps` of H.

    >>> covariance((np.full((4, 1, 1), 2.0), np.zeros((4, 1))), noise=1.0, eps=2e-16).round(6).tolist()
    [[0.125]]
    """
    total = groupings[0][0].sum(axis=0)
    told = spectrum(total, np.ones(len(total), bool), eps)
    # In coordinates in which H is 1, and noise^2 H^-1 is noise^2 whatever the direction
    between = np.zeros((told.root.shape[1],) * 2)
    for hessians, gradients in groupings:
        if len(hessians) >= FEWEST:
            between += _between(told.root.T @ hessians @ told.root, gradients @ told.root)
    values, axes = np.linalg.eigh(between)
    half = told.root @ axes
    found = np.asarray((half * values.clip(noise**2, None)) @ half.T)
    blind = np.abs(told.null).max(axis=1, initial=0) > told.tolerance
    found[blind, blind] = np.inf
    return found


def _between(
    hessians: Float[np.ndarray, "b r r"], gradients: Float[np.ndarray, "b r"]
) -> Float[np.ndarray, "r r"]:
    """The jackknife's covariance, where the sum of all H is 1.

    Nothing in a direction that one group alone tells: without it there is no estimate to compare.
    """
    left = gradients.sum(axis=0) - gradients
    rest = hessians.sum(axis=0) - hessians
    inverse = np.linalg.pinv(rest, rcond=ALONE, hermitian=True)
    without = -np.einsum("bij,bj->bi", inverse, left)
    apart = without - without.mean(axis=0)
    count = len(hessians)
    return np.asarray((count - 1) / count * apart.T @ apart)


def half_width(standard_error: float, images: int) -> float:
    """Of the 95 % interval; Student's, as the spread itself is known from few images."""
    degrees = images - 1 if images >= FEWEST else np.inf
    return float(student.ppf(0.975, degrees) * standard_error)
