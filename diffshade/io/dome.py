"""Relight's light domes (`.dome`): JSON with the lights of a row of photographs.

    { "imageWidth": mm, "domeDiameter": mm, "verticalOffset": mm, "lightConfiguration": "directional",
      "directions": [{"x": , "y": , "z": }], "positionsSphere": [...], "positions3d": [...],
      "ledAdjust": [{"r": , "g": , "b": }] }

(Relight, `src/dome.cpp`.) Axes: x right, y up, z to the camera, from the image's centre in the plane of
the object. The configuration says which list counts: "directional" lights are far away, "spherical" ones
on the dome, "lights3d" at positions of their own. Images are not named: they are those beside the file,
sorted by name in any case of letters, one a light. A pixel times `ledAdjust` is what it would be if all
lamps were alike.

Positions are brought to units of the image's width. A near light falls off with the square of the
distance, and gives at the root mean square of the lights' own distances what a far one of I_p = 1 does,
as Relight has it. A surface of normals alone is taken to lie in the plane z = 0, and a ball's centre too.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from diffshade.errors import BadInput
from diffshade.io.atomic import replacing
from diffshade.io.capture import Capture, assemble
from diffshade.io.divided_scene import divided_scene
from diffshade.io.folder_geometry import folder_geometry
from diffshade.io.image_files import SUFFIXES
from diffshade.io.json_document import read_json
from diffshade.io.photographs import read_photographs
from diffshade.io.text_rows import direction
from diffshade.io.toml_document import Table
from diffshade.progress import Progress

if TYPE_CHECKING:
    from diffshade.geometry.gbuffer import GBuffer
    from diffshade.scene import Scene

__all__ = ["CONFIGURATIONS", "Dome", "parse_dome", "read_dome", "write_dome"]

CONFIGURATIONS = {
    "directional": "directions",
    "spherical": "positionsSphere",
    "lights3d": "positions3d",
}
"""Which list each configuration speaks of."""
FARTHEST = 1e6
"""Image widths: what is farther is a direction."""


class Dome(NamedTuple):
    """The lights of a `.dome` file."""

    lights: Float[np.ndarray, "N 3"]
    """Unit vectors towards them, or their positions in image widths."""
    near: bool
    """Whether they are positions."""
    led_adjust: Float[np.ndarray, "N 3"] | None = None
    """What each image is multiplied by, red, green and blue; None is 1."""


def read_dome(
    path: Path,
    *,
    white: float | None = None,
    circle: tuple[float, float, float] | None = None,
    encoding: str | float | None = None,
    allow_outside: bool = False,
    progress: Progress | None = None,
) -> Capture:
    """Read the capture of a `.dome` file and the images beside it; options as `read_capture`.

    Raises `BadInput`.
    """
    dome = parse_dome(path)
    names = _images(path.parent)
    if len(names) != len(dome.lights):
        raise BadInput(
            f"{path}: has {len(dome.lights)} lights where {len(names)} images lie beside it; there must"
            " be one a light, all of one ending"
        )
    photographs = read_photographs(
        path.parent,
        names,
        encoding=encoding,
        white=white,
        allow_outside=allow_outside,
        progress=progress,
    )
    height, width, channels = photographs[0].encoded.shape
    gbuffer, notes, outline = folder_geometry(
        path.parent, path.parent / names[0], (height, width), circle, allow_outside=allow_outside
    )
    if dome.near:
        gbuffer = _in_widths(gbuffer)
    return assemble(
        photographs,
        gbuffer,
        _scenes(dome),
        divisors=_divisors(path, dome, channels),
        circle=None if dome.near else outline,  # near lights are placed in widths, not in radii
        notes=(f"images in the order of their names, from {names[0]} to {names[-1]}", *notes),
    )


def parse_dome(path: Path) -> Dome:
    """The lights of a `.dome` file; raises `BadInput`."""
    table = read_json(path, "a .dome file, as Relight writes it")
    chosen = "directional"
    if "lightConfiguration" in table:
        chosen = table.choice("lightConfiguration", tuple(CONFIGURATIONS))
    key = CONFIGURATIONS[chosen]
    lights = _vectors(table, key, "xyz")
    if not len(lights) and chosen == "spherical":
        lights = _on_the_dome(table)
    if not len(lights):
        table.fail(
            f'"{key}" holds no light, of which the lightConfiguration "{chosen}" speaks; calibrate the'
            " dome, or name the list that has them"
        )
    places = [f"{path}: {key} {number}" for number in range(1, len(lights) + 1)]
    if chosen == "directional":
        pairs = zip(lights, places, strict=True)
        lights = np.array([direction(light, place) for light, place in pairs])
    else:
        width = table.number("imageWidth", least=0.0) if "imageWidth" in table else 0.0
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            lights = lights / (width or 1.0)
        for light, place in zip(lights, places, strict=True):
            if not 1e-6 < np.abs(light).max() < FARTHEST:
                raise BadInput(
                    f"{place}: lies {np.abs(light).max():.3g} image widths from the image's centre; give"
                    " a position off it, or a directional dome"
                )
    adjust = _vectors(table, "ledAdjust", "rgb")
    if len(adjust) not in (0, len(lights)):
        table.fail(
            f"ledAdjust has {len(adjust)} colours for {len(lights)} lights; give one a light"
        )
    if not ((adjust > 1e-6) & (adjust < 1e6)).all():
        table.fail("a number of ledAdjust is not above 0, or beyond all lamps; correct it")
    return Dome(lights, chosen != "directional", adjust if len(adjust) else None)


def write_dome(
    path: str | os.PathLike[str],
    *,
    directions: Sequence[Any] | np.ndarray | None = None,
    positions: Sequence[Any] | np.ndarray | None = None,
    image_width: float = 0.0,
    led_adjust: Sequence[Any] | np.ndarray | None = None,
    label: str = "",
) -> None:
    """Write lights as Relight does: `directions` [N, 3], or `positions` [N, 3] in mm from the image's
    centre with the `image_width` in mm (0: positions are in image widths); atomic.

    >>> write_dome("lights.dome", positions=[(0, 100, 300)], image_width=80.0)
    """
    if (directions is None) == (positions is None):
        raise BadInput(f"{path}: give directions, or else positions")
    lights = np.asarray(positions if directions is None else directions, float).reshape(-1, 3)
    adjust = np.asarray([] if led_adjust is None else led_adjust, float).reshape(-1, 3)
    if not (np.isfinite(lights).all() and np.isfinite(adjust).all()) or not len(lights):
        raise BadInput(
            f"{path}: holds no light, or one that is not finite; give three numbers each"
        )
    if len(adjust) not in (0, len(lights)):
        raise BadInput(f"{path}: {len(adjust)} colours for {len(lights)} lights; give one a light")
    if not 0 <= image_width < np.inf:
        raise BadInput(
            f"{path}: image_width is {image_width:g}; give mm, or 0 where it is not known"
        )
    if not ((adjust > 1e-6) & (adjust < 1e6)).all():
        raise BadInput(f"{path}: a number of led_adjust is not above 0; correct it")
    far = directions is not None
    units = [direction(l, f"{path}: light {number}") for number, l in enumerate(lights, 1)]
    document = {
        "label": label,
        "notes": "",
        "imageWidth": float(image_width),
        "domeDiameter": 0.0,
        "verticalOffset": 0.0,
        "lightConfiguration": "directional" if far else "lights3d",
        "directions": _listed(np.stack(units), "xyz"),
        "positionsSphere": [],
        "positions3d": [] if far else _listed(lights, "xyz"),
        "ledAdjust": _listed(adjust, "rgb"),
    }
    with replacing(path) as temporary:
        temporary.write_text(
            json.dumps(document, indent=4, allow_nan=False) + "\n", encoding="utf-8"
        )


def _vectors(table: Table, key: str, axes: str) -> Float[np.ndarray, "N 3"]:
    if key not in table:
        return np.zeros((0, 3))
    found = []
    for entry in table.tables(key, key):
        for axis in axes:
            if axis not in entry:
                entry.fail(f'the key "{axis}" is missing; give {", ".join(axes)}')
        found.append([entry.number(axis) for axis in axes])
    return np.array(found, float).reshape(-1, 3)


def _on_the_dome(table: Table) -> Float[np.ndarray, "N 3"]:
    """Directions times the radius, from the dome's centre: in mm."""
    for key in ("domeDiameter", "verticalOffset"):
        if key not in table:
            return np.zeros((0, 3))
    radius = 0.5 * table.number("domeDiameter", above=0.0)
    found = _vectors(table, "directions", "xyz")
    units = [direction(light, f"{table.path}: directions {n}") for n, light in enumerate(found, 1)]
    up = np.array([0.0, 0.0, table.number("verticalOffset")])
    return np.array(units).reshape(-1, 3) * radius + up


def _images(folder: Path) -> list[str]:
    """The images of a folder by name, of the ending that most of them have."""
    found = [
        file.name
        for file in folder.iterdir()
        if file.suffix.lower() in SUFFIXES and file.stem.lower() != "mask"
    ]
    found.sort(key=lambda name: (name.lower(), name))
    if not found:
        raise BadInput(f"{folder}: holds no image; put the photographs beside the .dome file")
    (ending, _), *_ = Counter(Path(name).suffix.lower() for name in found).most_common(1)
    return [name for name in found if Path(name).suffix.lower() == ending]


def _scenes(dome: Dome) -> list[Scene]:
    if not dome.near:
        return [divided_scene(light) for light in dome.lights]
    from diffshade.light.attenuation import InverseSquare
    from diffshade.light.point import PointLight
    from diffshade.scene import Scene

    one: Any = 1.0
    usual: Any = float((dome.lights**2).sum(axis=1).mean())
    places: list[Any] = list(dome.lights)
    return [
        Scene(ambient=one, lights=(PointLight(place, usual, InverseSquare()),)) for place in places
    ]


def _divisors(path: Path, dome: Dome, channels: int) -> list[np.ndarray] | None:
    if dome.led_adjust is None:
        return None
    adjust = dome.led_adjust
    if channels == 1:
        if not (adjust == adjust[:, :1]).all():
            raise BadInput(
                f"{path}: ledAdjust has colours for images of one channel; give one number thrice"
            )
        adjust = adjust[:, :1]
    return list(1 / adjust)


def _in_widths(gbuffer: GBuffer) -> GBuffer:
    """With positions in image widths from the image's centre."""
    import jax

    from diffshade.vector import Vec3

    height, width = gbuffer.shape
    row, column = np.nonzero(np.asarray(gbuffer.mask))
    x, y = (column + 0.5) / width - 0.5, (0.5 * height - row - 0.5) / width
    z = np.zeros_like(x)
    if gbuffer.position is not None:
        right, up, towards = (
            np.asarray(p, float)
            for p in (gbuffer.position.x, gbuffer.position.y, gbuffer.position.z)
        )
        span = right @ right + up @ up  # 0 of the one pixel in the centre, where z is 0 too
        z = towards * ((right @ x + up @ y) / span if span else 0.0)  # at the scale of x and y
    planes = jax.device_put([p.astype(gbuffer.normal.x.dtype) for p in (x, y, z)])
    return replace(gbuffer, position=Vec3(*planes))


def _listed(vectors: np.ndarray, axes: str) -> list[dict[str, float]]:
    return [dict(zip(axes, vector.tolist(), strict=True)) for vector in vectors]
