"""Metamers: different spectra of one colour.

The eye makes three numbers of a spectrum, so most of what spectra can be it does not see. Under a light,
a reflectance r is the sum of the part that fixes its colour and of a metameric black, whose X, Y and Z
are 0 (Cohen and Kappauf 1982). With A [N, 3] = light x matching functions x steps, whose transpose makes
X, Y, Z of r, the visible part is A (A^T A)^-1 A^T r. Under another light the black is not black.
"""

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool

from diffshade.colour.observer import standard_observer
from diffshade.colour.spectrum import Spectrum, Wavelengths, sensor_response, trapezoid
from diffshade.errors import BadInput

__all__ = ["are_metamers", "metamer", "metameric_black"]


def metameric_black(
    reflectance: Spectrum, light: Wavelengths, wavelengths: Wavelengths
) -> Spectrum:
    """The part of a reflectance that is not seen under a light [N]: linear in it, of either sign.

    Raises `BadInput` for a light, or for wavelengths, that leave fewer than three things to see.

    >>> wavelengths = np.arange(400.0, 701.0, 10.0)
    >>> black = metameric_black(jnp.linspace(0, 1, 31), np.ones(31), wavelengths)
    >>> xyz = sensor_response(black, standard_observer(wavelengths), wavelengths)
    >>> bool(abs(xyz).max() < 1e-4 < 0.1 < abs(black).max())
    True
    """
    seen = (light * trapezoid(wavelengths))[:, None] * standard_observer(wavelengths)
    basis, sizes, _ = np.linalg.svd(seen, full_matrices=False)
    if not sizes[-1] > 1e-9 * sizes[0]:
        raise BadInput(
            "under this light fewer than three numbers are seen: give it more wavelengths"
        )
    own = jnp.asarray(basis, reflectance.dtype)
    coordinates = jnp.einsum("nk,...n->...k", own, reflectance, precision=lax.Precision.HIGHEST)
    return reflectance - jnp.einsum(
        "nk,...k->...n", own, coordinates, precision=lax.Precision.HIGHEST
    )


def metamer(
    reflectance: Spectrum, other: Spectrum, light: Wavelengths, wavelengths: Wavelengths
) -> Spectrum:
    """Of all that have the colour of `reflectance` under a light, the one that comes nearest to `other`.

    The visible part of the one with the black of the other. Linear in both. It may leave [0, 1], where
    no surface is.

    >>> wavelengths = np.arange(400.0, 701.0, 10.0)
    >>> grey, red = jnp.full(31, 0.5), jnp.linspace(0.2, 0.8, 31)
    >>> bool(are_metamers(grey, metamer(grey, red, np.ones(31), wavelengths), wavelengths))
    True
    """
    return reflectance + metameric_black(other - reflectance, light, wavelengths)


def are_metamers(
    first: Spectrum,
    second: Spectrum,
    wavelengths: Wavelengths,
    *,
    light: Wavelengths | None = None,
    tolerance: float = 1e-3,
) -> Bool[Array, "..."]:
    """Whether two spectra differ, and look alike: as reflectances under a light, or by themselves.

    X, Y and Z are alike up to `tolerance` of the larger Y of both, the spectra differ by more than that
    of the larger maximum of both: a spectrum is no metamer of itself.

    >>> wavelengths = np.arange(400.0, 701.0, 10.0)
    >>> bool(are_metamers(jnp.ones(31), 0.5 * jnp.ones(31), wavelengths))
    False
    """
    shining = np.ones(len(wavelengths)) if light is None else light
    matching = shining[:, None] * standard_observer(wavelengths)
    a, b = (sensor_response(spectrum, matching, wavelengths) for spectrum in (first, second))
    brighter = jnp.maximum(a[..., 1], b[..., 1])
    larger = jnp.maximum(abs(first).max(axis=-1), abs(second).max(axis=-1))
    alike = abs(a - b).max(axis=-1) <= tolerance * brighter
    return alike & (abs(first - second).max(axis=-1) > tolerance * larger)
