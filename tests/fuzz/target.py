"""What every parser must do with any bytes whatever: read them, or refuse them in one line."""

import re
import struct
import warnings
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
from malformed.case import Format
from malformed.cases import LONGEST, cases, formats

from diffshade.errors import BadInput
from diffshade.io.capture import Capture
from diffshade.io.image import Image
from diffshade.io.scene_toml import read_scene_toml

__all__ = ["Target", "targets"]

LARGEST_SEED = 20_000


class Target:
    """One parser, with a folder in which the files lie that the fuzzed one needs beside it."""

    def __init__(self, format: Format, folder: Path) -> None:
        self.format, self.folder = format, folder
        self.path = format.write(folder)
        self.valid = self.path.read_bytes()
        # Rendering would compile a program for every size of image.
        self.read: Callable[[Path], object] = (
            read_scene_toml if format.name == "scene" else format.read
        )

    def seeds(self, folder: Path) -> Iterator[bytes]:
        """The valid file, and the small ones among those known to be malformed."""
        yield self.valid
        for number, case in enumerate(cases()):
            if case.format.name == self.format.name and case.kind not in ("too large", "bomb"):
                place = folder / str(number)
                place.mkdir(parents=True)
                content = case.make(place).read_bytes()
                if len(content) < LARGEST_SEED:
                    yield content

    def attempt(self, content: bytes) -> bool:
        """Whether it was read; raises where neither that nor a refusal is what it should be."""
        self.path.write_bytes(repaired(content) if self.format.name == "png" else content)
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            try:
                result = self.read(self.path)
            except BadInput as error:
                message, result = str(error), None
        unexpected = [w for w in warned if not _is_note(str(w.message))]
        assert not unexpected, unexpected[0].message
        if result is None:
            assert "\n" not in message
            assert message.startswith(str(self.folder)), message
            assert len(message) < LONGEST
            return False
        for values in _numbers(result):
            assert np.isfinite(values).all(), "NaN or infinity in what was read"
        return True


def targets(folder: Path) -> Iterator[Target]:
    """All parsers, each in its own folder below this one."""
    for format in formats():
        place = folder / re.sub(r"\W+", "_", format.name)
        place.mkdir(parents=True)
        yield Target(format, place)


def repaired(content: bytes) -> bytes:
    """A PNG with the checksums that its chunks should have, so that more than these are tried.

    Files of an odd length are left alone.
    """
    if len(content) % 2:
        return content
    parts, position = [content[:8]], 8
    while position + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, position)
        end = position + 8 + length
        parts += [content[position:end], struct.pack(">I", zlib.crc32(content[position + 4 : end]))]
        position = end + 4
    return b"".join(parts)


def _is_note(message: str) -> bool:
    """What `load_mesh` warns of by its documentation."""
    return any(
        text in message
        for text in ("no materials of its own", "textures are not read", "faces have no area")
    )


def _numbers(result: object) -> Iterator[np.ndarray]:
    """All floating-point numbers that count."""
    parts: list[Any] = [result]
    if isinstance(result, Image):
        parts = [result.values, result.alpha]
    elif isinstance(result, Capture):
        parts = [result.gbuffer, result.scenes]
        parts += [image[v] for image, v in zip(result.images, result.valid, strict=True)]
    for leaf in jax.tree.leaves(parts):
        values = np.asarray(leaf) if hasattr(leaf, "dtype") else np.zeros(0)
        if np.issubdtype(values.dtype, np.floating):
            yield values
