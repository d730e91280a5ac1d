"""A mirror ball under one lamp, ray by ray in NumPy: knows nothing of the library."""

import numpy as np


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def mirror_image(
    shape: tuple[int, int],
    center: np.ndarray,
    radius: float,
    light: np.ndarray,
    *,
    near: bool = False,
    focal: float | None = None,
    spread: float = 0.05,
) -> np.ndarray:
    """Radiance [H, W, 1], of 5 x 5 rays a pixel: 1 within the lamp's angular radius, 0.02 off it.

    Orthographic in pixel units about the image's centre, or a pinhole of this focal length at the
    origin that looks along -z. `light` is a direction, or the place of a `near` lamp.
    """
    sub = (np.arange(5) + 0.5) / 5
    y, x = np.mgrid[: shape[0], : shape[1]]
    x = (x[..., None, None] + sub - shape[1] / 2) + 0 * sub[:, None]
    y = (shape[0] / 2 - y[..., None, None] - sub[:, None]) + 0 * sub
    if focal is None:
        origin = np.stack([x, y, np.full_like(x, 1e4)], axis=-1)
        d = np.broadcast_to(np.array([0.0, 0.0, -1.0]), origin.shape)
    else:
        origin = np.zeros((*x.shape, 3))
        d = unit(np.stack([x / focal, y / focal, -np.ones_like(x)], axis=-1))
    offset = origin - center
    b = (offset * d).sum(-1)
    root = b**2 - (offset**2).sum(-1) + radius**2
    hit = root >= 0
    p = origin + d * (-b - np.sqrt(np.where(hit, root, 0)))[..., None]
    n = (p - center) / radius
    mirrored = d - 2 * (d * n).sum(-1, keepdims=True) * n
    towards = unit(light - p) if near else unit(np.asarray(light, float))
    lit = (mirrored * towards).sum(-1) > np.cos(spread)
    return np.where(hit, np.where(lit, 1.0, 0.02), 0.0).mean(axis=(-1, -2))[..., None]


def degrees(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles between directions."""
    return np.degrees(np.arccos(np.clip((unit(a) * unit(b)).sum(-1), -1, 1)))
