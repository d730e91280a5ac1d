"""The eye: the CIE's standard observer of 1931, its illuminants, and X, Y, Z of spectra.

Tables are those of colour-science, which the extra `colour` installs; all that reads them raises
`BadInput` where it is absent. They are given at the wavelengths of a spectrum, in nm, linear between
those of the CIE, as it recommends.
"""

import warnings
from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.colour.spectrum import Spectrum, Wavelengths, sensor_response
from diffshade.errors import BadInput

__all__ = [
    "LUMENS",
    "illuminant",
    "luminance",
    "spectral_locus",
    "spectrum_to_xyz",
    "standard_observer",
]

LUMENS = 683.0
"""Lumens of a watt at 555 nm, where the eye is most sensitive: K_m, by the definition of the candela."""

OBSERVER = "CIE 1931 2 Degree Standard Observer"


@cache
def tables() -> Any:
    """The package `colour`, an object of its own kind. Raises `BadInput` where it is not installed."""
    try:
        # It warns where Matplotlib is absent, and would filter warnings and print arrays its own way
        # in the whole process.
        with warnings.catch_warnings(), np.printoptions():
            warnings.simplefilter("ignore")
            import colour
    except ImportError:
        raise BadInput(
            "tables of the CIE need the package colour-science; pip install 'diffshade[colour]'"
        ) from None
    return colour


@cache
def _observer() -> tuple[Wavelengths, Float[np.ndarray, "M 3"]]:
    """The table of 1 nm, from 360 to 830."""
    functions = tables().MSDS_CMFS[OBSERVER]
    return np.asarray(functions.wavelengths), np.asarray(functions.values)


def standard_observer(wavelengths: Wavelengths) -> Float[np.ndarray, "N 3"]:
    """The colour matching functions of 2 degrees at these wavelengths: 0 outside 360 to 830 nm.

    The second is the luminous efficiency V of the eye, 1 at 555 nm.

    >>> standard_observer(np.array([555.0])).round(4).tolist()
    [[0.5121, 1.0, 0.0057]]
    """
    known, values = _observer()
    each = [np.interp(wavelengths, known, column, left=0, right=0) for column in values.T]
    return np.stack(each, axis=-1)


def illuminant(name: str, wavelengths: Wavelengths) -> Wavelengths:
    """The relative power of an illuminant of the CIE at these wavelengths, 100 at 560 nm for most.

    A is a lamp of 2856 K, D65 daylight, E equal at all wavelengths, FL1 to FL12 fluorescent lamps; those
    have lines, which want 5 nm. Raises `BadInput` for other names, and outside the table of one.

    >>> illuminant("A", np.array([560.0, 700.0])).round(1).tolist()
    [100.0, 198.3]
    """
    known = tables().SDS_ILLUMINANTS
    if name not in known:
        raise BadInput(f"the illuminant is {name!r}: give one of {', '.join(sorted(known))}")
    table = known[name]
    first, last = table.wavelengths[0], table.wavelengths[-1]
    if np.min(wavelengths) < first or np.max(wavelengths) > last:
        raise BadInput(
            f"wavelengths reach outside {first:g} to {last:g} nm, the table of illuminant {name}"
        )
    return np.interp(wavelengths, table.wavelengths, table.values)


def spectral_locus() -> tuple[Wavelengths, Float[np.ndarray, "M 2"]]:
    """Wavelengths from 380 to 699 nm in steps of 1, and the chromaticities of their pure light.

    Beyond either end chromaticities stand still.

    >>> wavelengths, xy = spectral_locus()
    >>> wavelengths[[0, -1]].tolist(), xy[[0, -1]].round(4).tolist()
    ([380.0, 699.0], [[0.1741, 0.005], [0.7347, 0.2653]])
    """
    known, values = _observer()
    seen = (known >= 380) & (known <= 699)
    xyz = values[seen]
    return known[seen], xyz[:, :2] / xyz.sum(axis=1, keepdims=True)


def spectrum_to_xyz(
    spectrum: Spectrum,
    wavelengths: Wavelengths,
    *,
    white: Float[Any, "N"] | None = None,
) -> Float[Array, "... 3"]:
    """X, Y, Z = k times the integral of P(λ) (x, y, z)(λ) dλ: k is 1 / the Y of `white`, or 683 lm/W.

    With the spectrum of a white, as the light on a perfect reflector, its own Y is 1 (the texts' 100),
    and all is 0 where it is dark; without, the spectrum shines by itself and Y is `luminance`. Linear in
    the spectrum. `cie.xyz_to_rgb` goes on to a screen.

    >>> wavelengths = np.arange(380.0, 781.0, 5.0)
    >>> xyz = spectrum_to_xyz(jnp.full(81, 0.5), wavelengths, white=jnp.ones(81))
    >>> xyz.round(2).tolist()
    [0.5, 0.5, 0.5]
    """
    matching = standard_observer(wavelengths)
    xyz = sensor_response(spectrum, matching, wavelengths)
    if white is None:
        return LUMENS * xyz
    shining = jnp.asarray(white, spectrum.dtype)
    return guard.ratio(xyz, sensor_response(shining, matching, wavelengths)[1])


def luminance(spectrum: Spectrum, wavelengths: Wavelengths) -> Float[Array, "..."]:
    """683 lm/W times the integral of P(λ) V(λ) dλ: cd/m^2 of a radiance in W / (m^2 sr nm).

    Of an irradiance lux, of a power lumens.

    >>> luminance(jnp.ones(81), np.arange(380.0, 781.0, 5.0)).round(-2).tolist()
    73000.0
    """
    return spectrum_to_xyz(spectrum, wavelengths)[..., 1]
