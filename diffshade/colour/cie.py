"""CIE colours: XYZ, chromaticities, L*u*v*, and the RGB of a screen with given primaries.

Colours are arrays [..., 3]. X, Y, Z are those of the standard observer of 1931; a chromaticity is
x = X / (X + Y + Z), and y alike. `D65` is daylight, the white of most screens.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from diffshade import guard
from diffshade.colour.matrix import transformed
from diffshade.errors import BadInput

__all__ = [
    "D65",
    "SRGB",
    "Primaries",
    "between_screens",
    "in_gamut",
    "luv_to_xyz",
    "rgb_to_xyz",
    "xyy_to_xyz",
    "xyz_to_luv",
    "xyz_to_rgb",
    "xyz_to_xyy",
]

Plane = Float[Array, "..."]
Colour = Float[Array, "... 3"]
Chromaticity = tuple[float, float]

D65: Chromaticity = (0.3127, 0.3290)

DARK = (6 / 29) ** 3
"""Y / Y_n below which L* is linear: 0.008856."""
SLOPE = (29 / 3) ** 3
"""Of L* there: 903.3."""


def _of_chromaticity(xy: Chromaticity) -> Float[np.ndarray, "3"]:
    """(X, Y, Z) with Y = 1."""
    x, y = xy
    return np.array([x / y, 1, (1 - x - y) / y])


@dataclass(frozen=True)
class Primaries:
    """The chromaticities (x, y) of a screen's red, green and blue, and of its white, whose Y is 1.

    Raises `BadInput` for primaries on one line, and for chromaticities with y = 0.

    >>> Primaries((0.64, 0.33), (0.30, 0.60), (0.15, 0.06)).to_xyz.round(4)[1].tolist()
    [0.2126, 0.7152, 0.0722]
    """

    red: Chromaticity
    green: Chromaticity
    blue: Chromaticity
    white: Chromaticity = D65

    def __post_init__(self) -> None:
        if min(y for _, y in (self.red, self.green, self.blue, self.white)) <= 0:
            raise BadInput("a chromaticity of a screen has y <= 0: give (x, y) with y above 0")
        if abs(np.linalg.det(self._columns())) < 1e-9:
            raise BadInput("the primaries of a screen lie on one line: they make no colours")

    @property
    def to_xyz(self) -> Float[np.ndarray, "3 3"]:
        """M with (X, Y, Z) = M (R, G, B): the primaries' colours, each so bright that all make white."""
        columns = self._columns()
        return columns * np.linalg.solve(columns, _of_chromaticity(self.white))

    def _columns(self) -> Float[np.ndarray, "3 3"]:
        return np.stack([_of_chromaticity(p) for p in (self.red, self.green, self.blue)], axis=1)


SRGB = Primaries((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))
"""IEC 61966-2-1 and ITU-R BT.709."""


def rgb_to_xyz(rgb: Colour, primaries: Primaries = SRGB) -> Colour:
    """(X, Y, Z) = M (R, G, B) of linear RGB.

    >>> rgb_to_xyz(jnp.ones(3)).round(3).tolist()
    [0.950..., 1.0, 1.08...]
    """
    return transformed(rgb, primaries.to_xyz)


def xyz_to_rgb(xyz: Colour, primaries: Primaries = SRGB) -> Colour:
    """Linear RGB; outside [0, 1] for a colour that the screen has not (`in_gamut`).

    >>> xyz_to_rgb(jnp.array([0.9505, 1.0, 1.0891])).round(2).tolist()
    [1.0, 1.0, 1.0]
    """
    return transformed(xyz, np.linalg.inv(primaries.to_xyz))


def between_screens(rgb: Colour, own: Primaries, other: Primaries) -> Colour:
    """M_2^-1 M_1 (R, G, B): what another screen needs to show the same colour.

    >>> between_screens(jnp.array([0.5, 0.25, 0.125]), SRGB, SRGB).round(4).tolist()
    [0.5, 0.25, 0.125]
    """
    return transformed(rgb, np.linalg.solve(other.to_xyz, own.to_xyz))


def in_gamut(rgb: Colour) -> Bool[Array, "..."]:
    """Whether a screen has a colour: all components of its RGB in [0, 1].

    >>> in_gamut(jnp.array([[0.5, 1.0, 0.0], [0.5, 1.01, 0.0]])).tolist()
    [True, False]
    """
    return jnp.all((rgb >= 0) & (rgb <= 1), axis=-1)


def xyz_to_xyy(xyz: Colour) -> Colour:
    """(x, y, Y). Black, which has no chromaticity, is (0, 0, 0), with derivative 0 in x and y.

    >>> xyz_to_xyy(jnp.array([0.25, 0.5, 0.25])).tolist()
    [0.25, 0.5, 0.5]
    """
    total = xyz.sum(axis=-1)
    return jnp.stack(
        [guard.ratio(xyz[..., 0], total), guard.ratio(xyz[..., 1], total), xyz[..., 1]], axis=-1
    )


def xyy_to_xyz(xyy: Colour) -> Colour:
    """X = x Y / y and Z = (1 - x - y) Y / y; black where y = 0, with derivative 0.

    >>> xyy_to_xyz(jnp.array([0.25, 0.5, 0.5])).tolist()
    [0.25, 0.5, 0.25]
    """
    x, y, brightness = (xyy[..., i] for i in range(3))
    whole = guard.ratio(brightness, y)
    return jnp.stack([x * whole, brightness, (1 - x - y) * whole], axis=-1)


def xyz_to_luv(xyz: Colour, white: Chromaticity = D65) -> Colour:
    """(L*, u*, v*) of CIE 1976, against a white with Y = 1: equal distances look about equal.

    L* = 116 Y^(1/3) - 16, or 903.3 Y up to Y = 0.008856; u* = 13 L* (u' - u'_n), v* alike, with
    u' = 4 X / (X + 15 Y + 3 Z) and v' = 9 Y / (X + 15 Y + 3 Z). Black is (0, 0, 0).

    >>> xyz_to_luv(rgb_to_xyz(jnp.array([1.0, 0.0, 0.0]))).round(0).tolist()
    [53.0, 175.0, 38.0]
    """
    brightness = xyz[..., 1]
    is_dark = brightness <= DARK
    root = jnp.cbrt(jnp.where(is_dark, DARK, brightness))
    lightness = jnp.where(is_dark, SLOPE * brightness, 116 * root - 16)
    u, v = _uv(xyz)
    u_white, v_white = _uv_of_chromaticity(white)
    return jnp.stack(
        [lightness, 13 * lightness * (u - u_white), 13 * lightness * (v - v_white)], axis=-1
    )


def luv_to_xyz(luv: Colour, white: Chromaticity = D65) -> Colour:
    """The way back; black where L* = 0, with derivative 0 in u* and v*.

    >>> luv_to_xyz(jnp.array([100.0, 0.0, 0.0])).round(3).tolist()
    [0.950..., 1.0, 1.08...]
    """
    lightness = luv[..., 0]
    brightness = jnp.where(
        lightness <= SLOPE * DARK, lightness / SLOPE, ((lightness + 16) / 116) ** 3
    )
    u_white, v_white = _uv_of_chromaticity(white)
    u = guard.ratio(luv[..., 1], 13 * lightness) + u_white
    v = guard.ratio(luv[..., 2], 13 * lightness) + v_white
    quarter = guard.ratio(brightness, 4 * v)
    return jnp.stack([9 * u * quarter, brightness, (12 - 3 * u - 20 * v) * quarter], axis=-1)


def _uv(xyz: Colour) -> tuple[Plane, Plane]:
    """u' and v'."""
    x, y, z = (xyz[..., i] for i in range(3))
    whole = x + 15 * y + 3 * z
    return guard.ratio(4 * x, whole), guard.ratio(9 * y, whole)


def _uv_of_chromaticity(xy: Chromaticity) -> tuple[float, float]:
    """u' = 4 x / (12 y - 2 x + 3) and v' = 9 y / (12 y - 2 x + 3)."""
    x, y = xy
    whole = 12 * y - 2 * x + 3
    return 4 * x / whole, 9 * y / whole
