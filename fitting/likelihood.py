"""How likely a fit makes its images, and what its freedom costs it: the measure by which models compare.

With normal noise of unknown variance, estimated as |r|^2 / n from n observations,

    log L = -n/2 (log(2 pi |r|^2 / n) + 1),   BIC = m log n - 2 log L

(Schwarz 1978, "Estimating the dimension of a model"), m the number of free parameters, the variance
among them. The model of the lowest BIC is the most probable one, for much data and vague priors.
"""

from dataclasses import dataclass
from math import log, pi

import jax.numpy as jnp

__all__ = ["Likelihood", "rounding"]


@dataclass(frozen=True)
class Likelihood:
    """The logarithm of the likelihood, the free parameters (the noise is one), the observations.

    >>> round(Likelihood(-100.0, 3, 1000).bic, 1)
    220.7
    """

    log_likelihood: float
    parameters: int
    observations: int

    @property
    def bic(self) -> float:
        """m log n - 2 log L: less is better."""
        return self.parameters * log(self.observations) - 2 * self.log_likelihood

    @classmethod
    def of(cls, cost: float, least: float, parameters: int, observations: int) -> "Likelihood":
        """From |r|^2; below `least` it is rounding, and tells nothing."""
        n = max(observations, 1)
        variance = max(cost, least) / n
        return cls(-n / 2 * (log(2 * pi * variance) + 1), parameters, n)


def rounding(square: float, dtype: jnp.dtype) -> float:
    """The |r|^2 that rounding may leave of images with |I|^2 = `square`, once a search has arrived."""
    eps = float(jnp.finfo(dtype).eps)
    relative = eps**0.5 if dtype == jnp.float64 else 100 * eps
    return max(relative**2 * square, float(jnp.finfo(dtype).tiny))
