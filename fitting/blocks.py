"""Long work in blocks: progress after each, and a folder in which finished blocks outlive an interrupt.

The folder holds `blocks.json`, which says what it is of, and a `block-00000.npz` for each finished
block. Every file appears whole or not at all.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np

from diffshade.errors import BadInput
from diffshade.io.atomic import TEMPORARY, replacing
from diffshade.progress import Progress

__all__ = ["Arrays", "Folder", "Progress", "fingerprint", "in_blocks"]

Arrays = dict[str, np.ndarray]
Folder = str | os.PathLike[str]

SCHEMA = "diffshade.blocks/1"
INDEX = "blocks.json"


def fingerprint(*inputs: Any) -> str:
    """A digest of trees of arrays: their structure, and every type, shape and value."""
    digest = hashlib.blake2b(digest_size=16)
    leaves, structure = jax.tree.flatten(inputs)
    digest.update(str(structure).encode())
    for leaf in leaves:
        array = np.asarray(leaf)
        digest.update(f"{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def in_blocks(
    count: int,
    begin: Callable[[int], Callable[[], Arrays]],
    *,
    progress: Progress | None,
    folder: Folder | None,
    inputs: Callable[[], str],
) -> Iterator[Arrays]:
    """The results of `count` blocks in order.

    `begin(i)` starts block i and returns what waits for its result: the next is begun before that of
    the last is waited for. With a `folder` each is written as soon as it is there, and read, not
    computed, where it was written before; `inputs()` is the digest of what all depends on.
    `progress(finished, count)` is called after each; if it raises, what is finished stays written.
    """
    store = None if folder is None else _opened(Path(folder), inputs(), count)
    waiting: Callable[[], Arrays] | None = None

    def started(i: int) -> Callable[[], Arrays]:
        path = None if store is None else store / f"block-{i:05d}.npz"
        stored = None if path is None else _read(path)
        if stored is not None:
            return lambda: stored
        wait = begin(i)
        return wait if path is None else lambda: _written(path, wait())

    for i in range(count):
        current = started(i) if waiting is None else waiting
        waiting = started(i + 1) if i + 1 < count else None
        result = current()
        if progress is not None:
            progress(i + 1, count)
        yield result


def _opened(folder: Path, inputs: str, count: int) -> Path:
    """The folder, if it is of the same work or empty."""
    index = {"schema": SCHEMA, "inputs": inputs, "blocks": count}
    path = folder / INDEX
    if path.exists():
        try:
            found = json.loads(path.read_text())
        except (OSError, ValueError):
            found = None
        if found != index:
            raise BadInput(
                f"{folder}: this folder holds blocks of other images, scenes or options; choose"
                " another, or remove it to start again"
            )
        return _tidied(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(not file.name.startswith(".") for file in folder.iterdir()):
            raise BadInput(
                f"{folder}: this folder holds other files; choose an empty one, or a new name"
            )
    except OSError as error:
        raise BadInput(
            f"{folder}: cannot be written ({error.strerror or error}); choose another place"
        ) from None
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(index))
    return _tidied(folder)


def _tidied(folder: Path) -> Path:
    """Without what a process left that was killed as it wrote."""
    for left in folder.glob(TEMPORARY.format("*")):
        left.unlink(missing_ok=True)
    return folder


def _read(path: Path) -> Arrays | None:
    """A finished block; None where it is not there, or damaged, as by a loss of power."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return dict(stored)
    except Exception:  # NumPy and zipfile raise types of many kinds
        return None


def _written(path: Path, arrays: Arrays) -> Arrays:
    remedy = "make room, and call again with this folder to continue"
    with replacing(path, remedy=remedy) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]
    return arrays
