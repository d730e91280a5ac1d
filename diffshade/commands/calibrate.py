"""`diffshade calibrate`: the directions of lights from photographs of a mirror ball."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from diffshade.commands.console import WrongUsage, note, show
from diffshade.errors import naming
from diffshade.progress import bar

if TYPE_CHECKING:
    from fitting.calibrate.ball import MirrorBall

__all__ = ["calibrate", "calibrate_folder"]

SCHEMA = "diffshade.calibrate/1"
AMBIGUOUS = 0.5
"""A second spot that is so large beside the first might be the lamp."""
GLOSSY = 10.0
"""Times the ball's median that the lamp has on a mirror in a dark room, and more; on plastic it may have
5, on chrome and black glass in photographs it has 28 and more."""
COARSE = 5.0
"""Degrees that one pixel makes; 2 / R radians in the middle of a ball."""


def calibrate(folder: Path, *, as_json: bool, out: Path | None = None, **options: Any) -> int:
    """Find the lights of a folder's photographs, and print or write them; returns the exit status."""
    if out is not None:
        from diffshade.io.write_lights import check_ending

        check_ending(out)
    document, notes = calibrate_folder(folder, **options)
    for line in notes:
        note(line)
    report = _report(folder, document)
    if out is not None:
        from diffshade.io.write_lights import write_lights

        lights = document["lights"]
        directions = np.array([light["direction"] for light in lights])
        write_lights(out, [light["file"] for light in lights], directions)
        report = f"{report}\n\nwritten: {out}"
    show(document, report, as_json=as_json)
    return 0


def calibrate_folder(
    folder: Path,
    *,
    mask: Path | None = None,
    circle: tuple[float, float, float] | None = None,
    fov: float | None = None,
    allow_outside: bool = False,
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The document of `calibrate --json`, and notes, from all photographs in a folder.

    `fov` is the vertical field of view in degrees.
    """
    from diffshade.io.circle import Circle
    from diffshade.io.folder_geometry import read_mask_of
    from diffshade.io.image_files import image_files
    from diffshade.io.photographs import read_photographs

    if fov is not None and not 0 < fov < 180:
        raise WrongUsage(f"--fov {fov:g}: give degrees between 0 and 180")
    names = image_files(folder, but=() if mask is None else (mask,))
    # Highlights are found by what is brightest, whatever the encoding: none needs to be stated.
    with bar(f"reading {folder}") as progress:
        photographs = read_photographs(
            folder, names, encoding="linear", allow_outside=allow_outside, progress=progress
        )
    images = [photograph.encoded for photograph in photographs]
    inside = None if mask is None else read_mask_of(mask, folder / names[0], images[0].shape[:2])
    from fitting.calibrate.ball import ball_outline, mirror_ball

    given = None if circle is None else Circle(*circle).checked("--circle")
    with bar(f"looking for highlights in {len(images)} images"):
        with naming(folder if mask is None or circle is not None else mask):
            outline = ball_outline(images, mask=inside, circle=given)
        ball = mirror_ball(
            images,
            mask=inside,
            circle=outline,
            fov=None if fov is None else math.radians(fov),
            names=[str(folder / name) for name in names],
        )
    lights = [
        {
            "file": name,
            "direction": direction.tolist(),
            "degrees_per_pixel": float(turn),
            "highlight": {"x": highlight.x, "y": highlight.y, "size": highlight.size},
        }
        for name, direction, turn, highlight in zip(
            names, ball.directions, ball.degrees_per_pixel, ball.highlights, strict=True
        )
    ]
    document = {"schema": SCHEMA, "circle": ball.circle._asdict(), "lights": lights}
    return document, _doubts(names, ball)


def _doubts(names: list[str], ball: MirrorBall) -> tuple[str, ...]:
    """What a person should look at, in lines."""
    found = [
        f"{name}: a second spot is {highlight.rival:.0%} as large as the highlight: check that one"
        " lamp was on, and nothing else mirrored"
        for name, highlight in zip(names, ball.highlights, strict=True)
        if highlight.rival > AMBIGUOUS
    ]
    contrast = np.array([highlight.contrast for highlight in ball.highlights])
    if which := _those(names, contrast < GLOSSY):
        found.append(
            f"{which}: the highlight is only {contrast.min():.1f} times as bright as the ball's median,"
            " as on a glossy ball or in a bright room; a mirror ball in the dark tells more exactly"
        )
    if which := _those(names, ball.directions[:, 2] < 0):
        found.append(f"{which}: the light is behind the ball (z below 0); check that it was there")
    if which := _those(names, ball.degrees_per_pixel > COARSE):
        found.append(
            f"{which}: one pixel of the highlight makes {ball.degrees_per_pixel.max():.0f} degrees of"
            " the direction; take the ball larger, or the lamp nearer to the camera's side"
        )
    return tuple(found)


def _those(names: list[str], which: np.ndarray) -> str:
    """The first of some images, and how many more there are; empty where there is none."""
    chosen = [name for name, among in zip(names, which, strict=True) if among]
    more = f" and {len(chosen) - 1} more" if len(chosen) > 1 else ""
    return f"{chosen[0]}{more}" if chosen else ""


def _report(folder: Path, document: dict[str, Any]) -> str:
    circle, lights = document["circle"], document["lights"]
    wide = max(len(light["file"]) for light in lights)
    rows = [
        f"{light['file']:<{wide}}  "
        + "  ".join(f"{x:7.4f}" for x in light["direction"])
        + f"  {light['degrees_per_pixel']:6.2f}"
        for light in lights
    ]
    return "\n".join(
        [
            f"{folder}: a ball of radius {circle['radius']:.2f} about"
            f" ({circle['cx']:.2f}, {circle['cy']:.2f}) pixels",
            "directions to the lights: x right, y up, z to the camera; then the degrees that one pixel"
            " makes",
            "",
            *rows,
        ]
    )
