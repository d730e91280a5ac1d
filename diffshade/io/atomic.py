"""Files that are whole or not there at all."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from diffshade.errors import BadInput

__all__ = ["TEMPORARY", "replacing"]

TEMPORARY = ".diffshade-{}.tmp"
"""The name of what is not whole yet; one stays behind where a process is killed."""


@contextmanager
def replacing(
    path: str | os.PathLike[str], *, remedy: str = "choose another place"
) -> Iterator[Path]:
    """A temporary path in the folder of `path` that takes its place when the block ends well.

    When the block raises, the temporary file is removed and `path` is as it was. Raises `BadInput`,
    which ends with the `remedy`, where `path` cannot be written.

    >>> with replacing("fit.json") as temporary:
    ...     temporary.write_text("{}")
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise BadInput(f"{target}: the folder {target.parent} does not exist; create it first")
    if target.is_dir():
        raise BadInput(f"{target}: this is a folder; name a file to write")
    temporary = target.parent / TEMPORARY.format(secrets.token_hex(8))
    try:
        # Claimed here: some libraries report a folder without write permission unclearly.
        temporary.open("xb").close()
        yield temporary
        os.replace(temporary, target)
    except OSError as error:
        raise BadInput(
            f"{target}: cannot be written ({error.strerror or error}); {remedy}"
        ) from None
    finally:
        temporary.unlink(missing_ok=True)
