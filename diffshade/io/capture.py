"""A capture: photographs of one object from one place, and what is known of how they were taken."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from diffshade.errors import BadInput
from diffshade.io import photographs as photography
from diffshade.io.photographs import Photograph

if TYPE_CHECKING:
    from diffshade.geometry.gbuffer import GBuffer
    from diffshade.light.attenuation import QuadraticAttenuation
    from diffshade.scene import Scene

__all__ = ["Capture", "assemble", "read_capture"]

Pixels = Float[np.ndarray, "H W C"]
Mask = Bool[np.ndarray, "H W"]
Colour = Float[np.ndarray, "C"]


@dataclass(frozen=True, eq=False)
class Capture:
    """Photographs as they are to be fitted, on the host, one entry an image."""

    names: tuple[str, ...]
    """The file of each image, as the capture names it."""
    images: tuple[Pixels, ...]
    """Linear radiance; in a photometric-stereo folder divided by the light's intensity."""
    valid: tuple[Mask, ...]
    """Pixels of the mask that are finite, opaque and not clipped: those that a fit may use."""
    clipped: tuple[Mask, ...]
    """Pixels of the mask with any channel at or above 0.98 of full scale as encoded."""
    gbuffer: GBuffer
    """The geometry; its foreground is the mask."""
    scenes: tuple[Scene, ...]
    """The light that each image was taken under."""
    fit_attenuation: type[QuadraticAttenuation] | None = None
    """The attenuation whose constants are to be fitted, one set for all lights; None: all known."""
    notes: tuple[str, ...] = ()
    """What was assumed or found on reading, one line each, for the user to see."""


def read_capture(
    path: str | os.PathLike[str],
    *,
    white: float | None = None,
    circle: tuple[float, float, float] | None = None,
    encoding: str | float | None = None,
) -> Capture:
    """Read a folder in the photometric-stereo layout, an RTI `.lp` file, a `capture.toml`, or the
    folder that holds one (which goes before the layout).

    `white` is the encoded level at which the sensor clips, as a part of full scale (in the units of
    a floating-point file). `circle` is the outline (cx, cy, radius) of a ball in pixels from the
    top left corner, where the first pixel's centre is (0.5, 0.5). `encoding` is "linear", "srgb"
    or a gamma, and goes before what the files say.

    Raises `BadInput`, in one line, for whatever cannot be used.

    >>> capture = read_capture("diligent_ball")
    >>> fit = fitting.fit(
    ...     capture.images, capture.gbuffer, capture.scenes, valid=capture.valid,
    ...     attenuation=capture.fit_attenuation,
    ... )
    """
    path = Path(path)
    if (path / "capture.toml").is_file():
        path = path / "capture.toml"
    if path.is_dir():
        from diffshade.io.photometric_stereo import FILES, read_photometric_stereo

        if not any((path / name).is_file() for name in FILES):
            raise BadInput(_no_capture_in(path, FILES))
        return read_photometric_stereo(path, white=white, circle=circle, encoding=encoding)
    if not path.exists():
        raise BadInput(f"{path}: there is no such file or folder; check the path")
    match path.suffix.lower():
        case ".lp":
            from diffshade.io.lp import read_lp

            return read_lp(path, white=white, circle=circle, encoding=encoding)
        case ".toml":
            from diffshade.io.capture_toml import read_capture_toml

            if circle is not None:
                raise BadInput(
                    f"{path}: a circle was given, but this file states its own geometry; leave out"
                    " --circle, or change geometry and camera there"
                )
            return read_capture_toml(path, white=white, encoding=encoding)
    raise BadInput(
        f"{path}: is not a capture; give a folder in the photometric-stereo layout, an .lp file or"
        " a capture.toml"
    )


def assemble(
    photographs: Sequence[Photograph],
    gbuffer: GBuffer,
    scenes: Sequence[Scene],
    *,
    divisors: Sequence[Colour] | None = None,
    fit_attenuation: type[QuadraticAttenuation] | None = None,
    notes: Sequence[str] = (),
) -> Capture:
    """A capture from its parts; image k is divided by `divisors[k]` after clipping was decided."""
    mask = np.asarray(gbuffer.mask)
    images, valid, clipped = [], [], []
    for k, photograph in enumerate(photographs):
        linear = photograph.linear()
        images.append(linear if divisors is None else linear / divisors[k].astype(linear.dtype))
        clipped.append(mask & photograph.clipped)
        valid.append(mask & photograph.usable & ~clipped[-1])
    names = tuple(p.name for p in photographs)
    empty = [name for name, pixels in zip(names, valid, strict=True) if not pixels.any()]
    if len(empty) == len(names):
        raise BadInput(
            f"{names[0]}: every pixel of the mask is clipped or not finite, in every image;"
            " expose less, or correct the mask"
        )
    spent = [f"{name}: every pixel of the mask is clipped or not finite" for name in empty]
    return Capture(
        names=names,
        images=tuple(images),
        valid=tuple(valid),
        clipped=tuple(clipped),
        gbuffer=gbuffer,
        scenes=tuple(scenes),
        fit_attenuation=fit_attenuation,
        notes=(*notes, *photography.notes(photographs, mask), *spent),
    )


def _no_capture_in(folder: Path, files: Sequence[str]) -> str:
    lp = sorted(file.name for file in folder.glob("*.[lL][pP]"))
    instead = f"; it holds {lp[0]}: give that file" if lp else ""
    return (
        f"{folder}: holds neither capture.toml nor {' and '.join(files)}{instead or '; add them'}"
    )
