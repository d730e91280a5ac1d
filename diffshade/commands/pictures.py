"""The pictures of a fit: every photograph beside its prediction and what is between them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from diffshade import plot

if TYPE_CHECKING:
    from diffshade.io.capture import Capture
    from diffshade.reflectance.material import Material
    from diffshade.scene import Scene

__all__ = ["earlier_pictures", "write_pictures"]

FEW = 6
"""Images that get a file each; more go on one sheet, reduced."""
THUMBNAIL = 200
"""The largest side of an image on the sheet, in pixels: larger ones are reduced."""
LEGIBLE = 320
"""The height to which a small comparison of its own is enlarged, as far as whole factors go."""


def earlier_pictures(folder: Path) -> list[Path]:
    """The pictures in a folder that an earlier fit has written, by their names."""
    return [p for p in folder.iterdir() if re.fullmatch(r"comparison(_\d+)?\.png", p.name)]


def write_pictures(
    folder: Path, capture: Capture, material: Material, scenes: tuple[Scene, ...]
) -> str:
    """Write the comparisons as PNG files; returns what is to be known to read them."""
    from diffshade.io.image import write_png
    from diffshade.shading.render import render

    observed = [np.nan_to_num(o, nan=0, posinf=0, neginf=0) for o in capture.images]
    predicted = [np.asarray(render(capture.gbuffer, scene, material)) for scene in scenes]
    exposure = plot.exposure(observed, capture.valid)
    residuals = [o - p for o, p in zip(observed, predicted, strict=True)]
    scale = plot.residual_scale(residuals, capture.valid)
    foreground = capture.gbuffer.mask
    factor = -(-max(foreground.shape) // THUMBNAIL) if len(observed) > FEW else 1
    comparisons = [
        plot.comparison(
            plot.reduced(image, factor),
            plot.reduced(prediction, factor),
            plot.reduced(foreground[..., None], factor)[..., 0] >= 0.5,
            plot.reduced(valid[..., None], factor)[..., 0] >= 0.5,
            exposure=exposure,
            scale=scale,
        )
        for image, prediction, valid in zip(observed, predicted, capture.valid, strict=True)
    ]
    if len(observed) > FEW:
        write_png(folder / "comparison.png", plot.contact_sheet(comparisons))
        files = "comparison.png, in reading order"
    else:
        for k, picture in enumerate(comparisons, 1):
            larger = plot.enlarged(picture, max(1, LEGIBLE // len(picture)))
            write_png(folder / f"comparison_{k}.png", larger)
        files = "comparison_1.png and so on, in the order of the images"
    return (
        f"pictures: observed | predicted | residual, {files}\n"
        f"  observed and predicted: linear x {exposure:g}, then sRGB\n"
        f"  residual: observed - predicted of the channel where it is largest, red above 0, blue"
        f" below;\n    the ends of the colour bar are +/- {scale:g}\n"
        "  grey stripes: left out of the fit (clipped, not finite); dark grey: not the object"
    )
