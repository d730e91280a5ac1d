"""Systems of colour of devices: CMY, CMYK, YIQ, HSV and HLS, from and to RGB.

Colours are arrays [..., 3], or [..., 4] for CMYK, of components in [0, 1]; hues are degrees. In float32
as in float64, under `jit`, `vmap` and `grad`. HSV is Smith's hexcone (1978), HLS the double hexcone of
the Graphics Standards Planning Committee (1979), YIQ that of the NTSC.

A grey has no hue: it is given the hue 0, whose derivative is 0 there, as is that of the saturation of
black, and of white in HLS. What differs by less than `guard.shortest` (2e-13 in float32) is grey. Hue
and saturation are not smooth where two components change places as the largest or the smallest; the
derivative of the larger and the smaller there is shared among equals.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.colour.matrix import transformed

__all__ = [
    "cmy_to_rgb",
    "cmyk_to_rgb",
    "hls_to_rgb",
    "hsv_to_rgb",
    "rgb_to_cmy",
    "rgb_to_cmyk",
    "rgb_to_hls",
    "rgb_to_hsv",
    "rgb_to_yiq",
    "yiq_to_rgb",
]

Plane = Float[Array, "..."]
Colour = Float[Array, "... 3"]

YIQ = np.array([[0.299, 0.587, 0.114], [0.596, -0.275, -0.321], [0.212, -0.523, 0.311]])
"""Rows Y, I and Q of R, G and B."""
RGB = np.linalg.inv(YIQ)


def rgb_to_cmy(rgb: Colour) -> Colour:
    """(C, M, Y) = (1, 1, 1) - (R, G, B): what inks take from white.

    >>> rgb_to_cmy(jnp.array([1.0, 0.0, 0.25])).tolist()
    [0.0, 1.0, 0.75]
    """
    return 1 - rgb


def cmy_to_rgb(cmy: Colour) -> Colour:
    """(R, G, B) = (1, 1, 1) - (C, M, Y).

    >>> cmy_to_rgb(jnp.array([0.0, 1.0, 0.75])).tolist()
    [1.0, 0.0, 0.25]
    """
    return 1 - cmy


def rgb_to_cmyk(rgb: Colour) -> Float[Array, "... 4"]:
    """K = min(C, M, Y), which is taken from each of them: black ink in place of equal parts of all.

    >>> rgb_to_cmyk(jnp.array([1.0, 0.5, 0.25])).tolist()
    [0.0, 0.5, 0.75, 0.0]
    """
    cmy = rgb_to_cmy(rgb)
    black = cmy.min(axis=-1, keepdims=True)
    return jnp.concatenate([cmy - black, black], axis=-1)


def cmyk_to_rgb(cmyk: Float[Array, "... 4"]) -> Colour:
    """(R, G, B) = 1 - ((C, M, Y) + K).

    >>> cmyk_to_rgb(jnp.array([0.0, 0.5, 0.75, 0.0])).tolist()
    [1.0, 0.5, 0.25]
    """
    return 1 - (cmyk[..., :3] + cmyk[..., 3:])


def rgb_to_yiq(rgb: Colour) -> Colour:
    """The luma Y and the differences of colour I and Q of American television, from gamma-corrected RGB.

    Y is in [0, 1], I in [-0.596, 0.596], Q in [-0.523, 0.523].

    >>> rgb_to_yiq(jnp.array([1.0, 0.0, 0.0])).round(3).tolist()
    [0.299..., 0.596..., 0.212...]
    """
    return transformed(rgb, YIQ)


def yiq_to_rgb(yiq: Colour) -> Colour:
    """The way back: the inverse matrix.

    >>> yiq_to_rgb(jnp.array([1.0, 0.0, 0.0])).round(3).tolist()
    [1.0, 1.0, 1.0]
    """
    return transformed(yiq, RGB)


def rgb_to_hsv(rgb: Colour) -> Colour:
    """Hue in [0, 360), saturation (max - min) / max, and value max, as (H, S, V).

    >>> rgb_to_hsv(jnp.array([0.0, 0.5, 0.5])).tolist()
    [180.0, 1.0, 0.5]
    """
    most, least = rgb.max(axis=-1), rgb.min(axis=-1)
    return jnp.stack([_hue(rgb), guard.ratio(most - least, most), most], axis=-1)


def hsv_to_rgb(hsv: Colour) -> Colour:
    """The way back, for any H, in turns of 360.

    Red is V - V S max(0, min(k, 4 - k, 1)) with k = (5 + H/60) mod 6, green and blue the same with 3
    and 1 in place of 5. Not smooth at the multiples of 60 degrees.

    >>> hsv_to_rgb(jnp.array([180.0, 1.0, 0.5])).tolist()
    [0.0, 0.5, 0.5]
    """
    hue, saturation, value = (hsv[..., i] for i in range(3))

    def component(n: int) -> Plane:
        k = (n + hue / 60) % 6
        return value - value * saturation * jnp.clip(jnp.minimum(k, 4 - k), 0, 1)

    return jnp.stack([component(5), component(3), component(1)], axis=-1)


def rgb_to_hls(rgb: Colour) -> Colour:
    """Hue in [0, 360), lightness (max + min) / 2 and saturation, as (H, L, S).

    S = (max - min) / (max + min) where L <= 1/2, else (max - min) / (2 - max - min).

    >>> rgb_to_hls(jnp.array([0.0, 0.5, 0.5])).tolist()
    [180.0, 0.25, 1.0]
    """
    most, least = rgb.max(axis=-1), rgb.min(axis=-1)
    both = most + least
    saturation = guard.ratio(most - least, jnp.where(both <= 1, both, 2 - both))
    return jnp.stack([_hue(rgb), both / 2, saturation], axis=-1)


def hls_to_rgb(hls: Colour) -> Colour:
    """The way back, for any H, in turns of 360.

    Red is L - S min(L, 1 - L) max(-1, min(k - 3, 9 - k, 1)) with k = (H/30) mod 12, green and blue the
    same with 8 and 4 more. Not smooth at the multiples of 60 degrees, and at L = 1/2.

    >>> hls_to_rgb(jnp.array([180.0, 0.25, 1.0])).tolist()
    [0.0, 0.5, 0.5]
    """
    hue, lightness, saturation = (hls[..., i] for i in range(3))
    amount = saturation * jnp.minimum(lightness, 1 - lightness)

    def component(n: int) -> Plane:
        k = (n + hue / 30) % 12
        return lightness - amount * jnp.clip(jnp.minimum(k - 3, 9 - k), -1, 1)

    return jnp.stack([component(0), component(8), component(4)], axis=-1)


def _hue(rgb: Colour) -> Plane:
    """60 (G - B) / (max - min) degrees from red, the same in turn from green at 120 and blue at 240."""
    red, green, blue = (rgb[..., i] for i in range(3))
    most, least = rgb.max(axis=-1), rgb.min(axis=-1)
    first, second = (red >= green) & (red >= blue), green >= blue
    ahead = jnp.where(first, green - blue, jnp.where(second, blue - red, red - green))
    start = jnp.where(first, 0, jnp.where(second, 2, 4)).astype(rgb.dtype)
    sixths = guard.ratio(ahead, most - least)
    return 60 * jnp.where(first & (sixths < 0), sixths + 6, start + sixths)
