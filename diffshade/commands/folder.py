"""The folder of results: made when there is something to write, whole when `fit.json` is in it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from diffshade.commands.console import note, to_text
from diffshade.commands.pictures import (
    compare,
    earlier_pictures,
    page_pictures,
    write_pictures,
)
from diffshade.errors import BadInput
from diffshade.io.atomic import replacing
from diffshade.io.written_capture import is_written, remove_capture

if TYPE_CHECKING:
    from diffshade.io.capture import Capture
    from diffshade.reflectance.material import Material
    from diffshade.scene import Scene

__all__ = ["check_folder", "write_folder"]

CAPTURE = "capture"
"""The folder of a capture that was refined before it was fitted."""


def check_folder(folder: Path, *, with_capture: bool = False) -> None:
    """Refuse, before the work, a folder that could not be made after it, and one that has a capture of
    somebody's where another is to be written. Makes nothing."""
    nearest = folder
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise BadInput(f"{nearest}: is not a folder, so nothing can be written there; name another")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise BadInput(f"{nearest}: is not writable; name another folder")
    own = folder / CAPTURE
    if with_capture and own.exists() and not is_written(own) and any(own.iterdir()):
        raise BadInput(
            f"{own}: is there already, and not of an earlier fit; the refined capture is written there:"
            " name another folder, or move that one"
        )


def write_folder(
    folder: Path,
    document: Mapping[str, Any],
    report: str,
    title: str,
    capture: Capture,
    material: Material,
    scenes: tuple[Scene, ...],
    *,
    with_capture: bool = False,
) -> tuple[str, ...]:
    """Write the pictures, `report.txt`, `report.html` and, last, `fit.json`; each file whole or not
    at all. `title` is that of the page. `with_capture`: the capture too, under these scenes, into a
    folder of its own below. Returns the names of the files, the report first.

    The `fit.json` of an earlier fit is removed first, and then its pictures and its capture, unless that
    is what was fitted. A folder that is made here is gone again where nothing was written into it.
    """
    from fitting.report_html import fit_page

    compared = compare(capture, material, scenes)
    page = fit_page(document, page_pictures(compared), title=title)
    own = (folder / CAPTURE).resolve()
    fitted = any(own in source.path.resolve().parents for source in capture.sources)
    with _made(folder, keep_capture=fitted):
        refined = _capture(folder, replace(capture, scenes=scenes)) if with_capture else ()
        pictures, legend = write_pictures(folder, compared)
        _write_text(folder / "report.txt", f"{report}\n\n{legend}\n")
        _write_text(folder / "report.html", page)
        _write_text(folder / "fit.json", to_text(document) + "\n")
    return ("report.html", "report.txt", "fit.json", *refined, *pictures)


def _capture(folder: Path, capture: Capture) -> tuple[str, ...]:
    """Write the capture; the name of its folder, or none where that cannot be, which is noted."""
    from diffshade.io.write_capture import write_capture

    try:
        write_capture(folder / CAPTURE, capture)
    except BadInput as error:
        note(f"{error}; the fit is written without its capture")
        return ()
    return (CAPTURE,)


@contextmanager
def _made(folder: Path, *, keep_capture: bool) -> Iterator[None]:
    """A folder to write into, without an earlier fit and, unless that is kept, its capture.

    Made with those above it, and where the block raises those of them that are still empty are removed.
    """
    new = [path for path in (folder / CAPTURE, folder, *folder.parents) if not path.exists()]
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if (folder / "fit.json").exists():
                (folder / "fit.json").unlink()
                for old in earlier_pictures(folder):
                    old.unlink()
                if not keep_capture:
                    remove_capture(folder / CAPTURE)
        except OSError as error:
            raise BadInput(
                f"{folder}: cannot be written ({error.strerror}); name another folder"
            ) from None
        yield
    except BaseException:
        for path in new:
            with suppress(OSError):  # it is not empty, or was not made
                path.rmdir()
        raise


def _write_text(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
