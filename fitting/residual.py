"""How well a material predicts photographs: one rule, for fits and for held-out images alike."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diffshade.arrays import ArrayLike
from diffshade.geometry.gbuffer import GBuffer
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from diffshade.shading.render import render
from fitting.inputs import Photograph, match

__all__ = ["Evaluation", "ImageResidual", "evaluate", "measure"]


@dataclass(frozen=True)
class ImageResidual:
    """One photograph's share: |observed - predicted| / |observed| over its used pixels."""

    relative_residual: float
    pixels_used: int
    pixels_excluded: int


@dataclass(frozen=True)
class Evaluation:
    """|observed - predicted| / |observed|, unweighted, over all used pixels and channels.

    `fraction_excluded` is the share of foreground pixels that were left out (clipped, for one).
    """

    relative_residual: float
    fraction_excluded: float
    per_image: tuple[ImageResidual, ...]


def evaluate(
    material: Material,
    images: ArrayLike | Sequence[ArrayLike],
    gbuffer: GBuffer | Sequence[GBuffer],
    scenes: Scene | Sequence[Scene],
    *,
    valid: ArrayLike | Sequence[ArrayLike] | None = None,
) -> Evaluation:
    """How well a material predicts images of known surfaces under known lights.

    The arguments are those of `fit`, and so are the errors raised. The norms run over all valid
    foreground pixels and all channels.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(16, 16, 2.2))
    >>> scene, material = ds.Scene(lights=ds.ParallelLight((0, 0, 1))), ds.Material(kd=0.6)
    >>> evaluate(material, ds.render(g, scene, material), g, scene).relative_residual
    0.0
    """
    return measure(material, match(images, gbuffer, scenes, valid))


def measure(material: Material, photographs: Sequence[Photograph]) -> Evaluation:
    """Render every photograph's scene with a material, and measure what differs."""
    rows, squares, norms, foreground = [], 0.0, 0.0, 0
    for image, gbuffer, scene, valid in photographs:
        inside = gbuffer.mask
        used = inside & valid
        predicted = np.asarray(render(gbuffer, scene, material), np.float64)[used]
        observed = np.asarray(image, np.float64)[used]
        square = float(np.sum((observed - predicted) ** 2))
        norm = float(np.sum(observed**2))
        excluded = int((inside & ~used).sum())
        rows.append(ImageResidual(_ratio(square, norm), int(used.sum()), excluded))
        squares, norms, foreground = squares + square, norms + norm, foreground + int(inside.sum())
    left_out = sum(row.pixels_excluded for row in rows)
    return Evaluation(_ratio(squares, norms), left_out / max(foreground, 1), tuple(rows))


def _ratio(square: float, norm: float) -> float:
    if norm > 0:
        return (square / norm) ** 0.5
    return 0.0 if square == 0 else float("inf")
