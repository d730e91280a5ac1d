"""Exposure brackets to one linear image, by OpenCV (Debevec and Malik 1997)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from diffshade.errors import BadInput
from fitting.calibrate.optional import opencv

__all__ = ["Merged", "merge_brackets"]

FEWEST = 3
"""Exposures from which a response curve is told."""


class Merged(NamedTuple):
    """Radiance up to one factor a channel, and the response: the relative exposure of each code."""

    radiance: Float[np.ndarray, "H W C"]
    response: Float[np.ndarray, "256 C"]


def merge_brackets(
    images: Sequence[UInt8[np.ndarray, "H W C"]], seconds: Sequence[float | int]
) -> Merged:
    """Photographs of one thing, of different exposure times, as one linear image.

    The camera's response is found from them (`cv2.createCalibrateDebevec`) and undone. Its scale is
    free in each channel: code 128 is exposure 1, so the white balance is that of the response, not of
    the scene. Images are as encoded, 8 bits, from one place; `seconds` are their exposure times.

    Raises `BadInput` without OpenCV, for fewer than three exposures, and for times that are not
    above 0, or all the same.
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
    cv2 = opencv()
    channels = images[0].shape[2]
    # OpenCV is made for three channels
    stack = [np.ascontiguousarray(np.broadcast_to(i, (*i.shape[:2], 3))) for i in images]
    response = cv2.createCalibrateDebevec(samples=200, random=False).process(stack, times)
    radiance = cv2.createMergeDebevec().process(stack, times, response)
    return Merged(np.asarray(radiance)[..., :channels], np.asarray(response)[:, 0, :channels])
