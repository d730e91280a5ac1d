"""Photographs of one camera: read, of one size, and with a stated relation to light."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from diffshade.errors import BadInput
from diffshade.io import clipping
from diffshade.io.contents import within
from diffshade.io.encoding import Encoding, decode
from diffshade.io.exif import Shot, exposure_note, stated_note, white_balance_note
from diffshade.io.image import Image, read_image
from diffshade.progress import Progress, telling

__all__ = ["Photograph", "notes", "read_photographs", "size"]

Pixels = Float[np.ndarray, "H W C"]
Mask = Bool[np.ndarray, "H W"]


@dataclass(frozen=True, eq=False)
class Photograph:
    """One image file and what its values mean."""

    name: str
    path: Path
    encoded: Pixels
    """Values as encoded, full scale 1 where the file has one."""
    usable: Mask
    """Where all channels are finite and the pixel is opaque."""
    encoding: str | float
    """What `decode` is told: "linear", "srgb" or a gamma."""
    declared: Encoding
    """What the file says itself."""
    white: float | None
    """The encoded level at which the sensor clips; None where that is unknown."""
    shot: Shot | None = None
    """What it was taken with, where the file says so."""

    @property
    def clipped(self) -> Mask:
        """Pixels with any channel at or above 0.98 of full scale."""
        return clipping.clipped(self.encoded, self.white)

    def linear(self) -> Pixels:
        """Values proportional to radiance, in the file's precision."""
        return decode(self.encoded, self.encoding)


def read_photographs(
    folder: Path,
    names: Sequence[str],
    *,
    encoding: str | float | None = None,
    white: float | None = None,
    linear_by_convention: bool = False,
    allow_outside: bool = False,
    progress: Progress | None = None,
) -> list[Photograph]:
    """Read image files of equal size, named relative to a folder, and in it unless `allow_outside`.

    `encoding` ("linear", "srgb" or a gamma) overrides what the files say. Without it, files that
    say nothing are refused or, with `linear_by_convention`, linear; display-referred files are
    sRGB or, with it, refused. `white` is the level at which the sensor clips: a part of full scale,
    or a value in the units of a floating-point file. `progress` is called after each image. Raises
    `BadInput`.
    """
    if encoding is not None:
        decode(np.zeros(1), encoding)  # raises for what is not an encoding
    photographs: list[Photograph] = []
    for name in telling(names, len(names), progress):
        path = within(folder, name, allow_outside=allow_outside)
        image = read_image(path, allow_nonfinite=True)
        if photographs and image.values.shape != photographs[0].encoded.shape:
            raise BadInput(
                f"{path}: {size(image.values)} where {folder / names[0]} is"
                f" {size(photographs[0].encoded)}; all images of a capture must have one size"
            )
        usable = np.isfinite(image.values).all(axis=-1)
        photographs.append(
            Photograph(
                name=name,
                path=path,
                encoded=image.values,
                usable=usable if image.alpha is None else usable & (image.alpha == 1),
                encoding=_meaning(path, image.encoding, linear_by_convention)
                if encoding is None
                else encoding,
                declared=image.encoding,
                white=_white(path, image, white),
                shot=image.shot,
            )
        )
    return photographs


def size(image: np.ndarray) -> str:
    """The size of an image in words."""
    height, width = image.shape[:2]
    channels = f" of {image.shape[2]} channel{'s' * (image.shape[2] > 1)}" if image.ndim > 2 else ""
    return f"{width} x {height} pixels{channels}"


def notes(
    photographs: Sequence[Photograph],
    inside: Mask,
    exposures: Sequence[Float[np.ndarray, "*C"]] | None = None,
) -> tuple[str, ...]:
    """What a user should know of how the photographs were taken, one line each.

    `exposures` are those that were stated, and that the images are divided by.
    """
    shots = {p.name: p.shot for p in photographs if p.shot is not None}
    exposed: tuple[str | None, ...] = (exposure_note(shots),)
    if exposures is not None:
        # Of those by channel, which are a light's too, EXIF knows nothing.
        shared = all(e.ndim == 0 for e in exposures)
        pairs = zip(photographs, exposures, strict=True)
        stated = {p.name: float(e) for p, e in pairs} if shared else {}
        low, high = min(map(np.min, exposures)), max(map(np.max, exposures))
        said = f"of {low:.4g}" if low == high else f"from {low:.4g} to {high:.4g}"
        exposed = (
            None if low == high == 1 else f"images divided by stated exposures {said}",
            stated_note(shots, stated),
        )
    return tuple(
        note
        for note in (
            _encoding_note(photographs),
            _white_note(photographs),
            _plateau_note(photographs, inside),
            _unusable_note(photographs, inside),
            *exposed,
            white_balance_note(shots),
        )
        if note
    )


def _meaning(path: Path, declared: Encoding, linear_by_convention: bool) -> str:
    if declared is Encoding.LINEAR:
        return "linear"
    if declared is Encoding.DISPLAY and not linear_by_convention:
        return "srgb"
    if declared is Encoding.UNKNOWN and linear_by_convention:
        return "linear"
    if declared is Encoding.DISPLAY:
        raise BadInput(
            f"{path}: is display-referred by its own word, where this layout holds linear images;"
            " give --encoding srgb, a gamma, or linear if the file is wrong"
        )
    raise BadInput(
        f"{path}: does not say whether its values are linear or display-referred; give --encoding"
        ' (in a capture.toml: encoding = "linear", "srgb" or a gamma)'
    )


def _white(path: Path, image: Image, white: float | None) -> float | None:
    if white is None:
        return image.full_scale
    if not np.isfinite(white) or white <= 0 or (image.full_scale and white > image.full_scale):
        unit = "a part of full scale, above 0 and at most 1" if image.full_scale else "above 0"
        raise BadInput(f"{path}: --white {white:g} cannot be where it clips; give {unit}")
    return white


def _encoding_note(photographs: Sequence[Photograph]) -> str:
    used = ", ".join(dict.fromkeys(str(p.encoding) for p in photographs))
    overridden = {
        p.declared.value
        for p in photographs
        if (p.declared is Encoding.DISPLAY and p.encoding == "linear")
        or (p.declared is Encoding.LINEAR and p.encoding != "linear")
    }
    against = (
        f", against the files' own word ({', '.join(sorted(overridden))})" if overridden else ""
    )
    return f"images read as {used}{against}"


def _white_note(photographs: Sequence[Photograph]) -> str | None:
    unknown = [p.name for p in photographs if p.white is None]
    if not unknown:
        return None
    return (
        f"full scale of {_some(unknown)} is unknown (floating point), so no pixel there counts as"
        " clipped; give --white if the sensor clipped"
    )


def _plateau_note(photographs: Sequence[Photograph], inside: Mask) -> str | None:
    found = {
        p.name: stop
        for p in photographs
        if (stop := clipping.plateau(p.encoded, inside & p.usable, p.white))
    }
    if not found:
        return None
    level = min(stop.level for stop in found.values())
    most = max(stop.pixels for stop in found.values())
    return (
        f"plateau below full scale in {_some(list(found))}: up to {most} pixels share exactly the"
        f" image's maximum, the lowest at {level:.4g}; if the sensor clips there, give --white"
        f" {level:.4g}"
    )


def _unusable_note(photographs: Sequence[Photograph], inside: Mask) -> str | None:
    count = {p.name: int(np.count_nonzero(inside & ~p.usable)) for p in photographs}
    names = [name for name, pixels in count.items() if pixels]
    if not names:
        return None
    return f"{sum(count.values())} pixels of {_some(names)} are not finite or not opaque: left out"


def _some(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{len(names)} images ({names[0]}, ...)"
