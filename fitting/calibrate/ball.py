"""A mirror ball in photographs: its outline, and the light of each image."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from diffshade.errors import BadInput, naming
from diffshade.io.circle import Circle
from diffshade.io.circle_from_mask import circle_from_mask
from fitting.calibrate.highlight import Highlight, find_highlight
from fitting.calibrate.mirror import ball_of, degrees_per_pixel, mirrored
from fitting.calibrate.outline import circle_from_images
from fitting.calibrate.perspective import sphere_of_circle

__all__ = ["MirrorBall", "ball_outline", "mirror_ball"]

FEWEST_IMAGES = 4
"""Images that are taken to light the rim all round between them."""


class MirrorBall(NamedTuple):
    """The ball's outline, and of each image its highlight, where on the ball that is, and the direction.

    `points` are in radii from the ball's centre; world axes, x right, y up, z to the camera.
    `degrees_per_pixel` says how far each direction turns where its highlight is off by a pixel.
    """

    circle: Circle
    highlights: tuple[Highlight, ...]
    points: Float[np.ndarray, "K 3"]
    directions: Float[np.ndarray, "K 3"]
    degrees_per_pixel: Float[np.ndarray, "K"]


def mirror_ball(
    images: Sequence[Float[np.ndarray, "H W C"]],
    *,
    mask: Bool[np.ndarray, "H W"] | None = None,
    circle: Circle | None = None,
    fov: float | None = None,
    names: Sequence[str] | None = None,
) -> MirrorBall:
    """The directions of the lights that a mirror ball shows, one an image.

    The outline is the given `circle`, or else found from the `mask`, or from the brightest of four
    images or more. The camera is far away, or has the vertical field of view `fov` in radians, the
    image's centre being its axis. `names` stand in complaints.

    Raises `BadInput` where no outline or no highlight is found, or the ball is no mirror under one lamp.

    >>> image = np.zeros((40, 40, 1))
    >>> image[10:13, 20:23] = 1
    >>> mirror_ball([image], circle=Circle(21.5, 20, 15)).directions.round(3).tolist()
    [[0.0, 0.934, 0.358]]
    """
    circle = ball_outline(images, mask=mask, circle=circle)
    height, width = images[0].shape[:2]
    found = []
    for k, image in enumerate(images):
        with naming(names[k] if names else f"image {k}"):
            found.append(find_highlight(image, circle, mask))
    shape = (height, width)
    sphere, camera = ball_of(circle, shape) if fov is None else sphere_of_circle(circle, shape, fov)
    x, y = np.array([(h.x, h.y) for h in found]).T
    points, directions = (np.asarray(v, float) for v in mirrored(sphere, camera, x, y))
    center, radius = np.asarray(sphere.center, float), float(sphere.radius)
    turns = degrees_per_pixel(sphere, camera, x, y)
    return MirrorBall(circle, tuple(found), (points - center) / radius, directions, turns)


def ball_outline(
    images: Sequence[Float[np.ndarray, "H W C"]],
    *,
    mask: Bool[np.ndarray, "H W"] | None = None,
    circle: Circle | None = None,
) -> Circle:
    """The outline that `mirror_ball` takes: the given one, that of the mask, or that of the images."""
    if len(sizes := {image.shape[:2] for image in images}) != 1:
        raise BadInput(f"the photographs have {len(sizes)} sizes: give one or more, of one size")
    if circle is None and mask is not None:
        return circle_from_mask(mask)
    if circle is not None:
        return circle
    if len(images) < FEWEST_IMAGES:
        raise BadInput(
            f"{len(images)} photographs do not show the ball's outline all round: give a mask or a circle"
        )
    return circle_from_images(images)
