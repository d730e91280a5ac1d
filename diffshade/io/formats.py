"""The formats that can be read: recognised by content, never by name, each read by its module."""

import logging
from dataclasses import replace
from enum import Enum
from pathlib import Path

from diffshade.errors import BadInput
from diffshade.io import exr, jpeg, png, radiance, raw, tiff
from diffshade.io.contents import read_bytes
from diffshade.io.decoded import Decoded
from diffshade.io.exif import Shot, shot_in_tiff

__all__ = ["Format", "decode_file", "identify"]

# What it warns of is in the refusal; where nobody asked for logs, none are on standard error.
logging.getLogger("imagecodecs").addHandler(logging.NullHandler())


class Format(Enum):
    """The formats that can be read."""

    PNG = "PNG"
    JPEG = "JPEG"
    TIFF = "TIFF"
    HDR = "Radiance HDR"
    EXR = "OpenEXR"
    RAW = "camera RAW"


_READABLE = (
    (0, png.SIGNATURE, Format.PNG),
    (0, b"\xff\xd8\xff", Format.JPEG),
    (0, exr.SIGNATURE, Format.EXR),
    (0, b"#?", Format.HDR),
    *((offset, magic, Format.RAW) for offset, magic in raw.SIGNATURES),
    *((0, magic, Format.TIFF) for magic in tiff.SIGNATURES),
)
_REFUSED = (
    (0, b"GIF8", "a GIF"),
    (0, b"BM", "a BMP"),
    (8, b"WEBP", "a WebP image"),
    (4, b"ftyphei", "a HEIF image"),
    (4, b"ftypmif1", "a HEIF image"),
    (4, b"ftypavif", "an AVIF image"),
    (0, b"\x00\x00\x00\x0cjP  ", "a JPEG 2000 image"),
    (0, b"\xff\x0a", "a JPEG XL image"),
    (0, b"\x00\x00\x00\x0cJXL ", "a JPEG XL image"),
    (0, b"8BPS", "a Photoshop document"),
    (0, b"\x93NUMPY", "a NumPy array"),
    (0, b"%PDF", "a PDF"),
)


def decode_file(path: Path, layer: str | None = None) -> tuple[Format, Decoded]:
    """What an image file holds; raises `BadInput` that begins with its name where it does not."""
    data = read_bytes(path)
    if not data:
        raise BadInput(f"{path}: the file is empty; copy or export it again")
    kind = "file"
    try:
        form = identify(data)
        kind = form.value
        if layer is not None and form is not Format.EXR:
            raise BadInput(f"is {kind}, which has no layer {layer!r}; leave layer out")
        return form, _read_format(form, data, path, layer)
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from None
    except ImportError:
        raise
    # Each library raises types of its own for a damaged file.
    except Exception as error:
        detail = str(error) or type(error).__name__
        raise BadInput(f"{path}: damaged {kind} ({detail}); copy or export it again") from None


def identify(data: bytes) -> Format:
    """The format of the file with this content.

    Raises `BadInput`, without the name of the file, where it cannot be read as an image.
    """
    for offset, magic, form in _READABLE:
        if data.startswith(magic, offset):
            is_raw = form is Format.TIFF and tiff.is_camera_raw(data)
            return Format.RAW if is_raw else form
    kind = next((kind for at, magic, kind in _REFUSED if data.startswith(magic, at)), None)
    found = f"is {kind}" if kind else f"is not an image (it starts with {data[:12]!r})"
    raise BadInput(f"{found}; give {', '.join(form.value for form in Format)}")


def _read_format(form: Format, data: bytes, path: Path, layer: str | None) -> Decoded:
    match form:
        case Format.PNG:
            return png.read(data)
        case Format.JPEG:
            return jpeg.read(data)
        case Format.TIFF:
            return replace(tiff.read(data), shot=shot_in_tiff(data))
        case Format.HDR:
            return radiance.read(data)
        case Format.EXR:
            return exr.read(path, layer)
        case Format.RAW:
            # White balance is not applied there
            return replace(raw.read(path), shot=_unbalanced(shot_in_tiff(data)))


def _unbalanced(shot: Shot | None) -> Shot | None:
    return None if shot is None else shot._replace(automatic_white=False)
