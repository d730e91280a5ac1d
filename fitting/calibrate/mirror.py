"""Directions of lights from their highlights on a mirror ball.

At the highlight the normal n halves the angle between the viewer v and the light l (LIGHT-10 with the
viewer for the light):

    l = 2 (n.v) n - v

On a ball n is known at every pixel. An error of the highlight of a share e of the radius is one of l of
about 2 e / n.v radians.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy import ndimage

from diffshade.errors import BadInput
from diffshade.geometry.camera import AbstractCamera, OrthographicCamera
from diffshade.geometry.sphere import Sphere
from diffshade.geometry.surface import Visibility
from diffshade.io.circle import Circle
from diffshade.vector import dot, reflect

__all__ = ["Highlight", "ball_of", "find_highlight", "mirrored"]

CORE = 0.9
"""Of the brightest pixel: from here on a sensor that clips says the same of all."""
FEWEST = 12
"""Pixels of a core that is flat, as where the sensor clipped ..."""
FLAT = 0.97
"""... its median, of the brightest pixel: that of a core as round as a Gaussian's is 0.95."""
THIN = 0.25
"""Of the core's greatest depth: streaks that are thinner do not count."""
FOOT = 0.05
"""Of the brightest pixel above the ball's median: the foot of a highlight that is not clipped."""
RIM = 0.98
"""Of the radius: beyond, a mirror shows what is behind it, squeezed, and its own edge."""


class Highlight(NamedTuple):
    """Where a light is seen in a mirror ball: (x, y) in pixels from the top left corner, y down.

    `size` is the root mean square extent of the highlight in pixels, `rival` how large the next
    bright spot is beside it, from 0 (there is none) to 1 (the two could be exchanged).
    """

    x: float
    y: float
    size: float
    rival: float


def find_highlight(
    image: Float[np.ndarray, "H W C"], circle: Circle, mask: Bool[np.ndarray, "H W"] | None = None
) -> Highlight:
    """The highlight of the one lamp in a photograph of a mirror ball, to a part of a pixel.

    Levels are relative to the brightest pixel on the ball, so that it does not matter how values
    relate to light. Where the highlight is clipped each pixel of its core counts by its depth, the
    distance from the core's edge: streaks of glare are thin, and reach far without moving it. Where
    it is not, each counts by what it has above the highlight's foot. Of several spots the largest is
    taken, depths summed: reflections of the surroundings and of the lamp's own are smaller.

    Raises `BadInput` where the ball is black or all of one value.

    >>> image = np.zeros((40, 40, 1))
    >>> image[10:13, 20:23] = 1
    >>> found = find_highlight(image, Circle(20, 20, 15))
    >>> round(found.x, 6), round(found.y, 6)
    (21.5, 11.5)
    """
    brightness = image.mean(axis=-1)
    y, x = np.mgrid[: brightness.shape[0], : brightness.shape[1]] + 0.5
    inside = np.hypot(x - circle.cx, y - circle.cy) < RIM * circle.radius
    if mask is not None:
        inside &= mask
    inside &= np.isfinite(brightness)
    if not inside.any():
        raise BadInput("no pixel lies on the ball: correct the circle or the mask")
    values = np.where(inside, brightness, 0)
    peak, ground = float(values[inside].max()), float(np.median(values[inside]))
    if not peak > ground:
        raise BadInput("the ball shows no highlight: every pixel of it has one value")
    core = inside & (values >= max(CORE * peak, ground))
    wide = np.count_nonzero(core) >= FEWEST
    if clipped := wide and float(np.median(values[core])) > FLAT * peak:
        depth = ndimage.distance_transform_edt(core)
        weight = np.maximum(depth - THIN * depth.max(), 0)
        core = weight > 0
    else:
        level = ground + FOOT * (peak - ground)
        core = inside & (values > level)
        weight = np.where(core, values - level, 0)
    spots, count = ndimage.label(core, structure=np.ones((3, 3)) if not clipped else None)
    sizes = ndimage.sum_labels(weight, spots, np.arange(1, count + 1))
    largest = int(np.argmax(sizes))
    rival = float(np.delete(sizes, largest).max(initial=0) / sizes[largest])
    weight = np.where(spots == largest + 1, weight, 0) / sizes[largest]
    at_x, at_y = float((x * weight).sum()), float((y * weight).sum())
    size = float(np.sqrt((((x - at_x) ** 2 + (y - at_y) ** 2) * weight).sum()))
    return Highlight(at_x, at_y, size, rival)


def ball_of(circle: Circle, shape: tuple[int, int]) -> tuple[Sphere, OrthographicCamera]:
    """The ball behind a circle seen from afar, in pixels from the image's centre, and the camera."""
    height, width = shape
    center: Any = (circle.cx - width / 2, height / 2 - circle.cy, 0.0)
    radius: Any = circle.radius
    return Sphere(center, radius), OrthographicCamera(width, height, float(width))


@jax.jit
def mirrored(
    sphere: Sphere, camera: AbstractCamera, x: Float[Array, "K"], y: Float[Array, "K"]
) -> tuple[Float[Array, "K 3"], Float[Array, "K 3"]]:
    """Points of a mirror ball, and the unit directions in which the lights seen there lie.

    `x` and `y` are pixels from the image's top left corner, y down. World axes, for any camera:
    orthographic with v = (0, 0, 1), or perspective, where v goes from the point to the eye. What is
    outside the outline counts as on it. Differentiable in everything but on the outline.

    >>> sphere, camera = ball_of(Circle(20, 20, 10), (40, 40))
    >>> point, l = mirrored(sphere, camera, np.array([20.0]), np.array([20.0]))
    >>> l.tolist()
    [[0.0, 0.0, 1.0]]
    """
    side = camera.frame.side
    rays = camera.through((x - camera.width / 2) / side, (camera.height / 2 - y) / side)
    seen = Visibility((1, x.shape[0]), jnp.arange(x.shape[0], dtype=jnp.int32))
    point, normal = sphere.points(rays, seen)
    v = -rays.direction
    l = reflect(v, normal * jax.lax.rsqrt(dot(normal, normal)))
    return point.to_array(), l.to_array()
