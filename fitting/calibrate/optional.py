"""OpenCV, which only some of calibration needs."""

from typing import Any

from diffshade.errors import BadInput

__all__ = ["opencv"]


def opencv() -> Any:
    """The module `cv2`; raises `BadInput` that says how to have it where it is not installed."""
    try:
        import cv2
    except ImportError:
        raise BadInput(
            "this needs OpenCV, which is not installed: pip install 'diffshade[calibrate]'"
        ) from None
    return cv2
