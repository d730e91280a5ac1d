"""OpenEXR: linear half or float channels, with names.

`read_channels` gives every channel of every part; `read` the image among them.
"""

import math
import os
import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from diffshade.errors import BadInput
from diffshade.io.decoded import Decoded, Pixels
from diffshade.io.encoding import Encoding
from diffshade.io.limits import check_size
from diffshade.io.quiet import quietly

__all__ = ["SIGNATURE", "by_layer", "listed", "read", "read_channels", "write", "write_channels"]

SIGNATURE = b"\x76\x2f\x31\x01"
_TILED, _DEEP, _MULTIPART = 0x200, 0x800, 0x1000


def read(path: Path, layer: str | None = None) -> Decoded:
    """R, G, B or Y, and A where there is one, of `layer`; None is the layer without a name.

    Raises `BadInput` that names the layers where the one asked for holds no such image.
    """
    layers = by_layer(read_channels(path))
    channels = layers.get(layer or "", {})
    names = _image_channels(set(channels))
    if not names:
        asked = "no plain R, G, B or Y" if layer is None else f"no image in a layer {layer!r}"
        raise BadInput(f"has {asked}; name with layer= one that has, of: {listed(layers)}")
    planes = [channels[name] for name in names]
    if not all(np.issubdtype(plane.dtype, np.floating) for plane in planes):
        raise BadInput("has integer colour channels; save them as half or float")
    samples = np.stack(planes, axis=-1)
    return Decoded(samples, None, bits=8 * samples.dtype.itemsize, encoding=Encoding.LINEAR)


def read_channels(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """All channels by full name, each [H, W], float16, float32 or uint32 as stored.

    A channel of a named part is called `part.channel`. Raises `BadInput`, without the name of the
    file, for what is truncated, deep, subsampled or cropped.
    """
    import OpenEXR

    expected_parts = _check_structure(Path(path).read_bytes())
    with quietly(), OpenEXR.File(os.fspath(path), separate_channels=True) as file:
        # OpenEXR leaves out a part that it cannot decode, without raising.
        if len(file.parts) != expected_parts:
            raise BadInput("is damaged: not all of it decodes; copy or export it again")
        channels: dict[str, np.ndarray] = {}
        for part in file.parts:
            _check_windows(part.header)
            for name, channel in part.channels.items():
                if (channel.xSampling, channel.ySampling) != (1, 1):
                    raise BadInput(f"has the subsampled channel {name}; save it as R, G, B")
                channels[_full_name(part.name(), name)] = channel.pixels
    if len({pixels.shape for pixels in channels.values()}) != 1:
        raise BadInput("has parts of different sizes; save the one that is meant alone")
    return channels


def write(path: Path, linear: Pixels) -> None:
    """float32 R, G, B or, for C = 1, Y; compressed without loss."""
    import OpenEXR

    values = np.ascontiguousarray(linear, dtype=np.float32)
    channels = {"Y": values[..., 0].copy()} if values.shape[-1] == 1 else {"RGB": values}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(os.fspath(path))


def write_channels(path: Path, channels: dict[str, np.ndarray]) -> None:
    """Channels by full name, each [H, W], float16, float32 or uint32; compressed without loss."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    planes = {name: np.ascontiguousarray(plane) for name, plane in channels.items()}
    with OpenEXR.File(header, planes) as file:
        file.write(os.fspath(path))


def by_layer(channels: dict[str, np.ndarray]) -> dict[str, dict[str, np.ndarray]]:
    """Channels by the name of their layer, which is all but the last part of theirs."""
    layers: dict[str, dict[str, np.ndarray]] = {}
    for full_name, pixels in channels.items():
        layer, _, name = full_name.rpartition(".")
        layers.setdefault(layer, {})[name] = pixels
    return layers


def listed(layers: dict[str, dict[str, np.ndarray]]) -> str:
    """The layers with the names of their channels, for a complaint."""
    return ", ".join(f"{n or '(no name)'} [{' '.join(sorted(own))}]" for n, own in layers.items())


def _image_channels(names: set[str]) -> tuple[str, ...]:
    """The colour channels in order, alpha last; nothing where there is no image."""
    alpha = ("A",) if "A" in names else ()
    if {"R", "G", "B"} <= names:
        return ("R", "G", "B", *alpha)
    # Y beside X is a coordinate, beside RY and BY it is luminance with its colour elsewhere.
    if "Y" in names and not names & {"X", "RY", "BY"}:
        return ("Y", *alpha)
    return ()


def _full_name(part: str, channel: str) -> str:
    return channel if not part or channel.startswith(part + ".") else f"{part}.{channel}"


def _check_windows(header: dict[str, Any]) -> None:
    data, display = (np.asarray(header[key]).tolist() for key in ("dataWindow", "displayWindow"))
    if data != display:
        raise BadInput(f"is cropped: data window {data}, display window {display}; save it whole")


def _check_structure(data: bytes) -> int:
    """The number of parts, after a check that every chunk lies within the file, and of what they claim.

    OpenEXR reports a truncated file on standard output, which belongs to our caller, and goes on.
    """
    flags = int.from_bytes(data[4:8], "little")
    if flags & _DEEP:
        raise BadInput("holds deep data; flatten it")
    try:
        position, parts = _headers(data, flags)
        for part in parts:
            check_size(part.size)
            check_size(part.tile)
        check_size((sum(math.prod(part.size) for part in parts),))
        tiled = [part.tiled for part in parts]
        complete = _all_chunks_inside(data, position, tiled, multipart=bool(flags & _MULTIPART))
    except BadInput:
        raise
    except (struct.error, ValueError, IndexError):
        complete = False
    if not complete:
        raise BadInput("is truncated or was never finished; copy or export it again")
    return len(parts)


class _Part(NamedTuple):
    tiled: bool
    size: tuple[int, ...]
    """Height, width and channels."""
    tile: tuple[int, ...]


def _headers(data: bytes, flags: int) -> tuple[int, list[_Part]]:
    """Where the headers end, and what each part claims to be.

    An attribute is: name, 0, type, 0, size, value; an empty name ends a header, and in a file of
    several parts an empty header ends them all.
    """
    position, parts = 8, []
    while True:
        tiled, window, channels, tile = bool(flags & _TILED), (0, 0, 0, 0), 1, (1, 1)
        missing = {b"channels", b"compression", b"dataWindow", b"displayWindow"}
        while data[position]:
            name_end = data.index(b"\0", position)
            type_end = data.index(b"\0", name_end + 1)
            (size,) = struct.unpack_from("<I", data, type_end + 1)
            value = data[type_end + 5 : type_end + 5 + size]
            missing.discard(data[position:name_end])
            match data[position:name_end]:
                case b"type":
                    tiled = value == b"tiledimage"
                case b"dataWindow":
                    window = struct.unpack("<4i", value)
                case b"channels":
                    channels = _channel_count(value)
                case b"tiles":
                    tile = struct.unpack_from("<2I", value)
            position = type_end + 5 + size
        position += 1
        if missing:
            raise BadInput(f"has no {min(missing).decode()}; export it again")
        left, top, right, bottom = window
        height, width = bottom - top + 1, right - left + 1
        if min(height, width) < 1:
            raise BadInput(f"has {width} x {height} pixels; export it again")
        parts.append(_Part(tiled, (height, width, channels), (*tile, channels)))
        if not flags & _MULTIPART:
            return position, parts
        if not data[position]:
            return position + 1, parts


def _channel_count(value: bytes) -> int:
    """Of a list of names, each with 0 and 16 bytes after it, and 0 at the end."""
    position = count = 0
    while value[position]:
        position = value.index(b"\0", position) + 17
        count += 1
    return count


def _all_chunks_inside(data: bytes, position: int, tiled: list[bool], *, multipart: bool) -> bool:
    """Walks the table of chunk offsets at `position`, which ends where the first chunk begins."""
    lowest = len(data)
    while position < lowest:
        (chunk,) = struct.unpack_from("<Q", data, position)
        position += 8
        part, leader = 0, chunk
        if multipart:
            (part,) = struct.unpack_from("<I", data, chunk)
            leader += 4
        size_at = leader + (16 if tiled[part] else 4)
        (size,) = struct.unpack_from("<I", data, size_at)
        if chunk < position or size_at + 4 + size > len(data):
            return False
        lowest = min(lowest, chunk)
    return True
