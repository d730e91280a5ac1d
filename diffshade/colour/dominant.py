"""Dominant wavelength, excitation purity and complementary wavelength of a chromaticity.

From the white a ray through the colour F meets the border of all colours in G. Where G is on the locus
of pure light its wavelength is the dominant one of F, which white and that light make; the purity is the
distance of F from white over that of G. Where G is on the line of purples, there is no such light: F has
a complementary wavelength only, where the ray the other way meets the locus, whose light makes white
with F. It is given with a minus sign (-550 is written 550c). CIE 15:2004, 9.1.

The border is the polygon of `observer.spectral_locus`, in steps of 1 nm. Under `jit`, `vmap` and `grad`;
the slopes jump at its corners. White, which has no wavelength, has 0, and purity 0, all with derivative
0; so has what differs from it by less than `guard.shortest`.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from diffshade import guard
from diffshade.colour.cie import D65, Chromaticity, Plane
from diffshade.colour.observer import spectral_locus
from diffshade.errors import BadInput

__all__ = ["complementary_wavelength", "dominant_wavelength", "excitation_purity"]

XY = Float[Array, "... 2"]


def dominant_wavelength(xy: XY, white: Chromaticity = D65) -> Plane:
    """In nm from 380 to 699; for purples the complementary one, with a minus sign; 0 for white.

    Raises `BadInput` for a white that is not inside the locus, or without the extra `colour`.

    >>> dominant_wavelength(jnp.array([[0.64, 0.33], [0.40, 0.20]])).round(0).tolist()
    [611.0, -511.0]
    """
    return _along(_from_white(xy, white), _border(white))


def complementary_wavelength(xy: XY, white: Chromaticity = D65) -> Plane:
    """Of the light that makes white with the colour: the dominant one, seen the other way from white.

    Greens, whose complements are purples, have their dominant one with a minus sign.

    >>> complementary_wavelength(jnp.array([[0.64, 0.33], [0.30, 0.60]])).round(0).tolist()
    [491.0, -549.0]
    """
    return _along(-_from_white(xy, white), _border(white))


def excitation_purity(xy: XY, white: Chromaticity = D65) -> Plane:
    """|F - W| / |G - W|: 0 for white, 1 on the border; for purples G is on their line.

    Linear from the white to the border. Raises `BadInput` as `dominant_wavelength` does.

    >>> percent = 100 * excitation_purity(jnp.array([[0.3127, 0.3290], [0.64, 0.33]]))
    >>> percent.round().tolist()
    [0.0, 92.0]
    """
    ray, corners = _from_white(xy, white), _border(white)
    side = _side(ray, corners)
    area = _cross(corners, np.roll(corners, -1, axis=0))
    crossed = (side.after - side.before) / jnp.asarray(area, ray.dtype)[side.start]
    return jnp.where(_is_white(ray), 0, crossed)


def _along(ray: XY, corners: Float[np.ndarray, "M 2"]) -> Plane:
    """The wavelength where a ray from white meets the locus: with a minus sign, the other way."""
    ahead, behind = _side(ray, corners), _side(-ray, corners)
    purple = ahead.start == len(corners) - 1
    found = jnp.where(purple, -_wavelength(behind), _wavelength(ahead))
    return jnp.where(_is_white(ray), 0, found)


class _Side(NamedTuple):
    """The side that a ray leaves by: its first corner, and the cross products of the ray with both."""

    start: Int[Array, "..."]
    before: Plane
    after: Plane


def _side(ray: XY, corners: Float[np.ndarray, "M 2"]) -> _Side:
    """Corners go round clockwise: where one is left of the ray, and the next is not."""
    first = jnp.asarray(np.stack([corners[:, 1], -corners[:, 0]], axis=1), ray.dtype)
    second = jnp.roll(first, -1, axis=0)
    left = jnp.einsum("...k,mk->...m", ray, first, precision=lax.Precision.HIGHEST)
    start = jnp.argmax((left > 0) & (jnp.roll(left, -1, axis=-1) <= 0), axis=-1)
    before, after = ((ray * corner[start]).sum(axis=-1) for corner in (first, second))
    return _Side(start, before, after)


def _wavelength(side: _Side) -> Plane:
    """Between the two corners in the ratio in which the ray divides their side."""
    wavelengths = jnp.asarray(spectral_locus()[0], side.before.dtype)
    return wavelengths[side.start] + guard.ratio(side.before, side.before - side.after)


def _from_white(xy: XY, white: Chromaticity) -> XY:
    return jnp.stack([xy[..., 0] - white[0], xy[..., 1] - white[1]], axis=-1)


def _is_white(ray: XY) -> Bool[Array, "..."]:
    return jnp.abs(ray).max(axis=-1) <= guard.shortest(ray)


def _border(white: Chromaticity) -> Float[np.ndarray, "M 2"]:
    """The locus, as seen from the white; from its last corner to its first goes the line of purples."""
    corners = spectral_locus()[1] - np.asarray(white)
    if not np.all(_cross(corners, np.roll(corners, -1, axis=0)) < 0):
        raise BadInput(
            f"the white {white} is not inside the locus of pure colours: give its (x, y)"
        )
    return corners


def _cross(a: Float[np.ndarray, "M 2"], b: Float[np.ndarray, "M 2"]) -> Float[np.ndarray, "M"]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
