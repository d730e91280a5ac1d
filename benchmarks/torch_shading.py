"""The rival in PyTorch: the same shading on planes, compiled by `torch.compile` for the processor.

Lights and coefficients are tensors, so that other values need no new compilation. Tuned as far as we
know how: the compiler may fuse all lights into one loop, and derives within what it compiles. That
takes a minute to compile for 16 lights.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from benchmarks.rivals import threads

__all__ = ["forward", "gradient"]

TINY = 1e-30
"""Below it, r.v counts as zero: a logarithm is taken of it."""
OPTIONS: dict[str, Any] = {"max_fusion_size": 4000}
MANY = 8
"""Lights from which on coefficients are spread over the pixels before they are used, so that each
derivative is summed once; with few lights a sum at each use is faster."""


def _shade(
    points: Tensor,
    normals: Tensor,
    eye: Tensor,
    positions: Tensor,
    intensities: Tensor,
    ambient: Tensor,
    coefficients: Tensor,
    attenuated: bool,
) -> list[Tensor]:
    """The image's three planes."""
    (x, y, z), (nx, ny, nz) = points, normals
    ka, kd, ks = coefficients[:3], coefficients[3:6], coefficients[6:9]
    n, c0, c1, c2 = coefficients[9:]
    vx, vy, vz = eye[0] - x, eye[1] - y, eye[2] - z
    v = torch.rsqrt(vx * vx + vy * vy + vz * vz)
    h = 2 * v * (nx * vx + ny * vy + nz * vz)
    wx, wy, wz = h * nx - v * vx, h * ny - v * vy, h * nz - v * vz  # v mirrored at the normal
    channels = intensities.shape[1]
    diffuse: list[Any] = [0.0] * channels
    specular: list[Any] = [0.0] * channels
    for j in range(len(positions)):
        dx, dy, dz = positions[j, 0] - x, positions[j, 1] - y, positions[j, 2] - z
        square = dx * dx + dy * dy + dz * dz
        reciprocal = torch.rsqrt(square)
        n_dot_l = (nx * dx + ny * dy + nz * dz) * reciprocal
        r_dot_v = (wx * dx + wy * dy + wz * dz) * reciprocal
        bright = (n_dot_l > 0) & (r_dot_v > TINY)
        power = torch.exp2(n * torch.log2(torch.where(bright, r_dot_v, 1)))
        lobe = torch.where(bright, power, 0)
        lit = n_dot_l.clamp_min(0)
        if attenuated:
            f = (1 / (c0 + c1 * (square * reciprocal) + c2 * square)).clamp_max(1)
            lit, lobe = f * lit, f * lobe
        for c in range(channels):
            diffuse[c] = diffuse[c] + intensities[j, c] * lit
            specular[c] = specular[c] + intensities[j, c] * lobe
    return [
        ambient * ka[c] + kd[c] * diffuse[c % channels] + ks[c] * specular[c % channels]
        for c in range(3)
    ]


def _arguments(
    points: np.ndarray, normals: np.ndarray, eye: np.ndarray, scene: dict[str, Any]
) -> tuple[Any, ...]:
    """Those of `_shade`."""
    torch.set_num_threads(threads())

    def planes(values: np.ndarray) -> tuple[Tensor, ...]:
        return tuple(tensor(plane) for plane in values)

    def tensor(values: Any) -> Tensor:
        return torch.from_numpy(np.array(values, np.float32))

    count = len(scene["positions"])
    constants = (1.0, 0.0, 0.0) if scene["constants"] is None else scene["constants"]
    return (
        planes(points),
        planes(normals),
        tensor(eye),
        tensor(scene["positions"]),
        tensor(scene["intensities"]).reshape(count, -1),
        tensor(scene["ambient"]),
        tensor([*scene["ka"], *scene["kd"], *scene["ks"], scene["shininess"], *constants]),
        scene["constants"] is not None,
    )


def forward(
    points: np.ndarray, normals: np.ndarray, eye: np.ndarray, scene: dict[str, Any]
) -> Callable[[], list[Tensor]]:
    """A call shades once and returns the image's planes."""
    arguments = _arguments(points, normals, eye, scene)
    shade = torch.compile(_shade, dynamic=False, fullgraph=True, options=OPTIONS)

    def run() -> list[Tensor]:
        with torch.no_grad():
            return shade(*arguments)

    return run


def gradient(
    points: np.ndarray,
    normals: np.ndarray,
    eye: np.ndarray,
    scene: dict[str, Any],
    target: np.ndarray,
) -> Callable[[], tuple[float, np.ndarray]]:
    """A call returns the loss and its gradient [13] in ka, kd, ks, n, c0, c1 and c2."""
    *fixed, coefficients, attenuated = _arguments(points, normals, eye, scene)
    wanted = tuple(torch.from_numpy(np.array(plane, np.float32)) for plane in target)

    pixels, many = points.shape[1], len(scene["positions"]) >= MANY

    def loss(unknown: Tensor, fixed: list[Any], wanted: tuple[Tensor, ...]) -> Tensor:
        if many:
            unknown = unknown[:, None].expand(-1, pixels)
        image = _shade(*fixed, unknown, attenuated)
        return sum(((a - b) ** 2).sum() for a, b in zip(image, wanted, strict=True)) / (3 * pixels)

    step = torch.compile(
        torch.func.grad_and_value(loss), dynamic=False, fullgraph=True, options=OPTIONS
    )

    def run() -> tuple[float, np.ndarray]:
        with torch.no_grad():
            slope, value = step(coefficients, fixed, wanted)
        return value.item(), slope.numpy()

    return run
