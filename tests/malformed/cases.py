"""All malformed files that the tests know, and what must become of each."""

import os
import warnings
from collections.abc import Iterator
from pathlib import Path

from malformed import arrays, images, lights, meshes, texts
from malformed.case import Case, Format

from diffshade.errors import BadInput

__all__ = ["cases", "formats", "refusal"]

LONGEST = 1500
"""Characters of a message, its path included."""


def formats() -> tuple[Format, ...]:
    """Every format, with a valid file of it."""
    return (*images.FORMATS, *arrays.FORMATS, *meshes.FORMATS, *texts.FORMATS, *lights.FORMATS)


def cases() -> Iterator[Case]:
    """Every malformed file."""
    for module in (images, arrays, meshes, texts, lights):
        yield from module.cases()


def refusal(case: Case, folder: Path) -> str:
    """The message with which a case is refused, in an empty folder.

    `AssertionError` where it is not, or not as it must be: by `BadInput` and nothing else, in one line
    that names the file, without a warning, and with nothing written.
    """
    path = case.make(folder)
    before = _state(folder)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            case.format.read(path)
        except BadInput as error:
            message = str(error)
        except Exception as error:
            raise AssertionError(f"{type(error).__name__}, which is no refusal: {error}") from error
        else:
            raise AssertionError("it was read")
    assert "\n" not in message
    assert len(message) < LONGEST
    assert message.startswith(str(folder)), message
    assert not warned, warned[0].message
    assert _state(folder) == before, "it was written to"
    return message


def _state(folder: Path) -> list[tuple[str, int, int]]:
    files = (Path(at, name) for at, _, names in os.walk(folder) for name in names)
    return sorted((str(f), f.lstat().st_size, f.lstat().st_mtime_ns) for f in files)
