"""Captures written by the tests: images of known codes, and the files around them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest

from diffshade.errors import BadInput
from diffshade.io.read_capture import read_capture

HEIGHT, WIDTH = 12, 16
SRGB = b"\x00\x00\x00\x01sRGB\x00\xae\xce\x1c\xe9"
"""A whole sRGB chunk: length, name, perceptual intent, checksum."""


def codes(seed: int = 0, shape: tuple[int, ...] = (HEIGHT, WIDTH, 3)) -> np.ndarray:
    """16-bit codes from 2000 to 50000, no two alike often enough for a plateau."""
    return np.random.default_rng(seed).integers(2000, 50000, shape, dtype=np.uint16)


def write_png(path: Path, values: np.ndarray, *, chunk: bytes = b"") -> Path:
    """An 8- or 16-bit PNG that says nothing of its encoding, or what `chunk` says."""
    data = bytes(imagecodecs.png_encode(np.ascontiguousarray(values)))
    path.write_bytes(data[:33] + chunk + data[33:])
    return path


def write_mask(path: Path, inside: np.ndarray) -> Path:
    return write_png(path, np.where(inside, 255, 0).astype(np.uint8))


def disc(
    cx: float, cy: float, radius: float, shape: tuple[int, int] = (HEIGHT, WIDTH)
) -> np.ndarray:
    """Pixels whose centre (j + 0.5, i + 0.5) lies inside a circle."""
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    return np.hypot(x - cx, y - cy) < radius


def vectors(rows: Sequence[Sequence[float]]) -> str:
    return "".join(" ".join(map(str, row)) + "\n" for row in rows)


def photometric_stereo(folder: Path, images: Mapping[str, np.ndarray], **files: str) -> Path:
    """A folder of images lit from above, with other text files replaced or added (`a_txt=...`)."""
    folder.mkdir(exist_ok=True)
    for name, image in images.items():
        write_png(folder / name, image)
    texts = {
        "filenames_txt": "\n".join(images) + "\n",
        "light_directions_txt": vectors([(0, 0, 1)] * len(images)),
        "light_intensities_txt": vectors([(1, 1, 1)] * len(images)),
        **files,
    }
    for name, text in texts.items():
        (folder / name.replace("_txt", ".txt").replace("_json", ".json")).write_text(text)
    return folder


def refusal(path: Path, *, names: Path | str | None = None, **options: Any) -> str:
    """The message with which a capture is refused: one line, the file first, a remedy in it."""
    with pytest.raises(BadInput) as caught:
        read_capture(path, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(path if names is None else names))
    assert ";" in message or ": give" in message
    return message
