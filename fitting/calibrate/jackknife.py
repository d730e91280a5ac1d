"""Error bars from how images disagree, for least squares whose residual is no noise.

Where the model is not the whole truth neighbouring pixels err together, and sigma^2 (J'J)^-1 is far too
sure. The jackknife (Tukey 1958) leaves out one image at a time: with g = J'r and H = J'J of each image,
the estimate without image k is, by one step of Gauss and Newton,

    y_k = y - (H - H_k)^-1 (g - g_k),        cov = (K - 1)/K sum over k of (y_k - mean)(y_k - mean)'
"""

import numpy as np
from jaxtyping import Float
from scipy.stats import t as student

__all__ = ["FEWEST", "covariance", "half_width"]

FEWEST = 4
"""Images that can be compared."""


def covariance(
    hessians: Float[np.ndarray, "K m m"],
    gradients: Float[np.ndarray, "K m"],
    noise: float,
) -> Float[np.ndarray, "m m"]:
    """Of the estimate, whose gradients sum to about 0.

    By the jackknife, and in no direction less than `noise`^2 H^-1, that of independent errors of this
    standard deviation; with fewer than four images by the latter alone.

    >>> covariance(np.full((4, 1, 1), 2.0), np.zeros((4, 1)), 1.0).round(6).tolist()
    [[0.125]]
    """
    total = hessians.sum(axis=0)
    plain: np.ndarray = noise**2 * np.linalg.pinv(total, hermitian=True)
    count = len(hessians)
    if count < FEWEST:
        return plain
    left = gradients.sum(axis=0) - gradients
    without = -np.stack(
        [np.linalg.pinv(total - h, hermitian=True) @ g for h, g in zip(hessians, left, strict=True)]
    )
    apart = without - without.mean(axis=0)
    between: np.ndarray = (count - 1) / count * apart.T @ apart
    # In the axes in which the plain covariance is 1 the larger of both, whatever the direction
    values, axes = np.linalg.eigh(plain)
    root = axes * np.sqrt(values.clip(0, None))
    inverse = np.linalg.pinv(root)
    ratio, turned = np.linalg.eigh(inverse @ between @ inverse.T)
    half = root @ turned
    return np.asarray((half * ratio.clip(1, None)) @ half.T)


def half_width(standard_error: float, images: int) -> float:
    """Of the 95 % interval; Student's, as the spread itself is known from few images."""
    degrees = images - 1 if images >= FEWEST else np.inf
    return float(student.ppf(0.975, degrees) * standard_error)
