"""What a screen shows of a value, and the values for intensities that look equally far apart.

The eye sees ratios: I and 1.01 I differ as much as 2 I and 2.02 I do. A screen's lowest intensity I_0 is
never 0, and 1/I_0 is its dynamic range. A tube shows I = K V^gamma of the value V.
"""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from diffshade import guard
from diffshade.errors import BadInput

__all__ = ["displayed", "intensity_levels", "levels_needed", "look_up_table", "value_for"]

Values = Float[Array, "..."]


def intensity_levels(lowest: float, steps: int) -> Float[np.ndarray, "..."]:
    """I_j = r^j I_0 with r = (1/I_0)^(1/n), j = 0 to n: each as far from the last, to the eye.

    `lowest` is I_0 in (0, 1), `steps` n >= 1; the last level is 1. Raises `BadInput` for others: zero is
    never shown.

    >>> intensity_levels(1 / 8, 3).round(4).tolist()
    [0.125, 0.25, 0.5, 1.0]
    """
    _check_lowest(lowest)
    if steps < 1:
        raise BadInput(f"the number of steps is {steps}: give 1 or more")
    return lowest ** (1 - np.arange(steps + 1) / steps)


def levels_needed(lowest: float, ratio: float = 1.01) -> int:
    """How many levels there are from I_0 to 1 where none is more than `ratio` > 1 times the last.

    The eye takes those as continuous that differ by 1 %.

    >>> levels_needed(1 / 50), levels_needed(1 / 1000)
    (395, 696)
    """
    _check_lowest(lowest)
    if not ratio > 1:
        raise BadInput(f"the ratio of levels is {ratio:g}: it must be above 1")
    return math.ceil(-math.log(lowest) / math.log(ratio)) + 1


def value_for(intensity: Values, gamma: float, scale: float = 1.0) -> Values:
    """V = (I/K)^(1/gamma), 0 for I <= 0: the value whose display has the intensity I; K is `scale`.

    What is below 3e-8 K in float32 counts as 0, with derivative 0 (`guard.power`).

    >>> value_for(jnp.array([0.0, 0.25, 1.0]), 2.0).round(4).tolist()
    [0.0, 0.5, 1.0]
    """
    _check_gamma(gamma, scale)
    return guard.power(intensity / scale, jnp.asarray(1 / gamma, intensity.dtype))


def displayed(value: Values, gamma: float, scale: float = 1.0) -> Values:
    """I = K V^gamma, 0 for V <= 0: the intensity that is seen of a value.

    >>> displayed(jnp.array([0.0, 0.5, 1.0]), 2.0).round(4).tolist()
    [0.0, 0.25, 1.0]
    """
    _check_gamma(gamma, scale)
    return scale * guard.power(value, jnp.asarray(gamma, value.dtype))


def look_up_table(
    intensities: Float[np.ndarray, "n"], gamma: float, *, scale: float = 1.0, bits: int = 8
) -> Int[np.ndarray, "n"]:
    """The pixel values 0 to 2^bits - 1 that come nearest to (I/K)^(1/gamma) for each intensity.

    A screen of so many bits then shows K (v / (2^bits - 1))^gamma. Raises `BadInput` for intensities
    that no value shows.

    >>> look_up_table(intensity_levels(1 / 8, 3), 2.0).tolist()
    [90, 127, 180, 255]
    """
    _check_gamma(gamma, scale)
    shares = np.asarray(intensities, np.float64) / scale
    if not np.all((shares >= 0) & (shares <= 1)):
        raise BadInput(f"intensities reach beyond 0 to {scale:g}, which no value shows: scale them")
    return np.rint(shares ** (1 / gamma) * (2**bits - 1)).astype(int)


def _check_lowest(lowest: float) -> None:
    if not 0 < lowest < 1:
        raise BadInput(f"the lowest intensity is {lowest:g}: it must be above 0 and below 1")


def _check_gamma(gamma: float, scale: float) -> None:
    for name, number in (("gamma", gamma), ("scale", scale)):
        if not 0 < number < math.inf:
            raise BadInput(f"{name} is {number:g}: it must be above 0")
