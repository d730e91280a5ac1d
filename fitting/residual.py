"""How well a material predicts photographs: one rule, for fits and for held-out images alike."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from diffshade.arrays import ArrayLike
from diffshade.geometry.gbuffer import GBuffer
from diffshade.progress import Progress, telling
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from diffshade.shading.render import render
from fitting.inputs import Photograph, match

__all__ = ["Evaluation", "ImageResidual", "evaluate", "evaluation", "measure", "ratio"]


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
    progress: Progress | None = None,
) -> Evaluation:
    """How well a material predicts images of known surfaces under known lights.

    The arguments are those of `fit`, and so are the errors raised. The norms run over all valid
    foreground pixels and all channels. `progress` is called after each image.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(16, 16, 2.2))
    >>> scene, material = ds.Scene(lights=ds.ParallelLight((0, 0, 1))), ds.Material(kd=0.6)
    >>> evaluate(material, ds.render(g, scene, material), g, scene).relative_residual
    0.0
    """
    return measure(material, match(images, gbuffer, scenes, valid), progress)


def evaluation(
    photographs: Sequence[Photograph],
    left: Float[np.ndarray, "K"],
    squares: Float[np.ndarray, "K"],
) -> Evaluation:
    """The figures from |observed - predicted|^2 and |observed|^2 of each photograph."""
    rows = []
    for photograph, cost, square in zip(photographs, left.tolist(), squares.tolist(), strict=True):
        used = photograph.unclipped_count
        rows.append(ImageResidual(ratio(cost, square), used, photograph.gbuffer.pixel_count - used))
    excluded = sum(row.pixels_excluded for row in rows)
    foreground = sum(row.pixels_used for row in rows) + excluded
    return Evaluation(
        ratio(float(left.sum()), float(squares.sum())), excluded / max(foreground, 1), tuple(rows)
    )


def measure(
    material: Material, photographs: Sequence[Photograph], progress: Progress | None = None
) -> Evaluation:
    """Render every photograph's scene with a material, and measure what differs."""
    left, squares = [], []
    for photograph in telling(photographs, len(photographs), progress):
        photograph.check()
        used = photograph.unclipped
        predicted = render(photograph.gbuffer, photograph.scene, material)
        observed = np.asarray(photograph.image, np.float64)[used]
        left.append(np.sum((observed - np.asarray(predicted, np.float64)[used]) ** 2))
        squares.append(np.sum(observed**2))
    return evaluation(photographs, np.array(left), np.array(squares))


def ratio(square: float, norm: float) -> float:
    """The relative residual, from |observed - predicted|^2 and |observed|^2."""
    if norm > 0:
        return (square / norm) ** 0.5
    return 0.0 if square == 0 else float("inf")
