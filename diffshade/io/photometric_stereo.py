"""The photometric-stereo community's folder layout, as in DiLiGenT (Shi et al., CVPR 2016).

| file | holds |
|---|---|
| `filenames.txt` | one image a line |
| `light_directions.txt` | x y z per image, towards the light; x right, y up, z to the camera |
| `light_intensities.txt` | R G B (or one number) per image; without it all are 1 |
| `mask.png` and geometry | see `folder_geometry` |

Images are linear by the convention of the layout; a file that says otherwise is refused until the
encoding is given. Each image is divided by its light's intensity, and I_a = 1 in what results.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from diffshade.errors import BadInput
from diffshade.io.capture import Capture, assemble
from diffshade.io.contents import within
from diffshade.io.divided_scene import divided_scene
from diffshade.io.folder_geometry import folder_geometry
from diffshade.io.photographs import read_photographs
from diffshade.io.text_rows import direction, lines, rows
from diffshade.progress import Progress

__all__ = ["FILES", "read_photometric_stereo"]

FILES = ("filenames.txt", "light_directions.txt")
"""The files without which a folder is not in this layout."""


def read_photometric_stereo(
    folder: Path,
    *,
    white: float | None = None,
    circle: tuple[float, float, float] | None = None,
    encoding: str | float | None = None,
    allow_outside: bool = False,
    progress: Progress | None = None,
) -> Capture:
    """Read a folder in this layout; options as `read_capture`. Raises `BadInput`."""
    names_file, directions_file, intensities_file = (
        within(folder, name, allow_outside=allow_outside)
        for name in (*FILES, "light_intensities.txt")
    )
    names = [name for _, name in lines(names_file)]
    if not names:
        raise BadInput(f"{names_file}: names no image; give one a line")
    directions = [direction(values, where) for where, values in rows(directions_file, 3)]
    _one_an_image(directions_file, len(directions), names_file, len(names))
    known = intensities_file.exists()
    photographs = read_photographs(
        folder,
        names,
        encoding=encoding,
        white=white,
        linear_by_convention=True,
        allow_outside=allow_outside,
        progress=progress,
    )
    height, width, channels = photographs[0].encoded.shape
    divisors = None
    if known:
        divisors = _intensities(intensities_file, channels)
        _one_an_image(intensities_file, len(divisors), names_file, len(names))
    gbuffer, notes, outline = folder_geometry(
        folder, folder / names[0], (height, width), circle, allow_outside=allow_outside
    )
    if not known:
        notes += (f"{intensities_file.name} is not there: every light's intensity taken as 1",)
    scenes = [divided_scene(d) for d in directions]
    return assemble(photographs, gbuffer, scenes, divisors=divisors, circle=outline, notes=notes)


def _one_an_image(file: Path, count: int, names_file: Path, images: int) -> None:
    if count != images:
        raise BadInput(
            f"{file}: {count} lights where {names_file.name} names {images} images; give one a line"
        )


def _intensities(file: Path, channels: int) -> list[Float[np.ndarray, "C"]]:
    found = []
    for where, values in rows(file, 1, 3):
        if not (values > 0).all():
            raise BadInput(f"{where}: an intensity is not above 0; correct the line")
        if not ((values > 1e-30) & (values < 1e30)).all():
            raise BadInput(f"{where}: an intensity is beyond what single precision divides by")
        if len(values) > channels and (values == values[0]).all():
            values = values[:1]
        if len(values) not in (1, channels):
            raise BadInput(
                f"{where}: {len(values)} intensities for images of one channel; give one number"
            )
        found.append(values)
    return found
