"""The photographs in a folder: those that it names, or all of them in their natural order."""

import os
import re
from pathlib import Path

from diffshade.errors import BadInput
from diffshade.io.text_rows import lines

__all__ = ["SUFFIXES", "image_files"]

SUFFIXES = (
    ".png",
    ".jpg",
    ".jpeg",
    ".tif",
    ".tiff",
    ".exr",
    ".hdr",
    ".pic",
    ".dng",
    ".cr2",
    ".cr3",
    ".nef",
    ".arw",
    ".raf",
    ".rw2",
    ".orf",
)
"""What names of image files end in; what they hold is found from their content."""


def image_files(folder: Path, *, but: tuple[Path, ...] = ()) -> list[str]:
    """The names in `filenames.txt`, or else of all image files but some and a mask, 2 before 10.

    Raises `BadInput` where the folder is none, or has no image.
    """
    if not os.path.isdir(folder):
        what = "this is no folder" if os.path.exists(folder) else "there is no such folder"
        raise BadInput(f"{folder}: {what}; give one with photographs")
    if (listed := folder / "filenames.txt").exists():
        names = [name for _, name in lines(listed)]
        if not names:
            raise BadInput(f"{listed}: names no image; give one a line")
        return names
    left_out = {path.resolve() for path in but}
    found = [
        path.name
        for path in folder.iterdir()
        if path.suffix.lower() in SUFFIXES
        and path.stem.lower() != "mask"
        and path.resolve() not in left_out
    ]
    if not found:
        raise BadInput(f"{folder}: holds no image; give a folder with photographs")
    return sorted(found, key=_natural)


def _natural(name: str) -> tuple[list[tuple[bool, int, str]], str]:
    """Numbers in a name as numbers."""
    parts = re.findall(r"\d{1,300}|\D+", name.lower())
    return [(not p[0].isdecimal(), int(p) if p[0].isdecimal() else 0, p) for p in parts], name
