"""`diffshade calibrate`: the directions of lights from photographs of a mirror ball."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from diffshade.commands.console import WrongUsage, note, show
from diffshade.errors import naming
from diffshade.progress import bar

__all__ = ["calibrate", "calibrate_folder"]

SCHEMA = "diffshade.calibrate/1"
AMBIGUOUS = 0.5
"""A second spot that is so large beside the first might be the lamp."""


def calibrate(folder: Path, *, as_json: bool, **options: Any) -> int:
    """Find the lights of a folder's photographs, and print them; returns the exit status."""
    document, notes = calibrate_folder(folder, **options)
    for line in notes:
        note(line)
    show(document, _report(folder, document), as_json=as_json)
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
    from fitting.calibrate.ball import mirror_ball

    outline = folder if mask is None or circle is not None else mask
    with naming(outline), bar(f"looking for highlights in {len(images)} images"):
        ball = mirror_ball(
            images,
            mask=inside,
            circle=None if circle is None else Circle(*circle).checked("--circle"),
            fov=None if fov is None else math.radians(fov),
            names=[str(folder / name) for name in names],
        )
    notes = tuple(
        f"{name}: a second spot is {highlight.rival:.0%} as large as the highlight: check that one"
        " lamp was on, and nothing else mirrored"
        for name, highlight in zip(names, ball.highlights, strict=True)
        if highlight.rival > AMBIGUOUS
    )
    lights = [
        {
            "file": name,
            "direction": direction.tolist(),
            "highlight": {"x": highlight.x, "y": highlight.y, "size": highlight.size},
        }
        for name, direction, highlight in zip(names, ball.directions, ball.highlights, strict=True)
    ]
    document = {"schema": SCHEMA, "circle": ball.circle._asdict(), "lights": lights}
    return document, notes


def _report(folder: Path, document: dict[str, Any]) -> str:
    circle, lights = document["circle"], document["lights"]
    wide = max(len(light["file"]) for light in lights)
    rows = [
        f"{light['file']:<{wide}}  " + "  ".join(f"{x:9.6f}" for x in light["direction"])
        for light in lights
    ]
    return "\n".join(
        [
            f"{folder}: a ball of radius {circle['radius']:.2f} about"
            f" ({circle['cx']:.2f}, {circle['cy']:.2f}) pixels",
            "directions to the lights: x right, y up, z to the camera",
            "",
            *rows,
        ]
    )
