"""RTI light-position files (`.lp`): a count, then `filename x y z` a line.

Axes: x right, y up, z to the camera. The last three words of a line are the direction to the light,
so names may hold spaces, and Windows paths: an image is looked for beside the `.lp` file by its
base name, in any case of letters. The format has no intensities: all are 1, as is I_a. Geometry
stands in the same folder, see `folder_geometry`.
"""

import os
from collections.abc import Sequence
from pathlib import Path, PureWindowsPath
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from diffshade.errors import BadInput, naming
from diffshade.io.atomic import replacing
from diffshade.io.capture import Capture, assemble
from diffshade.io.contents import finder
from diffshade.io.divided_scene import divided_scene
from diffshade.io.folder_geometry import folder_geometry
from diffshade.io.limits import check_size
from diffshade.io.photographs import read_photographs
from diffshade.io.text_rows import direction, lines, numbers
from diffshade.progress import Progress

__all__ = ["LightPositions", "parse_lp", "read_lp", "write_lp"]


class LightPositions(NamedTuple):
    """What an `.lp` file says: images beside it, a unit vector towards the light of each, and notes."""

    images: list[str]
    directions: list[Float[np.ndarray, "3"]]
    notes: tuple[str, ...]


def read_lp(
    path: Path,
    *,
    white: float | None = None,
    circle: tuple[float, float, float] | None = None,
    encoding: str | float | None = None,
    allow_outside: bool = False,
    progress: Progress | None = None,
) -> Capture:
    """Read the capture of an `.lp` file; options as `read_capture`. Raises `BadInput`."""
    images, directions, notes = parse_lp(path)
    photographs = read_photographs(
        path.parent,
        images,
        encoding=encoding,
        white=white,
        allow_outside=allow_outside,
        progress=progress,
    )
    height, width = photographs[0].encoded.shape[:2]
    gbuffer, geometry_notes, outline = folder_geometry(
        path.parent,
        path.parent / images[0],
        (height, width),
        circle,
        allow_outside=allow_outside,
    )
    scenes = [divided_scene(d) for d in directions]
    return assemble(photographs, gbuffer, scenes, circle=outline, notes=(*notes, *geometry_notes))


def parse_lp(path: Path) -> LightPositions:
    """The images and lights of an `.lp` file. A wrong count is noted, not refused."""
    content = lines(path)
    notes: tuple[str, ...] = ()
    stated = content[0][1] if content else ""
    if stated.isdecimal():
        content = content[1:]
        with naming(path):
            count = _count(stated)
        if count != len(content):
            notes = (
                f"{path.name}: states {stated} images and lists {len(content)}: all listed read",
            )
    elif content:
        notes = (f"{path.name}: its first line is not a count: every line was read as an image",)
    if not content:
        raise BadInput(f"{path}: lists no image; give a count, then 'filename x y z' a line")
    find = finder(path.parent)
    images, directions = [], []
    for number, line in content:
        where = f"{path}, line {number}"
        words = line.rsplit(maxsplit=3)
        if len(words) < 4:
            raise BadInput(f"{where}: {line!r} is not 'filename x y z'; correct the line")
        name = PureWindowsPath(words[0].strip("\"'")).name
        image = find(name)
        if image is None:
            raise BadInput(f"{where}: there is no {name} beside it; copy the image there")
        images.append(image)
        directions.append(direction(numbers(words[1:], where), where))
    return LightPositions(images, directions, notes)


def write_lp(
    path: str | os.PathLike[str], images: Sequence[str], directions: Sequence[Any] | np.ndarray
) -> None:
    """Write the names of images and the directions to their lights, [N, 3] of any length; atomic.

    >>> write_lp("ball.lp", ["a.png", "b.png"], [(0, 0, 1), (0.6, 0, 0.8)])
    """
    vectors = np.asarray(directions, float).reshape(-1, 3)
    if len(vectors) != len(images) or not images:
        raise BadInput(f"{path}: {len(vectors)} directions for {len(images)} images; give one each")
    rows = []
    for name, vector in zip(images, vectors, strict=True):
        if not name.strip() or not name.isprintable():
            raise BadInput(f"{path}: an image is named {name!r}; give a name of one line")
        if not np.isfinite(vector).all():
            raise BadInput(f"{path}: the light of {name} is not finite; give its direction")
        unit = direction(vector, f"{path}: {name}")
        rows.append(" ".join([name.strip(), *map(repr, unit.tolist())]))
    with replacing(path) as temporary:
        temporary.write_text("\n".join([str(len(rows)), *rows]) + "\n", encoding="utf-8")


def _count(stated: str) -> int:
    if len(stated) > 18:
        raise BadInput(f"states a count of {len(stated)} digits; correct its first line")
    check_size((int(stated), 3))
    return int(stated)
