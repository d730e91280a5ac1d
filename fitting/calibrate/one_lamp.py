"""Whether what is bright on a ball can be one lamp that a mirror shows.

A mirror ball seen from afar maps equal solid angles to equal areas of its disc: l turns twice as far as
n, so that d omega_l = 4 (n.v) d omega_n, and R^2 (n.v) d omega_n is an area of the disc. What covers a
share f of the disc is therefore a cone of light of the solid angle 4 pi f, whose half angle a has

    f = (1 - cos a) / 2.

On a matte ball brightness falls off with n.l over the whole of it, and what is above half of it would
be a lamp some 120 degrees across.
"""

import numpy as np
from jaxtyping import Bool
from scipy import ndimage

from diffshade.errors import BadInput
from diffshade.io.circle import Circle

__all__ = ["check_one_lamp", "check_whole"]

WIDEST = 45.0
"""Degrees across that a lamp may have. An umbrella and its glare, in JPEG, has 32."""
MOST = 0.4
"""Of the area of all that is bright: the largest spot has as much, or no lamp stands out."""

Mask = Bool[np.ndarray, "H W"]


def check_one_lamp(bright: Mask, circle: Circle) -> None:
    """Raise `BadInput` where what is bright, above half way from the ball's median to its brightest
    pixel, is larger than a lamp, or is many spots."""
    share = np.count_nonzero(bright) / (np.pi * circle.radius**2)
    across = 2 * np.degrees(np.arccos(1 - 2 * min(share, 1)))
    if across > WIDEST:
        raise BadInput(
            f"this is no mirror ball under one lamp: {share:.0%} of it is bright, which a mirror shows"
            f" of a lamp {across:.0f} degrees across; photograph a mirror ball, or correct the circle or"
            " the mask"
        )
    spots, count = ndimage.label(bright, structure=np.ones((3, 3)))
    largest = np.bincount(spots[bright]).max() / np.count_nonzero(bright)
    if largest < MOST:
        raise BadInput(
            f"no lamp stands out on the ball: {count} spots are bright, and the largest has"
            f" {largest:.0%} of their area; light one lamp, and darken what else is mirrored"
        )


def check_whole(highlight: Mask, counted: Mask, ball: Mask, known: Mask) -> None:
    """Raise `BadInput` where the edge of the ball, or of the photograph, cuts the highlight off, or
    pixels of it that are not `known` do. Those of thin streaks are not `counted`."""
    if _cut(highlight, counted, ball):
        raise BadInput(
            "the highlight is cut off at the edge of the ball or of the photograph: a mirror ball shows"
            " no lamp behind it whole, and a matte one is bright there; move the lamp to the front, take"
            " the whole of the ball, or correct the circle or the mask"
        )
    if _cut(highlight, counted, known):
        raise BadInput(
            "the highlight has pixels that are NaN, so that where its middle is is not known; give a"
            " photograph that has numbers there"
        )


def _cut(highlight: Mask, counted: Mask, seen: Mask) -> bool:
    """Whether a pixel that is counted is as near to the edge of what is seen as to the highlight's."""
    depth, away = (
        ndimage.distance_transform_edt(np.pad(plane, 1))[1:-1, 1:-1] for plane in (highlight, seen)
    )
    return bool((depth >= away)[counted].any())
