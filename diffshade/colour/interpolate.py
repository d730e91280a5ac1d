"""The way from one colour to another, which every system of colour takes differently.

Halfway from red to green lies a dark yellow in RGB, (60, 1, 0.5) in HSV, and a bright one in HSV,
(60, 1, 1). RGB and what is linear in it (CMY, YIQ) are right where colours are added as light is:
blending, shading from vertex to vertex. HSV and HLS are for choosing colours.
"""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from diffshade.colour.device import (
    Colour,
    cmy_to_rgb,
    hls_to_rgb,
    hsv_to_rgb,
    rgb_to_cmy,
    rgb_to_hls,
    rgb_to_hsv,
    rgb_to_yiq,
    yiq_to_rgb,
)
from diffshade.errors import BadInput

__all__ = ["SYSTEMS", "interpolate"]


def _same(rgb: Colour) -> Colour:
    return rgb


SYSTEMS: dict[str, tuple[Callable[[Colour], Colour], Callable[[Colour], Colour]]] = {
    "rgb": (_same, _same),
    "cmy": (rgb_to_cmy, cmy_to_rgb),
    "yiq": (rgb_to_yiq, yiq_to_rgb),
    "hsv": (rgb_to_hsv, hsv_to_rgb),
    "hls": (rgb_to_hls, hls_to_rgb),
}
"""From RGB and to it."""
HUES = {"hsv", "hls"}


def interpolate(
    start: Colour, end: Colour, share: Float[Array, "..."] | float, system: str = "rgb"
) -> Colour:
    """(1 - share) start + share end in a system of colour, from RGB and back to RGB.

    `start`, `end` [..., 3] and `share` [...] broadcast.

    Hues go the shorter way round, and a grey takes the hue of the other end. Not smooth where both
    ways are equally long. Raises `BadInput` for a system that is not one of `SYSTEMS`.

    >>> red, green = jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0])
    >>> interpolate(red, green, 0.5).tolist(), interpolate(red, green, 0.5, "hsv").tolist()
    ([0.5, 0.5, 0.0], [1.0, 1.0, 0.0])
    """
    if system not in SYSTEMS:
        raise BadInput(f"the system of colour is {system!r}: give one of {', '.join(SYSTEMS)}")
    into, back = SYSTEMS[system]
    t = jnp.asarray(share, start.dtype)
    shape = jnp.broadcast_shapes(start.shape, end.shape, (*t.shape, 3))
    start, end = (jnp.broadcast_to(colour, shape) for colour in (start, end))
    a, b = into(start), into(end)
    if system in HUES:
        a, b = _hues_together(start, a, b), _hues_together(end, b, a)
        turn = b[..., 0] - a[..., 0]
        b = b.at[..., 0].add(jnp.where(turn > 180, -360, jnp.where(turn < -180, 360, 0)))
    t = jnp.broadcast_to(t, shape[:-1])[..., None]
    return back((1 - t) * a + t * b)


def _hues_together(rgb: Colour, own: Colour, other: Colour) -> Colour:
    """A grey, which has no hue of its own, with that of the other colour."""
    grey = rgb.max(axis=-1) == rgb.min(axis=-1)
    return own.at[..., 0].set(jnp.where(grey, other[..., 0], own[..., 0]))
