"""How photographs were exposed, by what the camera wrote into them (EXIF 2.32, 4.6.5).

A telephone in its automatic mode changes the exposure and the white balance between photographs, so that
the strength and the colour of their lights cannot be compared. Nothing is divided by what is read here,
as a camera rounds it: it is told, and the user says what holds.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from enum import IntEnum
from io import BytesIO
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from PIL.Image import Exif

__all__ = ["Shot", "exposure_note", "shot_in_tiff", "shot_of", "stated_note", "white_balance_note"]


class Tag(IntEnum):
    """The tags that say how a photograph was exposed, and where they stand."""

    EXIF_DIRECTORY = 34665
    EXPOSURE_TIME = 33434
    F_NUMBER = 33437
    PHOTOGRAPHIC_SENSITIVITY = 34855
    WHITE_BALANCE = 41987


_AUTOMATIC = 0
_SAME = 1.01
"""Exposures that differ by less are one."""
_ROUNDED = 1.1
"""Cameras round an exposure to less than this."""


class Shot(NamedTuple):
    """What a photograph was taken with; None is what its file does not say."""

    seconds: float | None = None
    f_number: float | None = None
    iso: float | None = None
    automatic_white: bool = False
    """Whether the white balance was the camera's own choice."""

    def words(self) -> str:
        """As photographers write it."""
        parts = []
        if self.seconds is not None:
            short = self.seconds < 0.3
            parts.append(f"1/{1 / self.seconds:.4g} s" if short else f"{self.seconds:.3g} s")
        if self.f_number is not None:
            parts.append(f"f/{self.f_number:.3g}")
        if self.iso is not None:
            parts.append(f"ISO {self.iso:g}")
        return " ".join(parts)


def shot_of(exif: Exif) -> Shot | None:
    """What EXIF says of a photograph; None where it says nothing, or is damaged."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            said = {**exif, **exif.get_ifd(Tag.EXIF_DIRECTORY)}
    except Exception:  # Pillow raises types of its own; the picture does not hang on it
        return None
    shot = Shot(
        _positive(said, Tag.EXPOSURE_TIME),
        _positive(said, Tag.F_NUMBER),
        _positive(said, Tag.PHOTOGRAPHIC_SENSITIVITY),
        said.get(Tag.WHITE_BALANCE) == _AUTOMATIC,
    )
    return None if shot == Shot() else shot


def shot_in_tiff(data: bytes) -> Shot | None:
    """The same of a TIFF, or of a camera's RAW file in the form of one."""
    from PIL.Image import Exif

    exif = Exif()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            exif.load_from_fp(BytesIO(data))
    except Exception:
        return None
    return shot_of(exif)


def exposure_note(shots: Mapping[str, Shot]) -> str | None:
    """That the exposures of photographs, by name, differ; None where they do not, or are not said."""
    relative = _relative(shots)
    if not relative:
        return None
    least, most, factor = _spread(relative)
    if factor < _SAME:
        return None
    return (
        f"exposure differs between images (EXIF): {shots[least].words()} in {least},"
        f" {shots[most].words()} in {most}, a factor of {factor:.3g}, and nothing was divided by it; give"
        " each image its exposure in a capture.toml, or --gains"
    )


def stated_note(shots: Mapping[str, Shot], stated: Mapping[str, float]) -> str | None:
    """That stated exposures disagree with the files; None where they do not, or these say nothing."""
    relative = _relative({name: shots[name] for name in stated if name in shots})
    if not relative:
        return None
    least, most, factor = _spread({name: stated[name] / own for name, own in relative.items()})
    if factor < _ROUNDED:
        return None
    return (
        f"stated exposures disagree with EXIF by a factor of {factor:.3g}: {stated[least]:.4g} for"
        f" {shots[least].words()} in {least}, {stated[most]:.4g} for {shots[most].words()} in {most}"
    )


def white_balance_note(shots: Mapping[str, Shot]) -> str | None:
    """That the camera chose the white balance of some photographs."""
    names = [name for name, shot in shots.items() if shot.automatic_white]
    if not names or len(shots) < 2:
        return None
    some = names[0] if len(names) == 1 else f"{len(names)} images ({names[0]}, ...)"
    return (
        f"white balance was automatic in {some} (EXIF): colours may differ between images; lock it, or"
        " take RAW"
    )


def _relative(shots: Mapping[str, Shot]) -> dict[str, float]:
    """t S / N^2, to which the values of an image are proportional, of what all of them say."""
    each = list(shots.values())
    if len(each) < 2 or any(shot.seconds is None for shot in each):
        return {}
    aperture = all(shot.f_number is not None for shot in each)
    sensitivity = all(shot.iso is not None for shot in each)
    return {
        name: (shot.seconds or 0)
        * ((shot.iso or 0) if sensitivity else 1)
        / ((shot.f_number or 0) ** 2 if aperture else 1)
        for name, shot in shots.items()
    }


def _spread(of: Mapping[str, float]) -> tuple[str, str, float]:
    """The names of the least and of the most, and how many times more that is."""
    least, most = min(of, key=of.__getitem__), max(of, key=of.__getitem__)
    return least, most, of[most] / of[least]


def _positive(said: Mapping[int, Any], tag: Tag) -> float | None:
    value = said.get(tag)
    if isinstance(value, Sequence) and not isinstance(value, str | bytes) and value:
        value = value[0]
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    return number if isfinite(number) and 1e-9 < number < 1e9 else None
