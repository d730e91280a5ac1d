"""A capture: photographs of one object from one place, and what is known of how they were taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from diffshade.errors import BadInput
from diffshade.io import photographs as photography
from diffshade.io.circle import Circle
from diffshade.io.photographs import Photograph

if TYPE_CHECKING:
    from diffshade.geometry.gbuffer import GBuffer
    from diffshade.light.attenuation import AbstractAttenuation
    from diffshade.scene import Scene

__all__ = ["Capture", "Colour", "Exposure", "Source", "assemble"]

Pixels = Float[np.ndarray, "H W C"]
Mask = Bool[np.ndarray, "H W"]
Colour = Float[np.ndarray, "C"]
Exposure = Float[np.ndarray, "*C"]
"""One number, of no axis, or one a channel."""


@dataclass(frozen=True, eq=False)
class Source:
    """The file of an image, and how its values became those of the capture."""

    path: Path
    encoding: str | float
    """What `decode` was told: "linear", "srgb" or a gamma."""
    white: float | None
    """The encoded level at which the sensor clips; None where that is unknown."""
    exposure: Exposure | None
    """What the linear values were divided by; None: by nothing. It is the exposure where it is one
    number, of no axis, and a light's intensity may be in those by channel."""


@dataclass(frozen=True, eq=False)
class Capture:
    """Photographs as they are to be fitted, on the host, one entry an image."""

    names: tuple[str, ...]
    """The file of each image, as the capture names it."""
    images: tuple[Pixels, ...]
    """Linear radiance; in a photometric-stereo folder divided by the light's intensity,
    in a `capture.toml` by the exposures that it states."""
    valid: tuple[Mask, ...]
    """Pixels of the mask that are finite, opaque and not clipped: those that a fit may use."""
    clipped: tuple[Mask, ...]
    """Pixels of the mask with any channel at or above 0.98 of full scale as encoded."""
    gbuffer: GBuffer
    """The geometry; its foreground is the mask."""
    scenes: tuple[Scene, ...]
    """The light that each image was taken under."""
    fit_attenuation: type[AbstractAttenuation] | None = None
    """The attenuation whose constants are to be fitted, one set for all lights; None: all known."""
    circle: Circle | None = None
    """The outline of the ball that the geometry was made of, where it was."""
    notes: tuple[str, ...] = ()
    """What was assumed or found on reading, one line each, for the user to see."""
    sources: tuple[Source, ...] = ()
    """Where each image comes from; empty where that is no file."""


def assemble(
    photographs: Sequence[Photograph],
    gbuffer: GBuffer,
    scenes: Sequence[Scene],
    *,
    divisors: Sequence[Colour] | None = None,
    exposures: Sequence[Exposure] | None = None,
    fit_attenuation: type[AbstractAttenuation] | None = None,
    circle: Circle | None = None,
    notes: Sequence[str] = (),
) -> Capture:
    """A capture from its parts; image k is divided by `divisors[k]`, or by what is stated of its
    exposure, after clipping was decided.
    """
    divisors = divisors if exposures is None else exposures
    mask = np.asarray(gbuffer.mask)
    images, valid, clipped, sources = [], [], [], []
    for k, photograph in enumerate(photographs):
        divisor = None if divisors is None else divisors[k]
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite then is not used
            linear = photograph.linear()
            if divisor is not None:
                linear = linear / divisor.astype(linear.dtype)
        images.append(linear)
        clipped.append(mask & photograph.clipped)
        valid.append(mask & photograph.usable & np.isfinite(linear).all(axis=-1) & ~clipped[-1])
        sources.append(Source(photograph.path, photograph.encoding, photograph.white, divisor))
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
        circle=circle,
        notes=(*notes, *photography.notes(photographs, mask, exposures), *spent),
        sources=tuple(sources),
    )
