"""The pictures of a fit: every photograph beside its prediction and what is between them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from diffshade.plot import pictures as plot

if TYPE_CHECKING:
    from diffshade.io.capture import Capture
    from diffshade.reflectance.material import Material
    from diffshade.scene import Scene
    from fitting.report_html_images import ImagePanels, Pictures

__all__ = ["Compared", "compare", "earlier_pictures", "page_pictures", "write_pictures"]

FEW = 6
"""Images that get a file each; more go on one sheet, reduced."""
THUMBNAIL = 200
"""The largest side of an image on the sheet, in pixels: larger ones are reduced."""
LEGIBLE = 320
"""The height to which a small comparison of its own is enlarged, as far as whole factors go."""
PAGE = 1_000_000
"""Pixels of all images together on the page, about: a few megabytes of a file."""
LEAST_SIDE = 48
"""The side to which many images are reduced at the most."""


@dataclass(frozen=True, eq=False)
class Compared:
    """A capture and what a material predicts for it, finite everywhere, [H, W, C] an image.

    `exposure` and `scale` are those of `plot`, one for all images.
    """

    capture: Capture
    observed: tuple[np.ndarray, ...]
    predicted: tuple[np.ndarray, ...]
    exposure: float
    scale: float

    @property
    def foreground(self) -> np.ndarray:
        return np.asarray(self.capture.gbuffer.mask)


def compare(capture: Capture, material: Material, scenes: tuple[Scene, ...]) -> Compared:
    """Render what the material looks like in every image of the capture."""
    from diffshade.shading.render import render

    observed = tuple(np.nan_to_num(o, nan=0, posinf=0, neginf=0) for o in capture.images)
    predicted = tuple(np.asarray(render(capture.gbuffer, scene, material)) for scene in scenes)
    residuals = [o - p for o, p in zip(observed, predicted, strict=True)]
    return Compared(
        capture=capture,
        observed=observed,
        predicted=predicted,
        exposure=plot.exposure(observed, capture.valid),
        scale=plot.residual_scale(residuals, capture.valid),
    )


def earlier_pictures(folder: Path) -> list[Path]:
    """The pictures in a folder that an earlier fit has written, by their names."""
    return [p for p in folder.iterdir() if re.fullmatch(r"comparison(_\d+)?\.png", p.name)]


def write_pictures(folder: Path, compared: Compared) -> tuple[tuple[str, ...], str]:
    """Write the comparisons as PNG files; returns their names, and what is to be known to read them."""
    from diffshade.io.image import write_png

    count = len(compared.observed)
    factor = -(-max(compared.foreground.shape) // THUMBNAIL) if count > FEW else 1
    exposure, scale = compared.exposure, compared.scale
    comparisons = [
        plot.comparison(*_reduced(compared, k, factor), exposure=exposure, scale=scale)
        for k in range(count)
    ]
    names: tuple[str, ...] = ("comparison.png",)
    if count > FEW:
        write_png(folder / names[0], plot.contact_sheet(comparisons))
        files = "comparison.png, in reading order"
    else:
        names = tuple(f"comparison_{k}.png" for k in range(1, count + 1))
        for name, picture in zip(names, comparisons, strict=True):
            write_png(folder / name, plot.enlarged(picture, max(1, LEGIBLE // len(picture))))
        files = "comparison_1.png and so on, in the order of the images"
    legend = (
        f"pictures: observed | predicted | residual, {files}\n"
        f"  observed and predicted: linear x {exposure:g}, then sRGB\n"
        f"  residual: observed - predicted of the channel where it is largest, red above 0, blue"
        f" below;\n    the ends of the colour bar are +/- {scale:g}\n"
        "  grey stripes: left out of the fit (clipped, not finite); dark grey: not the object"
    )
    return names, legend


def page_pictures(compared: Compared, no_weight: Sequence[np.ndarray] | None = None) -> Pictures:
    """The pictures of the page, reduced so that the page stays small however many there are.

    `no_weight` are masks [H, W], one an image, of pixels that a robust fit gave no weight.
    """
    from fitting.report_html_images import Pictures

    count = len(compared.observed)
    side = max(LEAST_SIDE, sqrt(PAGE / count))
    factor = max(1, round(sqrt(_cropped_size(compared.foreground)) / side))
    shown = [r for r in plot.REASONS if no_weight is not None or r != "given no weight"]
    colours = {"used": (plot.USED,) * 3} | {reason: plot.REASONS[reason] for reason in shown}
    colours["background"] = (plot.BACKGROUND,) * 3
    return Pictures(
        panels=tuple(
            _panels(compared, k, factor, None if no_weight is None else no_weight[k])
            for k in range(count)
        ),
        exposure=compared.exposure,
        scale=compared.scale,
        residual_colours=tuple(_css(colour) for colour in plot.COLOURS),
        reasons={reason: _css(colour) for reason, colour in colours.items()},
    )


def _panels(compared: Compared, k: int, factor: int, no_weight: np.ndarray | None) -> ImagePanels:
    from fitting.report_html_images import ImagePanels

    capture, foreground = compared.capture, compared.foreground
    reasons = {
        "clipped": capture.clipped[k],
        "not finite or not opaque": foreground & ~capture.valid[k] & ~capture.clipped[k],
    }
    if no_weight is not None:
        reasons["given no weight"] = no_weight & capture.valid[k]
    reduced = _reduced(compared, k, factor)
    panels = plot.panels(*reduced, exposure=compared.exposure, scale=compared.scale)
    # A single pixel that was left out is still seen.
    any_of = {why: plot.reduced(m[..., None], factor)[..., 0] > 0 for why, m in reasons.items()}
    return ImagePanels(*map(_png, (*panels, plot.left_out(reduced[2], any_of))))


def _reduced(
    compared: Compared, k: int, factor: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Observed, predicted, foreground and used pixels of one image, in blocks of factor x factor."""
    masks = (compared.foreground, compared.capture.valid[k])
    foreground, used = (plot.reduced(m[..., None], factor)[..., 0] >= 0.5 for m in masks)
    observed, predicted = (
        plot.reduced(image, factor) for image in (compared.observed[k], compared.predicted[k])
    )
    return observed, predicted, foreground, used


def _cropped_size(mask: np.ndarray) -> int:
    """The area of the rectangle around a mask."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return int(np.ptp(rows) + 1) * int(np.ptp(columns) + 1) if rows.size else mask.size


def _png(display: np.ndarray) -> bytes:
    from diffshade.io import png
    from diffshade.io.encoding import Encoding

    return png.write(np.rint(display * 255).astype(np.uint8), Encoding.DISPLAY)


def _css(colour: Sequence[float]) -> str:
    red, green, blue = (round(255 * value) for value in colour)
    return f"#{red:02x}{green:02x}{blue:02x}"
