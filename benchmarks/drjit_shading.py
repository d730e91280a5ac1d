"""The rival in Dr.Jit: the same shading on planes, compiled by LLVM for the processor's vectors.

Lights and coefficients are opaque, so that other values need no new compilation, and what Python
traces is frozen, so that only the first call traces. Where LLVM's library is not found by itself, the
environment variable DRJIT_LIBLLVM_PATH names it.
"""

from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np
from drjit.llvm.ad import Array3f, Float

from benchmarks.rivals import threads

__all__ = ["forward", "gradient"]

TINY = 1e-30
"""Below it, r.v counts as zero: a logarithm is taken of it."""


def _shade(
    points: Array3f,
    normals: Array3f,
    eye: Array3f,
    positions: list[Array3f],
    intensities: list[list[Float]],
    ambient: Float,
    coefficients: list[Float],
    attenuated: bool,
) -> Array3f:
    """The image's three planes."""
    ka, kd, ks = coefficients[:3], coefficients[3:6], coefficients[6:9]
    n, c0, c1, c2 = coefficients[9:]
    v = eye - points
    v *= dr.rsqrt(dr.squared_norm(v))
    w = 2 * dr.dot(normals, v) * normals - v  # v mirrored at the normal
    channels = len(intensities[0])
    diffuse, specular = [Float(0)] * channels, [Float(0)] * channels
    for position, intensity in zip(positions, intensities, strict=True):
        s = position - points
        square = dr.squared_norm(s)
        reciprocal = dr.rsqrt(square)
        n_dot_l = dr.dot(normals, s) * reciprocal
        r_dot_v = dr.dot(w, s) * reciprocal
        bright = (n_dot_l > 0) & (r_dot_v > TINY)
        lobe = dr.select(bright, dr.exp2(n * dr.log2(dr.select(bright, r_dot_v, 1))), 0)
        lit = dr.maximum(n_dot_l, 0)
        if attenuated:
            f = dr.minimum(dr.rcp(c0 + c1 * (square * reciprocal) + c2 * square), 1)
            lit, lobe = f * lit, f * lobe
        for c in range(channels):
            diffuse[c] = dr.fma(intensity[c], lit, diffuse[c])
            specular[c] = dr.fma(intensity[c], lobe, specular[c])
    return Array3f(
        *(
            ambient * ka[c] + kd[c] * diffuse[c % channels] + ks[c] * specular[c % channels]
            for c in range(3)
        )
    )


def _arguments(
    points: np.ndarray, normals: np.ndarray, eye: np.ndarray, scene: dict[str, Any]
) -> tuple[Any, ...]:
    """Those of `_shade`."""
    dr.set_thread_count(threads())
    intensities = np.asarray(scene["intensities"]).reshape(len(scene["positions"]), -1)
    constants = (1.0, 0.0, 0.0) if scene["constants"] is None else scene["constants"]
    coefficients = *scene["ka"], *scene["kd"], *scene["ks"], scene["shininess"], *constants
    return (
        _planes(points),
        _planes(normals),
        Array3f(*_scalars(eye)),
        [Array3f(*_scalars(position)) for position in scene["positions"]],
        [_scalars(intensity) for intensity in intensities],
        *_scalars([scene["ambient"]]),
        _scalars(coefficients),
        scene["constants"] is not None,
    )


def _planes(values: np.ndarray) -> Array3f:
    planes = Array3f(*(Float(np.array(plane, np.float32)) for plane in values))
    dr.eval(planes)
    return planes


def _scalars(values: Any) -> list[Float]:
    return [dr.opaque(Float, float(value)) for value in values]


def forward(
    points: np.ndarray, normals: np.ndarray, eye: np.ndarray, scene: dict[str, Any]
) -> Callable[[], Array3f]:
    """A call shades once and returns the image's planes."""
    arguments = _arguments(points, normals, eye, scene)
    shade = dr.freeze(_shade)

    def run() -> Array3f:
        image = shade(*arguments)
        dr.eval(image)
        dr.sync_thread()
        return image

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
    wanted = _planes(target)

    @dr.freeze
    def step(coefficients: list[Float], fixed: list[Any], wanted: Array3f) -> list[Float]:
        # Derivatives in planes of zeros added to the coefficients, summed once each in the kernel:
        # a scalar's own would be summed at each use, in a pass over memory each, twenty times slower.
        unknown = [dr.zeros(Float, points.shape[1]) for _ in coefficients]
        dr.enable_grad(unknown)
        moved = [a + b for a, b in zip(coefficients, unknown, strict=True)]
        squares = dr.squared_norm(_shade(*fixed, moved, attenuated) - wanted)
        dr.backward(squares)
        planes = [dr.detach(squares), *(dr.grad(x) for x in unknown)]
        return [dr.sum(plane, mode="symbolic") for plane in planes]

    def run() -> tuple[float, np.ndarray]:
        sums = step(coefficients, fixed, wanted)
        dr.eval(sums)
        dr.sync_thread()
        loss, *slope = (float(x[0]) / target.size for x in sums)
        return loss, np.array(slope)

    return run
