"""What an observation counts: an outlier nothing, a clipped one as "at least", a noisy one less.

Weights depend on residuals, and so on the solution; a `Judge` holds the one that they are taken at. The
search refines under a judge's weights, then judges anew from where it arrived, until both stand still.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Bool, Float

from diffshade.errors import BadInput
from fitting.arrays import Array

__all__ = ["CAUCHY", "MAD", "Judge", "SensorNoise", "Tukey", "Weighting", "is_robust"]

Planes = Float[Array, "C P"]

MAD = 1.4826
"""The standard deviation of normal noise over its median absolute deviation."""
CAUCHY = 2.385
"""Standard deviations at which Cauchy's weight is a half: 95 % efficient for normal errors."""


class Tukey(eqx.Module):
    """The biweight (1 - (z/c)^2)^2 of a residual of z standard deviations, 0 beyond c (Tukey 1960).

    Shadows, highlights of other things and dust lose all their weight; `c` = 4.685 keeps 95 % of
    the efficiency of least squares under normal noise. The first rounds use Cauchy's weight
    1/(1 + (z/2.385)^2), which never loses sight of a pixel. A pixel is judged by the root mean
    square of its channels.

    >>> Tukey().c
    4.685
    """

    c: float = 4.685

    def __call__(self, z: Float[Array, "P"], starting: Bool[Array, ""]) -> Float[Array, "P"]:
        """The weight of residuals in standard deviations."""
        inside = jnp.where(jnp.abs(z) < self.c, 1 - (z / self.c) ** 2, 0)
        return jnp.where(starting, 1 / (1 + (z / CAUCHY) ** 2), inside**2)


class SensorNoise(eqx.Module):
    """A camera's noise: the variance read^2 + step^2/12 + gain I at the radiance I.

    `read` is the standard deviation in the dark, `step` the distance of two levels (quantisation),
    `gain` the variance per unit of radiance (photons); all in the images' units. Only their ratios
    matter to the coefficients: what is left over sets the noise level.

    >>> SensorNoise(read=0.002, gain=1e-4, step=1 / 255).gain
    0.0001
    """

    read: float = 0.0
    gain: float = 0.0
    step: float = 0.0

    def __check_init__(self) -> None:
        numbers = (self.read, self.gain, self.step)
        if min(numbers) < 0 or self.read**2 + self.step**2 <= 0:
            raise BadInput(
                f"SensorNoise{numbers}: read, gain and step are not negative, and read or step above 0"
            )

    def variance(self, radiance: Planes) -> Planes:
        """Of one observation of a radiance, over that of one of darkness."""
        dark = self.read**2 + self.step**2 / 12
        return 1 + jnp.maximum(radiance, 0) * (self.gain / dark)


class Weighting(eqx.Module):
    """What a fit was asked to do about noise."""

    robust: Tukey | None = None
    noise: SensorNoise | None = None

    def weights(
        self,
        predicted: Planes,
        observed: Planes,
        scale: Float[Array, ""],
        starting: Bool[Array, ""],
    ) -> Planes:
        """The weight of each observation beside what a judge predicts."""
        variance = (
            jnp.ones_like(predicted) if self.noise is None else self.noise.variance(predicted)
        )
        weights = 1 / variance
        if self.robust is not None:
            square = jnp.mean((observed - predicted) ** 2 / variance, axis=0)
            # Where there is no noise nothing stands out.
            beside = jnp.sqrt(square) / jnp.where(scale > 0, scale, jnp.inf)
            weights = weights * self.robust(beside, starting)[None]
        return weights

    def standardised(self, predicted: Planes, observed: Planes) -> Planes:
        """Residuals in units that have one standard deviation at every radiance."""
        residual = observed - predicted
        return (
            residual if self.noise is None else residual / jnp.sqrt(self.noise.variance(predicted))
        )


def is_robust(weighting: Weighting | None) -> bool:
    """Whether outliers lose their weight."""
    return weighting is not None and weighting.robust is not None


class Judge(eqx.Module):
    """The solution that weights are taken at, its noise level, and how often one was judged.

    Before the first time, `round` 0, all weights are those of the noise alone, and clipped
    observations are left out.
    """

    weighting: Weighting
    u: Float[Array, "q"]
    k: Float[Array, "C p"]
    scale: Float[Array, ""]
    round: Float[Array, ""]

    def weights(
        self, predicted: Planes, observed: Planes, clipped: Bool[Array, "C P"] | None
    ) -> Planes:
        """Of each observation; a clipped one counts where the prediction lies below it."""
        scale = jnp.where(self.round > 0, self.scale, jnp.inf)
        weights = self.weighting.weights(predicted, observed, scale, self.round < 4)
        if clipped is None:
            return weights
        counts = (predicted < observed) & (self.round > 0)
        return jnp.where(clipped & ~counts, 0, weights)


def robust_scale(residuals: Float[Array, "..."], used: Bool[Array, "..."]) -> Float[Array, ""]:
    """The standard deviation of normal noise, from the median absolute deviation.

    Residuals that are exactly 0 are of dark points, which say nothing of it; 0 where all are.
    """
    used = used & (residuals != 0)
    median = jnp.nanmedian(jnp.where(used, jnp.abs(residuals), jnp.nan))
    return jnp.where(used.any(), MAD * median, 0)
