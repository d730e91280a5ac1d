"""Photographs and lights into the photometric-stereo folder layout, as `photometric_stereo` reads it."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from diffshade.errors import BadInput
from diffshade.io.atomic import replacing
from diffshade.io.encoding import Encoding
from diffshade.io.image import write_png

__all__ = ["write_photometric_stereo"]


def write_photometric_stereo(
    folder: str | os.PathLike[str],
    images: Sequence[ArrayLike],
    directions: ArrayLike,
    *,
    intensities: ArrayLike | None = None,
    mask: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    circle: tuple[float, float, float] | None = None,
) -> None:
    """Write a folder, which is made where it is not there; `filenames.txt` last, so that with it all is.

    `images` are as photographed, [H, W, 3] or [H, W, 1], linear in [0, 1], not divided by anything: the
    reader divides them by `intensities`, [K, 3] or [K]; without these the file is not written, and they
    are 1. They become PNGs of 16 bits, which say that they are linear. `directions` [K, 3] point to the
    lights, `mask` is [H, W], `normals` [H, W, 3], `circle` (cx, cy, radius) the outline of a ball.

    Raises `BadInput` for what does not fit together, and for values outside [0, 1].

    >>> write_photometric_stereo("ball", images, directions, mask=mask, normals=normals)
    """
    place = Path(folder)
    lights = _rows(place, "directions", directions, len(images), 3)
    if (np.linalg.norm(lights, axis=1) < 1e-6).any():
        raise BadInput(f"{place}: a light's direction has no length; give directions to the lights")
    powers = None
    if intensities is not None:
        powers = np.asarray(intensities, float)
        powers = powers[:, None] if powers.ndim == 1 else powers
        powers = _rows(place, "intensities", powers, len(images), 1, 3)
        if not (powers > 0).all():
            raise BadInput(f"{place}: an intensity is not above 0; give the lights' strengths")
    shapes = {np.shape(image) for image in images}
    if len(shapes) != 1:
        raise BadInput(f"{place}: images of shapes {sorted(shapes)}; give some, all of one shape")
    size = next(iter(shapes))[:2]
    for name, plane, shape in (("mask", mask, size), ("normals", normals, (*size, 3))):
        if plane is not None and np.shape(plane) != shape:
            raise BadInput(f"{place}: {name} has shape {np.shape(plane)}; give {shape}")
    place.mkdir(parents=True, exist_ok=True)
    names = [f"{number:03d}.png" for number in range(1, len(images) + 1)]
    for name, image in zip(names, images, strict=True):
        write_png(place / name, image, bits=16, encoding=Encoding.LINEAR)
    if mask is not None:
        write_png(place / "mask.png", np.asarray(mask) != 0, encoding=Encoding.UNKNOWN)
    if normals is not None:
        _write_normals(place / "Normal_gt.mat", normals)
    if circle is not None:
        cx, cy, radius = map(float, circle)
        _write(
            place / "sphere.json", f'{{"cx": {cx - 0.5!r}, "cy": {cy - 0.5!r}, "R": {radius!r}}}\n'
        )
    _write(place / "light_directions.txt", _lines(lights))
    if powers is not None:
        _write(place / "light_intensities.txt", _lines(powers))
    _write(place / "filenames.txt", "\n".join(names) + "\n")


def _rows(place: Path, name: str, values: Any, count: int, *columns: int) -> np.ndarray:
    rows = np.asarray(values, float)
    if rows.ndim != 2 or len(rows) != count or rows.shape[1] not in columns:
        wanted = " or ".join(f"[{count}, {n}]" for n in columns)
        raise BadInput(f"{place}: {name} has shape {rows.shape} for {count} images; give {wanted}")
    if not np.isfinite(rows).all():
        raise BadInput(f"{place}: {name} holds NaN or infinity; mend what made them")
    return rows


def _lines(rows: np.ndarray) -> str:
    return "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist())


def _write(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _write_normals(path: Path, normals: ArrayLike) -> None:
    import scipy.io

    with replacing(path) as temporary, temporary.open("wb") as file:
        scipy.io.savemat(file, {"Normal_gt": np.asarray(normals, float)})
