"""Directions of lights from where they are seen in a mirror ball.

At the highlight the normal n halves the angle between the viewer v and the light l (LIGHT-10 with the
viewer for the light):

    l = 2 (n.v) n - v

On a ball n is known at every pixel. An error of the highlight of a share e of the radius is one of l of
about 2 e / n.v radians.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diffshade.geometry.camera import AbstractCamera, OrthographicCamera
from diffshade.geometry.sphere import Sphere
from diffshade.geometry.surface import Visibility
from diffshade.io.circle import Circle
from diffshade.vector import dot, reflect

__all__ = ["ball_of", "degrees_per_pixel", "mirrored"]


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


def degrees_per_pixel(
    sphere: Sphere, camera: AbstractCamera, x: Float[np.ndarray, "K"], y: Float[np.ndarray, "K"]
) -> Float[np.ndarray, "K"]:
    """By how much a direction of `mirrored` turns, at the most, where its highlight moves by a pixel.

    The larger singular value of the derivative of l by (x, y); seen from afar it is 2 / (R n.v) radians
    for a ball of R pixels, which grows without limit towards the rim.

    >>> sphere, camera = ball_of(Circle(20, 20, 10), (40, 40))
    >>> degrees_per_pixel(sphere, camera, np.array([20.0, 26.0]), np.array([20.0, 20.0])).round().tolist()
    [11.0, 14.0]
    """

    def direction(at: Float[Array, "2"]) -> Float[Array, "3"]:
        return mirrored(sphere, camera, at[:1], at[1:])[1][0]

    slopes = jax.vmap(jax.jacfwd(direction))(jnp.stack([jnp.asarray(x), jnp.asarray(y)], axis=-1))
    return np.asarray(np.degrees(np.linalg.norm(np.asarray(slopes), ord=2, axis=(1, 2))))
