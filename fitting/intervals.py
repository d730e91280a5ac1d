"""95 % intervals of a normal estimate, also next to a bound, where plus and minus two errors is wrong.

A coefficient that may not be negative, and whose estimate without that bound lies x errors above it
(below it where x < 0), is given the interval of Feldman and Cousins (1998, Phys. Rev. D 57, 3873): all
values that take x among the likeliest 95 % of what they would give, likeliest in ratio to the best
value allowed. It is one-sided near the bound and two-sided far from it, has no jump between the two,
is never empty, and covers the truth in 95 % of cases wherever that lies.
"""

from functools import cache
from math import erf, sqrt
from statistics import NormalDist

import numpy as np
from jaxtyping import Float

__all__ = ["LEVEL", "bounded_interval", "quantile"]

LEVEL = 0.95
"""Of all intervals."""
NORMAL = NormalDist().inv_cdf((1 + LEVEL) / 2)
ONE_SIDED = NormalDist().inv_cdf(LEVEL)


def quantile(degrees: float) -> float:
    """How many standard errors an interval reaches to each side, of Student's t at so many degrees.

    By the expansion in 1/degrees (Abramowitz and Stegun 26.7.5), right to 1e-3 from 7 degrees on.

    >>> round(quantile(10.0), 3), round(quantile(float("inf")), 3)
    (2.228, 1.96)
    """
    z, v = NORMAL, max(degrees, 1.0)
    terms = (
        (z**3 + z) / 4,
        (5 * z**5 + 16 * z**3 + 3 * z) / 96,
        (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384,
        (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / 92160,
    )
    return z + sum(term / v ** (k + 1) for k, term in enumerate(terms))


def bounded_interval(
    x: Float[np.ndarray, "m"],
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"]]:
    """Both ends, in standard errors above the bound, for estimates x standard errors above it.

    >>> low, high = bounded_interval(np.array([0.0, 1.0, 6.0]))
    >>> low.round(2), high.round(2)
    (array([0.  , 0.  , 4.04]), array([1.96, 2.96, 7.96]))
    """
    mean, accepted_from, accepted_to = _belt()
    low = np.where(x >= 2 * NORMAL, x - NORMAL, np.interp(x, accepted_to, mean))
    high = np.where(x >= 0, x + NORMAL, np.interp(x, accepted_from, mean))
    return np.where(x <= ONE_SIDED, 0, low), high


@cache
def _belt() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For means from 0 to the last that feels the bound: from which x to which they are accepted.

    At both ends the ratio of likelihoods is the same: exp(-(x - mean)^2 / 2) above 0 and
    exp(x mean - mean^2 / 2) below.
    """
    mean = np.append(np.geomspace(1e-3, 1.9, 300), np.linspace(1.9, NORMAL, 30)[1:])
    low, high = np.full_like(mean, ONE_SIDED) - 0.01, mean + NORMAL + 0.01
    for _ in range(40):
        to = (low + high) / 2
        start = (mean**2 - (to - mean) ** 2) / (2 * mean)
        enough = _normal(to - mean) - _normal(start - mean) > LEVEL
        low, high = np.where(enough, low, to), np.where(enough, to, high)
    return mean, (mean**2 - (high - mean) ** 2) / (2 * mean), high


def _normal(x: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m"]:
    return np.array([(1 + erf(value / sqrt(2))) / 2 for value in x])
