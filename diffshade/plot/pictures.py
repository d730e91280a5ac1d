"""Photographs beside predictions, as pictures: pure functions from arrays to arrays for display.

Display arrays are [H, W, 3], sRGB-encoded in [0, 1], for `write_png` or a notebook. A comparison has
three panels, observed | predicted | residual, and a bar with the colours of the residual:

- observed and predicted at one exposure, so that they can be compared; brighter than white is white.
- residual = observed - predicted, of the channel where it is largest: red where the photograph is
  brighter, blue where it is darker, white at 0; at the ends of the bar, +scale (top) and -scale.
- Grey stripes mark what was left out of the fit (clipped, not finite); flat dark grey is no object.

A map of what was left out has one colour for what was used and one for each reason.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from diffshade.io.encoding import encode_srgb

__all__ = [
    "comparison",
    "contact_sheet",
    "diverging",
    "enlarged",
    "exposure",
    "left_out",
    "panels",
    "reduced",
    "residual_scale",
    "tone",
]

Pixels = Float[np.ndarray, "H W C"]
Plane = Float[np.ndarray, "H W"]
Mask = Bool[np.ndarray, "H W"]
Display = Float[np.ndarray, "H W 3"]

BACKGROUND = 0.16
STRIPES = (0.38, 0.62)
GAP = 6
BAR = 8
USED = 0.82
REASONS = {
    "clipped": (0.90, 0.60, 0.00),
    "not finite or not opaque": (0.80, 0.35, 0.65),
    "given no weight": (0.00, 0.45, 0.70),
}
"""The colours of what was left out, by reason; of Okabe and Ito's, told apart by everybody."""
# From -1 to 1, in display values; as readable with red-green blindness, and printed in grey.
COLOURS = np.array(
    [
        (0.02, 0.19, 0.55),
        (0.18, 0.47, 0.86),
        (0.62, 0.80, 0.95),
        (0.97, 0.97, 0.97),
        (0.98, 0.73, 0.60),
        (0.85, 0.32, 0.22),
        (0.52, 0.03, 0.09),
    ]
)


def exposure(images: Sequence[Pixels], used: Sequence[Mask]) -> float:
    """The factor that brings all but the brightest half percent of used pixels below white."""
    brightest = [image[m].max(axis=-1) for image, m in zip(images, used, strict=True)]
    white = float(np.quantile(np.concatenate(brightest), 0.995)) if any(map(len, brightest)) else 0
    return _two_digits(1 / white) if white > 0 else 1.0


def residual_scale(residuals: Sequence[Pixels], used: Sequence[Mask]) -> float:
    """The residual at the ends of the colour bar: all but one percent of used pixels are below."""
    largest = [np.abs(r[m]).max(axis=-1) for r, m in zip(residuals, used, strict=True)]
    level = float(np.quantile(np.concatenate(largest), 0.99)) if any(map(len, largest)) else 0
    return _two_digits(level) if level > 0 else 1.0


def tone(linear: Pixels, exposure: float = 1.0) -> Display:
    """Linear radiance for display: grey for one channel, RGB for three, else the channels' mean."""
    light = linear if linear.shape[-1] in (1, 3) else linear.mean(axis=-1, keepdims=True)
    exposed = np.nan_to_num(light.astype(np.float64) * exposure, nan=0.0)
    shown = encode_srgb(np.clip(exposed, 0, 1))
    return np.broadcast_to(shown, (*shown.shape[:2], 3)).copy()


def diverging(signed: Plane, scale: float) -> Display:
    """Blue below 0, white at 0, red above; values beyond -scale and scale have the last colour."""
    at = np.linspace(-1, 1, len(COLOURS))
    place = np.nan_to_num(signed / scale, nan=0.0)
    return np.stack([np.interp(place, at, channel) for channel in COLOURS.T], axis=-1)


def comparison(
    observed: Pixels,
    predicted: Pixels,
    foreground: Mask,
    used: Mask,
    *,
    exposure: float,
    scale: float,
) -> Display:
    """observed | predicted | residual, cropped to the object; see the top of this module."""
    observed, predicted, difference = panels(
        observed, predicted, foreground, used, exposure=exposure, scale=scale
    )
    height = len(observed)
    bar = diverging(np.repeat(np.linspace(1, -1, height)[:, None], BAR, axis=1), 1.0)
    gap = np.full((height, GAP, 3), BACKGROUND)
    return np.hstack([observed, gap, predicted, gap, difference, gap, bar])


def panels(
    observed: Pixels,
    predicted: Pixels,
    foreground: Mask,
    used: Mask,
    *,
    exposure: float,
    scale: float,
) -> tuple[Display, Display, Display]:
    """The observed, the predicted and the residual image, cropped to the object."""
    window = _around(foreground)
    observed, predicted, foreground, used = (
        array[window] for array in (observed, predicted, foreground, used)
    )
    residual = np.where(used[..., None], observed - predicted, 0)
    largest = np.argmax(np.abs(residual), axis=-1)[..., None]
    signed = np.take_along_axis(residual, largest, axis=-1)[..., 0]
    differences = np.where(used[..., None], diverging(signed, scale), _stripes(used.shape))
    inside = foreground[..., None]
    return (
        tone(observed, exposure),
        np.where(inside, tone(predicted, exposure), BACKGROUND),
        np.where(inside, differences, BACKGROUND),
    )


def left_out(foreground: Mask, reasons: Mapping[str, Mask]) -> Display:
    """Which pixels had no say, cropped as `panels`: the colour of the last of `REASONS` that is true.

    Pixels that were used are light grey, those of the background dark grey.
    """
    display = np.where(foreground[..., None], USED, BACKGROUND) * np.ones(3)
    for reason, colour in REASONS.items():
        if reason in reasons:
            display[reasons[reason]] = colour
    return display[_around(foreground)]


def contact_sheet(pictures: Sequence[Display], *, columns: int = 2) -> Display:
    """Pictures of one size in rows, in reading order."""
    height, width = pictures[0].shape[:2]
    gap = 4 * GAP
    rows = -(-len(pictures) // columns)
    shape = (rows * (height + gap) + gap, columns * (width + gap) + gap, 3)
    sheet = np.full(shape, BACKGROUND)
    for k, picture in enumerate(pictures):
        y, x = (k // columns) * (height + gap) + gap, (k % columns) * (width + gap) + gap
        sheet[y : y + height, x : x + width] = picture
    return sheet


def reduced(image: Pixels, factor: int) -> Pixels:
    """The means of blocks of factor x factor pixels; what is over at the right and bottom is cut."""
    height, width = (n // factor * factor for n in image.shape[:2])
    blocks = image[:height, :width].reshape(height // factor, factor, width // factor, factor, -1)
    return blocks.mean(axis=(1, 3))


def enlarged(picture: Display, factor: int) -> Display:
    """Each pixel as a square of factor x factor pixels."""
    return picture.repeat(factor, axis=0).repeat(factor, axis=1)


def _around(mask: Mask, margin: int = 3) -> tuple[slice, slice]:
    """The rows and columns of a mask, with a margin; all where it is empty."""
    spans = []
    for axis in (1, 0):
        inside = np.flatnonzero(mask.any(axis=axis))
        ends = (inside[0] - margin, inside[-1] + 1 + margin) if inside.size else (0, None)
        spans.append(slice(max(0, ends[0]), ends[1]))
    return spans[0], spans[1]


def _stripes(shape: tuple[int, int]) -> Display:
    row, column = np.indices(shape)
    return np.where((row + column)[..., None] // 2 % 2, *STRIPES) * np.ones(3)


def _two_digits(value: float) -> float:
    return round(value, 1 - math.floor(math.log10(value)))
