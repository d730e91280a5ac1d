"""TIFF 6.0 and BigTIFF: pixels through libtiff, their meaning from the tags.

A camera's RAW file is mostly a TIFF too; its tags tell (DNGVersion, or a colour filter array).
Rows are taken as stored: the Orientation tag is not applied.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from diffshade.errors import BadInput
from diffshade.io.decoded import Decoded, with_channels
from diffshade.io.encoding import Encoding
from diffshade.io.limits import check_size

__all__ = ["SIGNATURES", "is_camera_raw", "read"]

SIGNATURES = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")


class Tag(IntEnum):
    """The tags that say what the samples mean."""

    NEW_SUBFILE_TYPE = 254
    WIDTH = 256
    LENGTH = 257
    BITS_PER_SAMPLE = 258
    PHOTOMETRIC = 262
    SAMPLES_PER_PIXEL = 277
    PLANAR_CONFIGURATION = 284
    TILE_WIDTH = 322
    TILE_LENGTH = 323
    SUB_IFDS = 330
    SAMPLE_FORMAT = 339
    IMAGE_DEPTH = 32997
    TILE_DEPTH = 32998
    DNG_VERSION = 50706


Directory = dict[int, tuple[int, ...]]

_WANTED = frozenset(Tag)
_TYPES = {1: "B", 3: "H", 4: "I", 13: "I", 16: "Q", 18: "Q"}
_REDUCED_IMAGE = 1
_MIN_IS_WHITE, _MIN_IS_BLACK, _RGB = 0, 1, 2
_PHOTOMETRIC_NAMES = {3: "palette", 4: "mask", 5: "CMYK", 6: "YCbCr", 8: "CIE L*a*b*"}
_RAW_PHOTOMETRIC = {32803, 34892}
_UNSIGNED, _FLOAT = 1, 3
_SEPARATE_PLANES = 2
_MOST = 1000
"""Directories of a file and values of a tag that make sense."""


def read(data: bytes) -> Decoded:
    """Samples of a grey or RGB TIFF with one page, unsigned integers or floating point.

    Floating point counts as linear, by the habit of the field; integers say nothing of themselves.
    """
    import imagecodecs

    pages = _directories(data)
    for page in pages:
        _check_sizes(page)
    tags = _only_page(pages)
    photometric = _tag(tags, Tag.PHOTOMETRIC, _MIN_IS_BLACK)
    if photometric not in (_MIN_IS_WHITE, _MIN_IS_BLACK, _RGB):
        kind = _PHOTOMETRIC_NAMES.get(photometric, f"photometric {photometric}")
        raise BadInput(f"is a {kind} TIFF; save it as grey or RGB")
    is_float, bits = _sample_type(tags)
    array = imagecodecs.tiff_decode(data)
    if _tag(tags, Tag.PLANAR_CONFIGURATION, 1) == _SEPARATE_PLANES and array.ndim == 3:
        array = np.moveaxis(array, 0, -1)
    samples = with_channels(array)
    if samples.shape[-1] != _tag(tags, Tag.SAMPLES_PER_PIXEL, 1):
        raise BadInput(
            f"decodes to {samples.shape[-1]} channels, against its own tags; export it again"
        )
    if is_float:
        return Decoded(samples, full_code=None, bits=bits, encoding=Encoding.LINEAR)
    full_code = 2**bits - 1
    if photometric == _MIN_IS_WHITE:
        samples = np.subtract(full_code, samples, dtype=np.uint32)
    return Decoded(samples, full_code=full_code, bits=bits, encoding=Encoding.UNKNOWN)


def is_camera_raw(data: bytes) -> bool:
    """Whether the TIFF holds sensor data rather than a picture; raises `BadInput` if damaged."""
    return any(
        Tag.DNG_VERSION in tags or _tag(tags, Tag.PHOTOMETRIC, 0) in _RAW_PHOTOMETRIC
        for tags in _directories(data, sub_directories=True)
    )


def _check_sizes(tags: Directory) -> None:
    """Refuse what the image, or one of its tiles, claims to hold if it is absurd."""
    channels = _tag(tags, Tag.SAMPLES_PER_PIXEL, 1)
    image = (Tag.IMAGE_DEPTH, 1), (Tag.LENGTH, 0), (Tag.WIDTH, 0)
    depth, length, width = (_tag(tags, *each) for each in image)
    # What a tile does not say is that of the image
    tile = (Tag.TILE_DEPTH, depth), (Tag.TILE_LENGTH, length), (Tag.TILE_WIDTH, width)
    for solid in ((depth, length, width), tuple(_tag(tags, *each) for each in tile)):
        check_size((*(solid if solid[0] > 1 else solid[1:]), channels))


def _only_page(pages: list[Directory]) -> Directory:
    whole = [p for p in pages if not _tag(p, Tag.NEW_SUBFILE_TYPE, 0) & _REDUCED_IMAGE]
    if len(whole) != 1:
        raise BadInput(f"holds {len(whole)} pages; save the one that is meant as a file of its own")
    return whole[0]


def _sample_type(tags: Directory) -> tuple[bool, int]:
    """Whether samples are floating point, and their bits."""
    formats = set(tags.get(Tag.SAMPLE_FORMAT, (_UNSIGNED,)))
    widths = set(tags.get(Tag.BITS_PER_SAMPLE, (1,)))
    if len(formats) != 1 or len(widths) != 1:
        raise BadInput("has channels of different types; save all of them as one type")
    sample_format, bits = formats.pop(), widths.pop()
    if sample_format not in (_UNSIGNED, _FLOAT) or bits > 64:
        raise BadInput("has signed or complex samples; save them as unsigned integers or as float")
    if sample_format == _UNSIGNED and bits > 32:
        raise BadInput(f"has {bits}-bit integers; save it with 16 bits, or as float")
    return sample_format == _FLOAT, bits


def _tag(tags: Directory, tag: Tag, default: int) -> int:
    return next(iter(tags.get(tag, ())), default)


@dataclass(frozen=True)
class _Layout:
    """Where classic TIFF and BigTIFF differ."""

    order: str
    word: str
    count: str

    @property
    def inline(self) -> int:
        """Bytes of value that fit into an entry."""
        return struct.calcsize("=" + self.word)

    def get(self, code: str, data: bytes, position: int) -> tuple[int, ...]:
        return struct.unpack_from(self.order + code, data, position)


def _directories(data: bytes, *, sub_directories: bool = False) -> list[Directory]:
    """All directories in their order; those of pictures within pictures if asked for."""
    try:
        return list(_walk(data, sub_directories=sub_directories))
    except struct.error:
        raise BadInput("is truncated or damaged in its tags; copy or export it again") from None


def _walk(data: bytes, *, sub_directories: bool) -> Iterator[Directory]:
    order = "<" if data[:2] == b"II" else ">"
    big = data[2:4] in (b"+\x00", b"\x00+")
    layout = _Layout(order, "Q", "Q") if big else _Layout(order, "I", "H")
    waiting = list(layout.get(layout.word, data, 8 if big else 4))
    seen = {0}
    while waiting:
        position = waiting.pop(0)
        if position in seen:
            continue
        if len(seen) > _MOST:
            raise BadInput(f"has more than {_MOST} directories; save one page of it")
        seen.add(position)
        tags, following = _directory(data, position, layout)
        waiting.append(following)
        if sub_directories:
            waiting.extend(tags.get(Tag.SUB_IFDS, ()))
        yield tags


def _directory(data: bytes, position: int, layout: _Layout) -> tuple[Directory, int]:
    """The wanted tags of the directory at `position`, and where the next one stands."""
    (entries,) = layout.get(layout.count, data, position)
    position += struct.calcsize("=" + layout.count)
    tags: Directory = {}
    for _ in range(entries):
        tag, kind, count = layout.get("HH" + layout.word, data, position)
        field = position + 4 + layout.inline
        position = field + layout.inline
        if tag in _WANTED and tag not in tags and kind in _TYPES:
            if count > _MOST:
                raise BadInput(f"has {count} values in its tag {tag}; export it again")
            code = f"{count}{_TYPES[kind]}"
            if struct.calcsize("=" + code) > layout.inline:
                (field,) = layout.get(layout.word, data, field)
            tags[tag] = layout.get(code, data, field)
    (following,) = layout.get(layout.word, data, position)
    return tags, following
