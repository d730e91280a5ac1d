"""The content of a plain file, or one line that says why there is none."""

import os
import stat
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from diffshade.errors import BadInput, naming
from diffshade.io.limits import VARIABLE, largest

__all__ = ["finder", "read_bytes", "read_text", "refusing", "within"]

_BYTES = 8
"""Of a value, at most."""


def read_bytes(path: Path) -> bytes:
    """All of a file. Raises `BadInput` where there is none, for a folder or a device (which may have
    no end), and for one that is larger than `diffshade.io.limits` allows.
    """
    try:
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            raise BadInput(f"{path}: this is a folder; name a file in it")
        if not stat.S_ISREG(status.st_mode):
            raise BadInput(f"{path}: this is no plain file; copy what it holds into one")
        if status.st_size > (most := _BYTES * largest()):
            raise BadInput(
                f"{path}: holds {status.st_size} bytes, more than the {most} that are read from one"
                f" file; if it is right, set {VARIABLE} to more"
            )
        return path.read_bytes()
    except BadInput:
        raise
    except (FileNotFoundError, ValueError):  # ValueError: no name can hold a NUL
        raise BadInput(f"{path}: there is no such file; check the path") from None
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror}); mend that first") from None


def read_text(path: Path) -> str:
    """All of a UTF-8 text file, with or without a byte order mark; raises `BadInput`."""
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise BadInput(f"{path}: this is not a text file; save it as UTF-8 text") from None


@contextmanager
def refusing(path: Path, what: str, remedy: str) -> Iterator[None]:
    """Whatever a library raises over what a file holds is `BadInput`, in one line; it warns of nothing.

    Libraries raise types of many modules for a damaged file.
    """
    try:
        with warnings.catch_warnings(), naming(path):
            warnings.simplefilter("ignore")
            yield
    except BadInput:
        raise
    except Exception as error:
        raise BadInput(f"{path}: {what} ({str(error) or type(error).__name__}); {remedy}") from None


def within(folder: Path, name: str, *, allow_outside: bool) -> Path:
    """The file of this name, which another file in the folder gives.

    Raises `BadInput` where it lies outside the folder, by `..`, as an absolute path or through a
    symbolic link, unless that is allowed: a capture from elsewhere is to read no files but its own.
    """
    path = folder / name
    try:
        inside = allow_outside or path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # no file in it: whoever reads it says so
        inside = not Path(name).is_absolute()
    if not inside:
        raise BadInput(
            f"{folder}: {name} lies outside this folder; move it there, or allow it (--allow-outside,"
            " allow_outside=True)"
        )
    return path


def finder(folder: Path) -> Callable[[str], str | None]:
    """How a file in the folder is spelled that is called so, in any case of letters; None: there is none.

    Files that differ in case alone are told apart by it; a name that is none of them means the last.
    """
    spelled = {file.name.lower(): file.name for file in sorted(folder.iterdir())}
    return lambda name: name if os.path.isfile(folder / name) else spelled.get(name.lower())
