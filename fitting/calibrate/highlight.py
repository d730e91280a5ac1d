"""The highlight of one lamp in a photograph of a mirror ball, to a part of a pixel.

Levels are relative to the brightest pixel on the ball, so that it does not matter how values relate to
light. The lamp is the brightest there is, however small: spots that do not come near the brightest
pixel are reflections of the surroundings, however large.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from diffshade.errors import BadInput
from diffshade.io.circle import Circle
from fitting.calibrate.one_lamp import check_one_lamp, check_whole

__all__ = ["Highlight", "find_highlight"]

CORE = 0.9
"""Of the brightest pixel: from here on a sensor that clips says the same of all."""
FEWEST = 12
"""Pixels of a core that is flat, as where the sensor clipped ..."""
FLAT = 0.97
"""... its median, of the brightest pixel: that of a core as round as a Gaussian's is 0.95."""
THIN = 0.25
"""Of the core's greatest depth: streaks that are thinner do not count."""
FOOT = 0.05
"""Of the brightest pixel above what is about the spot: the foot of a highlight that is not clipped."""
AROUND = 2.0
"""Pixels about a spot, beyond its own radius, that its foot may reach."""
RIM = 0.98
"""Of the radius: beyond, a mirror shows what is behind it, squeezed, and its own edge."""

Plane = Float[np.ndarray, "H W"]
Mask = Bool[np.ndarray, "H W"]


class Highlight(NamedTuple):
    """Where a light is seen in a mirror ball: (x, y) in pixels from the top left corner, y down.

    `size` is the root mean square extent of the highlight in pixels, `rival` how large the next
    bright spot is beside it, from 0 (there is none) to 1 (as large, or larger), and `contrast` how
    many times brighter its brightest pixel is than the ball's median, infinite on a black ball.
    """

    x: float
    y: float
    size: float
    rival: float
    contrast: float


def find_highlight(
    image: Float[np.ndarray, "H W C"], circle: Circle, mask: Bool[np.ndarray, "H W"] | None = None
) -> Highlight:
    """The highlight of the one lamp in a photograph of a mirror ball.

    Where it is clipped, and wide enough to tell, each pixel of its core counts by its depth, the
    distance from the core's edge: streaks of glare are thin, and reach far without moving it; of
    several such cores the largest is taken, depths summed. Elsewhere it is the largest spot, of those
    above half of the brightness, that comes near the brightest pixel, and each pixel of it and close
    about it counts by what it has above the spot's foot. Infinite pixels count as the brightest of the
    others.

    Raises `BadInput` where the ball is black or all of one value, and where it is no mirror that shows
    one lamp: what is bright is as large as no lamp, or falls into many spots, or an edge cuts it off, or
    pixels that are NaN do.

    >>> image = np.zeros((40, 40, 1))
    >>> image[10:13, 20:23] = 1
    >>> found = find_highlight(image, Circle(20, 20, 15))
    >>> round(found.x, 6), round(found.y, 6)
    (21.5, 11.5)
    """
    brightness = image.mean(axis=-1)
    y, x = np.mgrid[: brightness.shape[0], : brightness.shape[1]] + 0.5
    ball = np.hypot(x - circle.cx, y - circle.cy) < RIM * circle.radius
    if mask is not None:
        ball &= mask
    finite = ball & np.isfinite(brightness)
    if not finite.any():
        raise BadInput("no pixel lies on the ball: correct the circle or the mask")
    # What overflowed is as bright as the brightest that did not
    inside = finite | (ball & np.isposinf(brightness))
    values = np.where(inside, np.minimum(brightness, brightness[finite].max()), 0)
    peak, ground = float(values[inside].max()), float(np.median(values[inside]))
    if not peak > ground:
        raise BadInput("the ball shows no highlight: every pixel of it has one value")
    half = (peak + ground) / 2
    check_one_lamp(inside & (values > half), circle)
    core = inside & (values >= max(CORE * peak, ground))
    clipped = np.count_nonzero(core) >= FEWEST and np.median(values[core]) > FLAT * peak
    weight, rival = _by_depth(core) if clipped else _above_foot(values, inside, half, core)
    check_whole(core if clipped else weight > 0, weight > 0, ball, inside)
    weight = weight / weight.sum()
    at_x, at_y = float((x * weight).sum()), float((y * weight).sum())
    size = float(np.sqrt((((x - at_x) ** 2 + (y - at_y) ** 2) * weight).sum()))
    return Highlight(at_x, at_y, size, rival, peak / ground if ground > 0 else np.inf)


def _by_depth(core: Mask) -> tuple[Plane, float]:
    """Weights of the largest core, and the size of the next beside it."""
    depth = ndimage.distance_transform_edt(core)
    weight = np.maximum(depth - THIN * depth.max(), 0)
    spots, count = ndimage.label(weight > 0)
    sizes = ndimage.sum_labels(weight, spots, np.arange(1, count + 1))
    largest = int(np.argmax(sizes))
    return np.where(spots == largest + 1, weight, 0), _beside(sizes, largest)


def _above_foot(values: Plane, inside: Mask, half: float, core: Mask) -> tuple[Plane, float]:
    """Weights of the largest spot that reaches the core, and the size of the next beside it."""
    spots, count = ndimage.label(inside & (values > half), structure=np.ones((3, 3)))
    sizes = ndimage.sum_labels(values - half, spots, np.arange(1, count + 1))
    reach = np.isin(np.arange(1, count + 1), spots[core])
    chosen = int(np.argmax(np.where(reach, sizes, 0)))
    spot = spots == chosen + 1
    far = ndimage.distance_transform_edt(~spot)
    close = inside & (far <= np.sqrt(np.count_nonzero(spot) / np.pi) + AROUND)
    close &= (spots == 0) | spot
    ground = float(np.median(values[close & ~spot])) if (close & ~spot).any() else half
    level = ground + FOOT * (float(values[spot].max()) - ground)
    return np.where(close, np.maximum(values - level, 0), 0), _beside(sizes, chosen)


def _beside(sizes: Float[np.ndarray, "N"], chosen: int) -> float:
    """The largest of the others, of the chosen one, 1 at the most."""
    return min(float(np.delete(sizes, chosen).max(initial=0) / sizes[chosen]), 1.0)
