"""Exposure brackets to one linear image, by OpenCV (Debevec and Malik 1997)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8

from diffshade.errors import BadInput
from fitting.calibrate.optional import opencv

__all__ = ["Merged", "merge_brackets"]

FEWEST = 3
"""Exposures from which a response curve is told."""


SAMPLES = 70
"""Pixels that the response is found from: more tell it no better."""
SMALLEST = 16
"""Pixels of a side: in less OpenCV finds no place for its samples."""
DARK, BRIGHT = 5, 250
"""Codes that say "at most" and "at least"."""


class Merged(NamedTuple):
    """Radiance up to one factor a channel, and the response: the relative exposure of each code.

    `valid` are the pixels that some exposure neither clipped nor left dark, in every channel.
    """

    radiance: Float[np.ndarray, "H W C"]
    valid: Bool[np.ndarray, "H W"]
    response: Float[np.ndarray, "256 C"]


def merge_brackets(
    images: Sequence[UInt8[np.ndarray, "H W C"]], seconds: Sequence[float | int]
) -> Merged:
    """Photographs of one thing, of different exposure times, as one linear image.

    The camera's response is found from them (`cv2.createCalibrateDebevec`) and undone. Its scale is
    free in each channel: code 128 is exposure 1, so the white balance is that of the response, not of
    the scene. Images are as encoded, 8 bits, from one place; `seconds` are their exposure times.

    Raises `BadInput` without OpenCV, for fewer than three exposures, for times that are not above 0,
    or all the same, for images of less than 16 pixels a side, and for other than one channel or three.
    """
    if len(images) != len(seconds):
        raise BadInput(f"{len(images)} images and {len(seconds)} exposure times: give one an image")
    times = np.asarray(seconds, np.float32)
    if len(images) < FEWEST:
        raise BadInput(f"{len(images)} exposures do not tell a response: give three or more")
    if not (np.isfinite(times).all() and (times > 0).all() and np.ptp(times) > 0):
        raise BadInput(f"exposure times are {tuple(seconds)}: give seconds above 0 that differ")
    if len({image.shape for image in images}) > 1 or any(i.dtype != np.uint8 for i in images):
        raise BadInput(
            "the images differ in size, or are not of 8 bits: give photographs of one kind"
        )
    height, width, channels = images[0].shape
    if min(height, width) < SMALLEST or channels not in (1, 3):
        raise BadInput(
            f"the images are {width} x {height} pixels of {channels} channels: give {SMALLEST} a side or"
            " more, grey or RGB"
        )
    cv2 = opencv()
    stack = [np.ascontiguousarray(image) for image in images]
    response = cv2.createCalibrateDebevec(samples=SAMPLES, random=False).process(stack, times)
    radiance = np.asarray(cv2.createMergeDebevec().process(stack, times, response))
    told = [(image > DARK) & (image < BRIGHT) for image in images]
    return Merged(
        radiance.reshape(images[0].shape),
        np.logical_or.reduce(told).all(axis=-1),
        np.asarray(response).reshape(256, channels),
    )
