"""Image files put together byte by byte, so that what reads them is not what made them."""

import struct
import zlib
from pathlib import Path
from typing import Any, Literal

import numpy as np
import OpenEXR
import pytest

from diffshade.errors import BadInput
from diffshade.io.image import read_image

RANDOM = np.random.default_rng(20250711)
HEIGHT, WIDTH = 5, 16
U8 = RANDOM.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
U16 = RANDOM.integers(0, 65536, (HEIGHT, WIDTH, 3), dtype=np.uint16)
F32 = RANDOM.normal(0, 10, (HEIGHT, WIDTH, 3)).astype(np.float32)
GREY, RGB, PALETTE, GREY_ALPHA, RGBA = 0, 2, 3, 4, 6
"""Colour types of PNG."""


def saved(folder: Path, content: bytes | bytearray) -> Path:
    """A file whose name says nothing of what it is."""
    path = folder / "file.dat"
    path.write_bytes(content)
    return path


def refusal(path: Path, **options: Any) -> str:
    """The message with which `path` is refused: one line that names the file and a remedy."""
    with pytest.raises(BadInput) as caught:
        read_image(path, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(f"{path}: ")
    assert ";" in message
    return message


def chunk(name: bytes, content: bytes) -> bytes:
    checksum = zlib.crc32(name + content)
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", checksum)


def gama(exponent: float) -> bytes:
    return chunk(b"gAMA", struct.pack(">I", round(exponent * 100000)))


def png(rows: list[bytes], width: int, depth: int, colour_type: int, extra: bytes = b"") -> bytes:
    """A PNG of packed rows, filter 0; `extra` chunks stand before the pixels."""
    size = struct.pack(">IIBBBBB", width, len(rows), depth, colour_type, 0, 0, 0)
    pixels = zlib.compress(b"".join(b"\0" + row for row in rows))
    chunks = chunk(b"IHDR", size) + extra + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunks


def png_of(samples: np.ndarray, colour_type: int, extra: bytes = b"") -> bytes:
    big_endian = samples.astype(samples.dtype.newbyteorder(">"))
    depth = 8 * samples.dtype.itemsize
    return png([row.tobytes() for row in big_endian], samples.shape[1], depth, colour_type, extra)


def tiff(
    samples: np.ndarray, tags: dict[int, int] | None = None, order: Literal["<", ">"] = "<"
) -> bytes:
    """An uncompressed TIFF, directory first, one strip; `tags` overrule the usual ones."""
    channels = 1 if samples.ndim == 2 else samples.shape[-1]
    strip = samples.astype(samples.dtype.newbyteorder(order)).tobytes()
    entries = {
        256: samples.shape[1],
        257: samples.shape[0],
        258: 8 * samples.dtype.itemsize,
        259: 1,
        262: 2 if channels > 2 else 1,
        273: 0,
        277: channels,
        278: samples.shape[0],
        279: len(strip),
        339: {"u": 1, "i": 2, "f": 3}[samples.dtype.kind],
        **(tags or {}),
    }
    end = 8 + 2 + 12 * len(entries) + 4
    per_sample = {tag: [entries[tag]] * channels for tag in (258, 339)}
    entries[273] = end + 2 * sum(
        2 * len(values) > 4 and len(values) for values in per_sample.values()
    )
    directory, beyond = struct.pack(order + "H", len(entries)), b""
    for tag in sorted(entries):
        values = per_sample.get(tag, [entries[tag]])
        kind = "H" if tag in per_sample else "I"
        content = struct.pack(f"{order}{len(values)}{kind}", *values).ljust(4, b"\0")
        if len(content) > 4:
            beyond, content = beyond + content, struct.pack(order + "I", end + len(beyond))
        number = {"H": 3, "I": 4}[kind]
        directory += struct.pack(order + "HHI", tag, number, len(values)) + content
    header = (b"II" if order == "<" else b"MM") + struct.pack(order + "HI", 42, 8)
    return header + directory + bytes(4) + beyond + strip


def radiance(
    rgbe: np.ndarray,
    header: str = "FORMAT=32-bit_rle_rgbe\n",
    axes: str = "-Y {} +X {}",
) -> bytes:
    """Radiance with run-length encoded scanlines: plain runs, and one repeated where it can be."""
    height, width = rgbe.shape[:2]
    body = b""
    for row in rgbe:
        body += bytes([2, 2, width >> 8, width & 255])
        for plane in row.T:
            same = (plane == plane[0]).all()
            body += bytes([128 + width, plane[0]]) if same else bytes([width]) + plane.tobytes()
    return f"#?RADIANCE\n# by hand\n{header}\n{axes.format(height, width)}\n".encode() + body


Fields = dict[int, tuple[int, list[int] | bytes]]
"""tag: (type, values); 1 byte, 2 text, 3 short, 4 long, 5 rational, 10 signed rational."""


def dng(sensor: np.ndarray, black: int, white: int, more: Fields | None = None) -> bytes:
    """A DNG with a Bayer mosaic of 16 bits; `more` fields are added, or replace the usual ones."""
    fields: Fields = {
        254: (4, [0]), 256: (4, [sensor.shape[1]]), 257: (4, [sensor.shape[0]]), 258: (3, [16]),
        259: (3, [1]), 262: (3, [32803]), 271: (2, b"Hand\0"), 272: (2, b"Made\0"), 273: (4, [0]),
        274: (3, [1]), 277: (3, [1]), 278: (4, [sensor.shape[0]]), 279: (4, [2 * sensor.size]),
        33421: (3, [2, 2]), 33422: (1, [0, 1, 1, 2]), 50706: (1, [1, 4, 0, 0]),
        50708: (2, b"Hand Made\0"), 50714: (4, [black]), 50717: (4, [white]),
        50721: (10, [1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1]), 50778: (3, [21]),
        **(more or {}),
    }  # fmt: skip
    end = 8 + 2 + 12 * len(fields) + 4
    packed: dict[int, tuple[int, int, bytes]] = {}
    for tag, (kind, values) in sorted(fields.items()):
        code = {1: "B", 2: "s", 3: "H", 4: "I", 5: "I", 10: "i"}[kind]
        raw = bytes(values) if kind == 2 else struct.pack(f"<{len(values)}{code}", *values)
        packed[tag] = (kind, len(values) // (2 if kind in (5, 10) else 1), raw)
    packed[273] = (
        4,
        1,
        struct.pack("<I", end + sum(len(r) for *_, r in packed.values() if len(r) > 4)),
    )
    directory, beyond = struct.pack("<H", len(packed)), b""
    for tag, (kind, count, raw) in packed.items():
        if len(raw) > 4:
            raw, beyond = struct.pack("<I", end + len(beyond)), beyond + raw
        directory += struct.pack("<HHI", tag, kind, count) + raw.ljust(4, b"\0")
    return b"II*\0" + struct.pack("<I", 8) + directory + bytes(4) + beyond + sensor.tobytes()


def write_channels(path: Path, channels: dict[str, np.ndarray], **header: object) -> Path:
    settings = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    OpenEXR.File(settings, channels).write(str(path))
    return path


def rgbe_and_values() -> tuple[np.ndarray, np.ndarray]:
    rgbe = RANDOM.integers(1, 256, (HEIGHT, WIDTH, 4), dtype=np.uint8)
    rgbe[..., 3] = RANDOM.integers(120, 140, (HEIGHT, WIDTH))
    rgbe[0] = (128, 64, 32, 129)  # a repeated run, of the values 1, 0.5 and 0.25
    return rgbe, np.ldexp(rgbe[..., :3].astype(np.float32), rgbe[..., 3:].astype(int) - 136)
