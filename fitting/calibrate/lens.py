"""Lens distortion, taken out by OpenCV (Brown 1966): the model is that of `cv2.undistort`.

With x, y from the principal point in focal lengths and r^2 = x^2 + y^2,

    x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)

and y_d likewise. Every model here takes cameras for pinholes: undistort first.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from diffshade.errors import BadInput
from fitting.calibrate.optional import opencv

__all__ = ["undistort"]


def undistort(
    image: Float[np.ndarray, "H W C"],
    *,
    focal: float | int,
    coefficients: Sequence[float | int],
    centre: tuple[float, float] | None = None,
) -> Float[np.ndarray, "H W C"]:
    """A linear image as a pinhole camera of the same focal length would have taken it.

    `focal` is in pixels, `coefficients` are k1, k2, p1, p2 and optionally k3, `centre` the principal
    point in pixels from the top left corner (by default the middle). Values are interpolated between
    four pixels, so undistort linear images, and decide before what is clipped; what lies outside the
    photograph is 0.

    Raises `BadInput` without OpenCV, and for other numbers of coefficients.

    >>> image = np.random.default_rng(0).random((8, 8, 3))
    >>> bool(np.allclose(undistort(image, focal=10.0, coefficients=(0, 0, 0, 0)), image))
    True
    """
    if len(coefficients) not in (4, 5) or not np.isfinite(coefficients).all():
        raise BadInput(
            f"coefficients are {tuple(coefficients)}: give k1, k2, p1, p2 and, or not, k3"
        )
    if not 0 < focal < np.inf:
        raise BadInput(f"focal is {focal:g}: give pixels above 0")
    if centre is not None and not np.isfinite(centre).all():
        raise BadInput(f"centre is {centre}: give pixels from the top left corner")
    if image.dtype == np.float16:
        image = image.astype(np.float32)
    cv2 = opencv()
    height, width, channels = image.shape
    x, y = (width / 2, height / 2) if centre is None else centre
    # OpenCV's first pixel has its centre at 0
    matrix = np.array([[focal, 0, x - 0.5], [0, focal, y - 0.5], [0, 0, 1.0]])
    done = cv2.undistort(np.ascontiguousarray(image), matrix, np.asarray(coefficients, float))
    return np.asarray(done).reshape(height, width, channels)
