"""Spectra: what a light sends out, what a surface leaves of it, and what a sensor makes of the rest.

A spectrum is an array [..., N] of one number at each of N wavelengths in nm, which rise, evenly or not.
The light that comes back from a surface is emission times reflectance, wavelength by wavelength: an image
of N channels is such a spectrum in every pixel, and `diffshade.render` makes it of lights, coefficients
and object colours of N numbers each. A sensor then makes a few numbers of it, the eye three.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from diffshade.errors import BadInput

__all__ = ["blackbody", "sensor_response", "trapezoid"]

Wavelengths = Float[np.ndarray, "N"]
Spectrum = Float[Array, "... N"]

SPEED_OF_LIGHT = 299792458.0
"""c in m/s; with h and k exact in the SI of 2019."""
PLANCK = 6.62607015e-34
"""h in J s."""
BOLTZMANN = 1.380649e-23
"""k in J/K."""


def trapezoid(wavelengths: Wavelengths) -> Wavelengths:
    """Weights w in nm with the integral of P dλ = sum of w_i P_i, P linear between the wavelengths.

    Raises `BadInput` for fewer than two wavelengths, and for those that do not rise.

    >>> trapezoid(np.array([400.0, 500.0, 700.0])).tolist()
    [50.0, 150.0, 100.0]
    """
    steps = np.diff(wavelengths)
    if not steps.size or not np.all(steps > 0):
        raise BadInput("wavelengths do not rise, or are fewer than two: give them in nm, rising")
    return (np.append(steps, 0) + np.append(0, steps)) / 2


def sensor_response(
    spectrum: Spectrum, sensitivity: Float[Any, "N S"], wavelengths: Wavelengths
) -> Float[Array, "... S"]:
    """The integral of P(λ) s(λ) dλ for every sensitivity s [N, S]: linear in both, so are derivatives.

    The unit is that of P times nm. What of P and s lies between the wavelengths is not seen: they stand
    closer than either has features. Raises `BadInput` as `trapezoid` does.

    >>> wavelengths = np.array([400.0, 500.0, 600.0])
    >>> sensor_response(jnp.ones(3), jnp.eye(3), wavelengths).tolist()
    [50.0, 100.0, 50.0]
    """
    steps = jnp.asarray(trapezoid(wavelengths), spectrum.dtype)
    weights = steps[:, None] * jnp.asarray(sensitivity, spectrum.dtype)
    return jnp.einsum("...n,ns->...s", spectrum, weights, precision=lax.Precision.HIGHEST)


def blackbody(temperature: Float[Array, "..."], wavelengths: Wavelengths) -> Spectrum:
    """Planck's law: radiance 2 h c^2 / λ^5 / (exp(h c / (λ k T)) - 1), in W / (m^2 sr nm).

    `temperature` T in kelvin, from 1 to 1e6. Illuminant A is that of 2856 K, but for its scale.

    >>> bool(blackbody(jnp.array(5800.0), np.array([500.0]))[0] > 20_000)
    True
    """
    # In nm where the numbers are of everyday size: float32 does not hold h.
    first = 2e36 * PLANCK * SPEED_OF_LIGHT**2 / wavelengths**5
    second = 1e9 * PLANCK * SPEED_OF_LIGHT / BOLTZMANN / wavelengths
    first, second = (x.reshape((1,) * temperature.ndim + x.shape) for x in (first, second))
    exponent = jnp.asarray(second, temperature.dtype) / temperature[..., None]
    # exp(-x) / (1 - exp(-x)) goes to 0 in the cold, where exp(x) would overflow
    return jnp.asarray(first, temperature.dtype) * jnp.exp(-exponent) / -jnp.expm1(-exponent)
