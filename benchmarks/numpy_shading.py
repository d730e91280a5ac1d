"""The rival: LIGHT-13 in NumPy as it is usually written, arrays [P, 3], one light after the other."""

from typing import Any

import numpy as np

__all__ = ["points", "shade"]


def points(size: int, extent: float, dtype: type) -> tuple[np.ndarray, np.ndarray]:
    """Positions (and, on the unit sphere, normals) [P, 3] of the foreground, and its mask."""
    at = ((np.arange(size) + 0.5) / size - 0.5) * extent
    x, y = np.meshgrid(at, -at)
    inside = x**2 + y**2 <= 1
    x, y = x[inside], y[inside]
    return np.stack([x, y, np.sqrt(1 - x**2 - y**2)], axis=-1).astype(dtype), inside


def shade(p: np.ndarray, scene: dict[str, Any]) -> np.ndarray:
    """The radiance [P, 3] of points on the unit sphere seen from afar."""
    number = p.dtype.type
    n, v = p, np.array([0, 0, 1], p.dtype)
    ka, kd, ks = (np.array(scene[k], p.dtype) for k in ("ka", "kd", "ks"))
    image = np.broadcast_to(number(scene["ambient"]) * ka, p.shape).copy()
    for position, intensity in zip(scene["positions"], scene["intensities"], strict=True):
        s = position.astype(p.dtype) - p
        d = np.linalg.norm(s, axis=-1, keepdims=True)
        l = s / d
        n_dot_l = np.sum(n * l, axis=-1, keepdims=True)
        r = 2 * n_dot_l * n - l
        r_dot_v = np.maximum(np.sum(r * v, axis=-1, keepdims=True), 0)
        lobe = np.where(n_dot_l > 0, r_dot_v ** number(scene["shininess"]), 0)
        f = number(1)
        if scene["constants"] is not None:
            c0, c1, c2 = map(number, scene["constants"])
            f = np.minimum(1 / (c0 + c1 * d + c2 * d * d), 1)
        colour = np.asarray(intensity, p.dtype)
        image += colour * f * (kd * np.maximum(n_dot_l, 0) + ks * lobe)
    return image
