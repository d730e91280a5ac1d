"""Whether a capture was written by this program, so that it may be written anew, or by somebody else."""

from __future__ import annotations

import tomllib
from pathlib import Path

__all__ = ["MARK", "is_written", "remove_capture"]

MARK = "# Written by diffshade, which writes it anew beside another fit: change a copy."
"""The first line of the `capture.toml`."""


def is_written(folder: Path) -> bool:
    """Whether the folder holds a capture of ours."""
    try:
        with (folder / "capture.toml").open(encoding="utf-8") as file:
            return file.readline().rstrip("\n") == MARK
    except (OSError, UnicodeDecodeError):
        return False


def remove_capture(folder: Path) -> None:
    """Remove a capture of ours, and the folder where nothing else is in it. Leaves all others."""
    if not is_written(folder):
        return
    try:
        table = tomllib.loads((folder / "capture.toml").read_text(encoding="utf-8"))
        names = [table["geometry"]["file"], *(image["file"] for image in table["image"])]
    except (ValueError, KeyError, TypeError):  # somebody has changed it
        return
    for name in ("capture.toml", *names):
        if isinstance(name, str) and Path(name).name == name:
            (folder / name).unlink(missing_ok=True)
    if not any(folder.iterdir()):
        folder.rmdir()
