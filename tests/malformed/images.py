"""Malformed images."""

import io
import struct
import zlib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import imagecodecs
import numpy as np
import PIL.Image
from handmade import (
    F32,
    RGB,
    U8,
    U16,
    chunk,
    png,
    png_of,
    radiance,
    rgbe_and_values,
    tiff,
    write_channels,
)
from malformed.case import Case, Format, any_file, damaged

from diffshade.io.image import read_image

HUGE = 100_000


def _file(name: str, file: str, content: Callable[[], bytes]) -> Format:
    return Format(name, file, lambda folder: (folder / file).write_bytes(content()), read_image)


@cache
def _jpeg() -> bytes:
    return bytes(imagecodecs.jpeg8_encode(np.tile(U8, (8, 4, 1)), level=90))


@cache
def _deflated(megabytes: int) -> bytes:
    packer = zlib.compressobj(9)
    block = bytes(2**20)
    return b"".join(packer.compress(block) for _ in range(megabytes)) + packer.flush()


PNG = _file("png", "a.png", lambda: png_of(U8, RGB))
JPEG = _file("jpeg", "a.jpg", _jpeg)
TIFF = _file("tiff", "a.tif", lambda: tiff(U16))
HDR = _file("hdr", "a.hdr", lambda: radiance(rgbe_and_values()[0]))
EXR = Format(
    "exr", "a.exr", lambda folder: write_channels(folder / "a.exr", {"RGB": F32}), read_image
)
FORMATS = (PNG, JPEG, TIFF, HDR, EXR)


def _whole(format: Format, kind: str, name: str, content: Callable[[], bytes]) -> Case:
    return damaged(format, kind, name, lambda _: content())


def _exr(format: Format, kind: str, name: str, write: Callable[[Path], object]) -> Case:
    def make(folder: Path) -> Path:
        write(folder / format.file)
        return folder / format.file

    return Case(format, kind, name, make)


def _ihdr(width: int, height: int, depth: int = 8, colour: int = RGB) -> bytes:
    return chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0))


def _png_claims(width: int, height: int, pixels: bytes, depth: int = 8, colour: int = RGB) -> bytes:
    return (
        b"\x89PNG\r\n\x1a\n"
        + _ihdr(width, height, depth, colour)
        + chunk(b"IDAT", pixels)
        + chunk(b"IEND", b"")
    )


def of_png() -> Iterator[Case]:
    yield from any_file(PNG)
    few = zlib.compress(bytes(100))
    whole = png_of(U8, RGB)
    for width, height in ((HUGE, HUGE), (2**31 - 1, 2**31 - 1), (1, 2**31 - 1)):
        yield _whole(
            PNG,
            "absurd header",
            f"{width} x {height}",
            lambda w=width, h=height: _png_claims(w, h, few),
        )
    for megabytes, side in ((16, 20_000), (64, 30_000)):
        yield _whole(
            PNG,
            "bomb",
            f"{side} x {side} of zeros",
            lambda m=megabytes, n=side: _png_claims(n, n, _deflated(m)),
        )
    for name, depth, colour in (("3 bits", 3, RGB), ("colour 5", 8, 5), ("RGB of 4", 4, RGB)):
        yield _whole(
            PNG, "wrong dtype", name, lambda d=depth, c=colour: _png_claims(8, 8, few, d, c)
        )
    for width, height in ((0, 5), (5, 0)):
        yield _whole(
            PNG,
            "wrong shape",
            f"{width} x {height}",
            lambda w=width, h=height: _png_claims(w, h, few),
        )
    yield _whole(PNG, "wrong shape", "animated", lambda: png_of(U8, RGB, chunk(b"acTL", bytes(8))))
    start, idat = len(b"\x89PNG\r\n\x1a\n"), whole.index(b"IDAT") - 4
    yield _whole(PNG, "missing key", "no IHDR", lambda: whole[:start] + whole[idat:])
    yield _whole(
        PNG, "missing key", "no IDAT", lambda: whole[:idat] + whole[whole.index(b"IEND") - 4 :]
    )
    yield _whole(PNG, "missing key", "no palette", lambda: png([b"\0"] * 2, 8, 1, 3))
    yield _whole(
        PNG, "wrong type", "IDAT is text", lambda: _png_claims(8, 8, b"these are no pixels")
    )
    yield damaged(PNG, "wrong type", "a wrong checksum", lambda c: c[:-20] + b"\1" + c[-19:])


def _sof(content: bytes) -> int:
    return content.index(b"\xff\xc0")


def _cmyk() -> bytes:
    buffer = io.BytesIO()
    PIL.Image.new("CMYK", (8, 8)).save(buffer, "jpeg")
    return buffer.getvalue()


def of_jpeg() -> Iterator[Case]:
    yield from any_file(JPEG)

    def claims(height: int, width: int) -> Callable[[bytes], bytes]:
        def change(content: bytes) -> bytes:
            at = _sof(content) + 5
            return content[:at] + struct.pack(">HH", height, width) + content[at + 4 :]

        return change

    for height, width in ((65_500, 65_500), (65_500, 20_000)):
        yield damaged(JPEG, "absurd header", f"{height} x {width}", claims(height, width))
    yield damaged(JPEG, "bomb", "16,000 x 16,000 of one block", claims(16_000, 16_000))
    yield damaged(JPEG, "bomb", "30,000 x 30,000 of one block", claims(30_000, 30_000))
    yield damaged(JPEG, "wrong shape", "no rows", claims(0, 64))
    yield damaged(JPEG, "wrong shape", "no columns", claims(64, 0))
    yield _whole(JPEG, "wrong shape", "CMYK", _cmyk)
    yield damaged(
        JPEG,
        "wrong dtype",
        "12 bits",
        lambda c: c[: _sof(c) + 4] + b"\x0c" + c[_sof(c) + 5 :],
    )
    yield damaged(
        JPEG,
        "wrong dtype",
        "lossless",
        lambda c: c.replace(b"\xff\xc0", b"\xff\xc3", 1),
    )
    yield damaged(JPEG, "missing key", "no frame", lambda c: c.replace(b"\xff\xc0", b"\xff\xe5", 1))
    yield damaged(JPEG, "missing key", "no tables", lambda c: c.replace(b"\xff\xdb", b"\xff\xe5"))
    yield damaged(JPEG, "missing key", "no scan", lambda c: c[: c.index(b"\xff\xda")])


def of_tiff() -> Iterator[Case]:
    yield from any_file(TIFF)
    grey = U8[..., 0]

    def tags(kind: str, name: str, changed: dict[int, int], samples: np.ndarray = grey) -> Case:
        return _whole(TIFF, kind, name, lambda: tiff(samples, changed))

    yield tags("absurd header", "100,000 x 100,000", {256: HUGE, 257: HUGE})
    yield tags("absurd header", "4e9 rows", {257: 2**32 - 1})
    yield tags("absurd header", "tiles", {322: 2**31, 323: 2**31})
    yield tags("absurd header", "tiles of one size only", {322: 2**31})
    yield tags("absurd header", "depth", {32997: 2**31})
    yield tags("absurd header", "channels", {277: 65_535, 256: HUGE})

    def packed(side: int) -> bytes:
        strip = _deflated(16)
        whole = tiff(grey, {256: side, 257: side, 259: 8, 278: side, 279: len(strip)})
        return whole[: -grey.size] + strip

    yield _whole(TIFF, "bomb", "30,000 x 30,000", lambda: packed(30_000))
    yield _whole(TIFF, "bomb", "90,000 x 90,000", lambda: packed(90_000))

    def many_tags(content: bytes) -> bytes:
        """65,535 times the same tag of a million values: hours, if each were looked at."""
        entry = struct.pack("<HHII", 258, 1, 10**6, 8)
        directory = struct.pack("<H", 65_535) + entry * 65_535 + bytes(4)
        return b"II*\0" + struct.pack("<I", 8) + directory + bytes(10**6)

    yield damaged(TIFF, "bomb", "tags", many_tags)
    yield tags("wrong dtype", "signed", {339: 2})
    yield tags("wrong dtype", "complex", {339: 6})
    yield _whole(TIFF, "wrong dtype", "64-bit", lambda: tiff(U8.astype(np.uint64)))
    yield tags("wrong dtype", "palette", {262: 3})
    yield tags("wrong dtype", "compression", {259: 60_000})
    yield tags("wrong shape", "no row", {257: 0})
    yield tags("wrong shape", "five channels", {277: 5})
    yield _whole(
        TIFF,
        "wrong shape",
        "pages",
        lambda: bytes(imagecodecs.tiff_encode(U8[:, None, :, 0].copy(), photometric=1)),
    )
    for value in (np.nan, np.inf):
        yield _whole(
            TIFF, "NaN", str(value), lambda v=value: tiff(np.where(F32 > 3, v, F32).astype("f4"))
        )

    def without(tag: int) -> Callable[[bytes], bytes]:
        def change(content: bytes) -> bytes:
            return content.replace(struct.pack("<HH", tag, 4), struct.pack("<HH", 60_000, 4), 1)

        return change

    yield damaged(TIFF, "missing key", "no width", without(256))
    yield damaged(TIFF, "missing key", "no strips", without(273))
    yield damaged(
        TIFF,
        "wrong type",
        "width in text",
        lambda c: c.replace(struct.pack("<HH", 256, 4), struct.pack("<HH", 256, 2), 1),
    )


def of_hdr() -> Iterator[Case]:
    yield from any_file(HDR)
    rgbe = rgbe_and_values()[0]

    def changed(kind: str, name: str, header: str = "", axes: str = "-Y {} +X {}") -> Case:
        return _whole(HDR, kind, name, lambda: radiance(rgbe, header, axes))

    yield changed("absurd header", "100,000 x 100,000", axes=f"-Y {HUGE} +X {HUGE}")
    yield changed("absurd header", "a number of 5,000 digits", axes=f"-Y {'9' * 5000} +X 16")
    yield changed("bomb", "30,000 x 30,000", axes="-Y 30000 +X 30000")
    yield changed("bomb", "1 x 2e9", axes="-Y 1 +X 2000000000")
    yield changed("wrong dtype", "XYZE", "FORMAT=32-bit_rle_xyze\n")
    yield changed("wrong dtype", "no format", "FORMAT=float\n")
    yield changed("wrong shape", "no row", axes="-Y 0 +X 16")
    yield changed("wrong shape", "one axis", axes="-Y 5")
    yield changed("wrong shape", "turned", axes="+X 5 -Y 16")
    yield changed("NaN", "exposure", "EXPOSURE=nan\n")
    yield changed("NaN", "infinite exposure", "EXPOSURE=1e300\nEXPOSURE=1e300\n")
    yield changed("NaN", "no exposure", "EXPOSURE=1e-300\n")
    yield changed("missing key", "no resolution", axes="")
    yield damaged(HDR, "missing key", "no blank line", lambda c: c.replace(b"\n\n", b"\n"))
    yield changed("wrong type", "exposure in words", "EXPOSURE=bright\n")
    yield changed("wrong type", "two numbers", "COLORCORR=1 2\n")
    yield changed("wrong type", "size in words", axes="-Y five +X 16")


def of_exr() -> Iterator[Case]:
    yield from any_file(EXR)

    def window(right: int, bottom: int, left: int = 0, top: int = 0) -> Callable[[bytes], bytes]:
        def change(content: bytes) -> bytes:
            for name in (b"dataWindow\0", b"displayWindow\0"):
                at = content.index(name) + len(name) + len(b"box2i\0") + 4
                content = (
                    content[:at] + struct.pack("<4i", left, top, right, bottom) + content[at + 16 :]
                )
            return content

        return change

    yield damaged(EXR, "absurd header", "100,000 x 100,000", window(HUGE, HUGE))
    yield damaged(EXR, "absurd header", "2^31 columns", window(2**31 - 1, 4, -(2**31)))
    yield damaged(EXR, "bomb", "30,000 x 30,000", window(29_999, 29_999))
    yield damaged(EXR, "bomb", "one row", window(2**31 - 2, 0))
    yield damaged(EXR, "wrong shape", "no pixel", window(-1, -1))
    yield damaged(EXR, "wrong shape", "the wrong way round", window(-9, -9))
    inner = np.array([0, 0], np.int32), np.array([99, 99], np.int32)
    yield _exr(
        EXR,
        "wrong shape",
        "cropped",
        lambda path: write_channels(path, {"RGB": F32}, displayWindow=inner),
    )
    ids = {c: U16[..., 0].astype(np.uint32) for c in "RGB"}
    yield _exr(EXR, "wrong dtype", "integers", lambda path: write_channels(path, ids))
    yield damaged(
        EXR,
        "wrong dtype",
        "unknown pixel type",
        lambda c: c.replace(b"R\0" + struct.pack("<I", 2), b"R\0" + struct.pack("<I", 9), 1),
    )
    for value in (np.nan, np.inf, -np.inf):
        plane = np.where(F32 > 3, value, F32).astype(np.float32)
        yield _exr(EXR, "NaN", str(value), lambda path, p=plane: write_channels(path, {"RGB": p}))
    depth = {c: F32[..., 0].copy() for c in "XZ"}
    yield _exr(EXR, "missing key", "no colour", lambda path: write_channels(path, depth))
    for key in (b"dataWindow\0", b"compression\0", b"channels\0"):
        yield damaged(
            EXR,
            "missing key",
            f"no {key[:-1].decode()}",
            lambda c, k=key: c.replace(k, k[:-2] + b"_\0", 1),
        )
    yield damaged(
        EXR, "wrong type", "window as text", lambda c: c.replace(b"box2i\0", b"string\0", 1)
    )
    yield damaged(EXR, "wrong type", "deep", lambda c: c[:5] + b"\x08" + c[6:])


def cases() -> Iterator[Case]:
    for of in (of_png, of_jpeg, of_tiff, of_hdr, of_exr):
        yield from of()
