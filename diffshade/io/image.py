"""Images from files and into files.

Row 0 is the top. Values of integer files are scaled by the full scale of the encoding, never by
the file's own maximum, so that all images of one camera keep one scale; values of floating-point
files are untouched. No transfer function is applied on reading: `Image.encoding` says what the
file declares, and `diffshade.io.encoding.decode` makes linear what the user declares.
"""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from diffshade.errors import BadInput
from diffshade.io import exr, png
from diffshade.io.atomic import replacing
from diffshade.io.decoded import Mask, Pixels, Plane, with_channels
from diffshade.io.encoding import Encoding, encode_srgb
from diffshade.io.exif import Shot
from diffshade.io.formats import Format, decode_file

__all__ = [
    "Encoding",
    "Format",
    "Image",
    "read_image",
    "read_mask",
    "write_exr",
    "write_image",
    "write_npy",
    "write_png",
]

AnyPath = str | os.PathLike[str]


@dataclass(frozen=True, eq=False)
class Image:
    """An image as its file holds it, scaled."""

    values: Pixels
    """[H, W, C], C = 1 grey or 3 RGB; float32, or float64 from 32-bit integers and float64."""
    alpha: Plane | None
    """Opacity in [0, 1]; None where absent or 1 everywhere. Colour is as stored: not multiplied
    by alpha in PNG, multiplied in OpenEXR."""
    encoding: Encoding
    """What the file says about its values; nothing has been decoded."""
    full_scale: float | None
    """The value of a saturated sample: 1 for integer files, None (unknown) for floating point."""
    bits: int
    """Bits a sample, of the sensor for camera RAW, of the mantissa for Radiance HDR."""
    format: Format
    """The format, found from the content."""
    shot: Shot | None = None
    """Exposure and white balance, where the file says them: JPEG, TIFF, and RAW in the form of TIFF."""


def read_image(path: AnyPath, *, layer: str | None = None, allow_nonfinite: bool = False) -> Image:
    """Read PNG, JPEG, TIFF, Radiance HDR, OpenEXR or camera RAW.

    `layer` names the layer of an OpenEXR file; without it the one with no name is read. Rows stand
    as stored, orientation flags are not applied. Raises `BadInput`, in one line, for what is not
    there, not an image, damaged, or holds NaN or infinity (unless `allow_nonfinite`).

    >>> image = read_image("001.png")
    >>> clipped = (image.values >= 0.98 * image.full_scale).any(-1)
    """
    path = Path(path)
    form, decoded = decode_file(path, layer)
    values, alpha = decoded.scaled()
    if not allow_nonfinite:
        _refuse_nonfinite(path, values, "mend the file, or pass allow_nonfinite=True")
    full_scale = None if decoded.full_code is None else 1.0
    return Image(values, alpha, decoded.encoding, full_scale, decoded.bits, form, decoded.shot)


def read_mask(path: AnyPath) -> Mask:
    """True where any channel is at or above half of full scale (0.5 in a floating-point file).

    Half, not above 0, because a JPEG or a smoothed edge leaves small values outside. Where the
    file has alpha, that has to reach half too. Raises `BadInput` as `read_image`, and for a mask
    in which nothing is set.

    >>> inside = read_image("001.png").values[read_mask("mask.png")]
    """
    image = read_image(path)
    mask: Mask = np.max(image.values, axis=-1) >= 0.5
    if image.alpha is not None:
        mask &= image.alpha >= 0.5
    if not mask.any():
        raise BadInput(
            f"{path}: the mask is empty, no pixel reaches half of full scale (the largest is "
            f"{image.values.max():.3g} of 1); write what is inside as white"
        )
    return mask


def write_png(
    path: AnyPath,
    display_values: ArrayLike,
    *,
    bits: int = 8,
    encoding: Encoding = Encoding.DISPLAY,
) -> None:
    """Write values in [0, 1], [H, W], [H, W, 1] or [H, W, 3], to the nearest of 8 or 16 bits.

    `encoding` is what the file says about them (sRGB chunk, gAMA 1, or nothing); they are not
    converted. True and False are 1 and 0. Raises `BadInput` outside [0, 1]; atomic.

    >>> write_png("mask.png", mask, encoding=Encoding.UNKNOWN)
    """
    if bits not in (8, 16):
        raise BadInput(f"bits is {bits}: a PNG is written with 8 or 16")
    values = _pixels(path, display_values).astype(np.float64)
    _refuse_nonfinite(path, values, "mend what made them")
    if not np.all((values >= 0) & (values <= 1)):
        raise BadInput(
            f"{path}: values from {values.min():.4g} to {values.max():.4g}; "
            "clip or scale them to [0, 1]"
        )
    codes = np.rint(values * (2**bits - 1)).astype(np.uint8 if bits == 8 else np.uint16)
    with replacing(path) as temporary:
        temporary.write_bytes(png.write(codes, encoding))


def write_exr(path: AnyPath, linear: ArrayLike) -> None:
    """Write linear values, [H, W], [H, W, 1] or [H, W, 3], as float32 Y or R, G, B; atomic.

    >>> write_exr("render.exr", image)
    """
    values = _pixels(path, linear)
    with replacing(path) as temporary:
        exr.write(temporary, values)


def write_npy(path: AnyPath, array: ArrayLike) -> None:
    """Write an array of numbers of any shape, type and values unchanged; atomic.

    >>> write_npy("render.npy", image)
    """
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.save(file, np.asarray(array), allow_pickle=False)


def write_image(path: AnyPath, linear: ArrayLike) -> None:
    """Write linear values to `.png` (clipped to [0, 1], sRGB, 8 bits), `.exr` or `.npy` (as is).

    Raises `BadInput` for another ending, and for NaN in a `.png`.

    >>> write_image("render.png", image)
    """
    match Path(path).suffix.lower():
        case ".png":
            # In float64, so that a value halfway between two codes is rounded once.
            values = _pixels(path, linear).astype(np.float64)
            write_png(path, encode_srgb(np.clip(values, 0, 1)))
        case ".exr":
            write_exr(path, linear)
        case ".npy":
            write_npy(path, linear)
        case suffix:
            given = f"the ending {suffix}" if suffix else "no ending"
            raise BadInput(f"{path}: {given} names no format to write; give .png, .exr or .npy")


def _refuse_nonfinite(path: AnyPath, values: Pixels, remedy: str) -> None:
    bad = values.size - int(np.count_nonzero(np.isfinite(values)))
    if bad:
        raise BadInput(f"{path}: {bad} of {values.size} values are NaN or infinite; {remedy}")


def _pixels(path: AnyPath, values: ArrayLike) -> Pixels:
    """Values to write, as [H, W, C]."""
    array = np.asarray(values)
    if array.ndim not in (2, 3) or (array.ndim == 3 and array.shape[-1] not in (1, 3)):
        raise BadInput(
            f"{path}: values of shape {array.shape}; give [H, W], [H, W, 1] or [H, W, 3]"
        )
    if not (np.issubdtype(array.dtype, np.floating) or array.dtype == np.bool_):
        raise BadInput(
            f"{path}: values of type {array.dtype}; scale them to floating point, full scale 1"
        )
    return with_channels(array)
