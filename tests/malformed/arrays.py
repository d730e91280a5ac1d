"""Malformed files of arrays: G-buffers (`.npz`), normals (`.npy`, `.mat`)."""

import io
import pickle
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from handmade import write_channels
from malformed.case import Case, Format, any_file, damaged

from diffshade.io.exr import read_channels
from diffshade.io.exr_gbuffer import load_exr_gbuffer
from diffshade.io.gbuffer import load_gbuffer
from diffshade.io.normals_file import normals_gbuffer, read_normals

NORMAL = np.zeros((4, 5, 3)) + np.array([0.0, 0.6, 0.8])
HUGE = 100_000


class Trap:
    """Writes a file when it is unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.write_text, (Path("trap"), "sprung")


def npz(compress: int = zipfile.ZIP_STORED, **arrays: Any) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compress) as archive:
        for name, array in arrays.items():
            content = array if isinstance(array, bytes) else npy(array)
            archive.writestr(f"{name}.npy", content)
    return file.getvalue()


def npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


def claims(shape: str, descr: str = "'<f8'", data: bytes = bytes(480)) -> bytes:
    """An `.npy` file with this header, whatever the data."""
    header = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


def mat(**variables: Any) -> bytes:
    file = io.BytesIO()
    scipy.io.savemat(file, variables)
    return file.getvalue()


def _format(name: str, file: str, content: bytes, read: Callable[[Path], object]) -> Format:
    return Format(name, file, lambda folder: (folder / file).write_bytes(content), read)


def _normals(path: Path) -> object:
    return normals_gbuffer(read_normals(path))


GBUFFER = _format("npz", "g.npz", npz(normal=NORMAL, position=NORMAL, eye=np.ones(3)), load_gbuffer)
NPY = _format("npy", "n.npy", npy(NORMAL), _normals)
MAT = _format("mat", "n.mat", mat(Normal_gt=NORMAL), _normals)
EXR = Format(
    "exr, G-buffer",
    "g.exr",
    lambda folder: write_channels(
        folder / "g.exr",
        {
            **{f"V.Normal.{axis}": NORMAL[..., k].astype("f4") for k, axis in enumerate("XYZ")},
            **{f"V.Position.{axis}": NORMAL[..., k].astype("f4") for k, axis in enumerate("XYZ")},
            "V.IndexOB.X": np.ones((4, 5), np.float32),
        },
    ),
    load_exr_gbuffer,
)
FORMATS = (GBUFFER, NPY, MAT, EXR)

ABSURD = {
    "1e10 values": f"({HUGE}, {HUGE}, 3)",
    "a billion rows": "(1000000000, 3)",
    "more than memory has addresses": f"({2**62}, 3)",
    "a shape of many numbers": str((10,) * 30),
}
NOT_NUMBERS = {
    "text": np.full((4, 5, 3), "up"),
    "objects": np.array([{}, []], dtype=object),
    "a trap": np.array([Trap()], dtype=object),
    "complex": NORMAL + 1j,
    "dates": np.zeros((4, 5, 3), "M8[s]"),
    "records": np.zeros((4, 5), [("x", "f8"), ("y", "f8"), ("z", "f8")]),
}
HEADERS = {
    "a shape in words": claims("('four', 5, 3)"),
    "a negative shape": claims("(-4, 5, 3)"),
    "a type in words": claims("(4, 5, 3)", "'number'"),
    "code": claims("__import__('os').getcwd()"),
    "nested": claims("(" * 2000 + ")" * 2000),
}


def of_npz() -> Iterator[Case]:
    yield from any_file(GBUFFER)

    def whole(kind: str, name: str, content: Callable[[], bytes]) -> Case:
        return damaged(GBUFFER, kind, name, lambda _: content())

    def arrays(kind: str, name: str, **changed: Any) -> Case:
        return whole(kind, name, lambda: npz(**{"normal": NORMAL, **changed}))

    for name, shape in ABSURD.items():
        yield whole("absurd header", name, lambda s=shape: npz(normal=claims(s)))
    zeros = bytes(2**24)
    deflated = zipfile.ZIP_DEFLATED
    for side in (30_000, HUGE):
        shape = f"({side}, {side}, 3)"
        yield whole(
            "bomb",
            f"{side} x {side} of zeros",
            lambda s=shape: npz(deflated, normal=claims(s, "'|u1'", zeros)),
        )
    yield whole("bomb", "a short array in a long member", lambda: _short_in_long(zeros))
    for name, array in NOT_NUMBERS.items():
        yield arrays("wrong dtype", name, position=array)
    yield arrays("wrong shape", "one row", normal=NORMAL[0])
    yield arrays("wrong shape", "two axes", normal=NORMAL[..., :2])
    yield arrays("wrong shape", "another size", position=NORMAL[1:])
    yield arrays("wrong shape", "the mask's", mask=np.ones((4, 6)))
    yield arrays("wrong shape", "the eye's", eye=np.ones(2))
    yield arrays("wrong shape", "nothing", normal=NORMAL[:0])
    for value in (np.nan, np.inf):
        yield arrays("NaN", f"position {value}", position=np.full_like(NORMAL, value))
        yield arrays("NaN", f"eye {value}", eye=np.array([0, 0, value]))
        yield arrays(
            "NaN",
            f"masked normal {value}",
            normal=np.full_like(NORMAL, value),
            mask=np.ones((4, 5)),
        )
        yield arrays("NaN", f"view {value}", view=np.array([value, 0, 1]))
    yield whole("missing key", "no normal", lambda: npz(position=NORMAL))
    yield whole("missing key", "no member", npz)
    yield arrays("missing key", "an unknown one", normals=NORMAL)
    for name, header in HEADERS.items():
        yield arrays("wrong type", name, position=header)
    yield arrays("wrong type", "a member that is text", position=b"0 0 1\n" * 20)
    yield arrays("wrong type", "a member that is a pickle", position=pickle.dumps(Trap()))
    yield whole("wrong type", "one array", lambda: npy(NORMAL))
    yield damaged(GBUFFER, "wrong type", "encrypted", _encrypted)


def _short_in_long(zeros: bytes) -> bytes:
    return npz(zipfile.ZIP_DEFLATED, normal=claims("(0, 5, 3)", data=zeros))


def _encrypted(content: bytes) -> bytes:
    """Every member flagged so."""
    local, central = b"PK\x03\x04", b"PK\x01\x02"
    for magic, at in ((local, 6), (central, 8)):
        parts = content.split(magic)
        content = magic.join(
            [parts[0], *(p[: at - 4] + bytes([p[at - 4] | 1]) + p[at - 3 :] for p in parts[1:])]
        )
    return content


def of_npy() -> Iterator[Case]:
    yield from any_file(NPY)

    def whole(kind: str, name: str, content: Callable[[], bytes]) -> Case:
        return damaged(NPY, kind, name, lambda _: content())

    for name, shape in ABSURD.items():
        yield whole("absurd header", name, lambda s=shape: claims(s))
    for name, array in NOT_NUMBERS.items():
        yield whole("wrong dtype", name, lambda a=array: npy(a))
    for name, header in HEADERS.items():
        yield whole("wrong type", name, lambda h=header: h)
    yield whole("wrong type", "an archive", lambda: npz(normal=NORMAL))
    yield whole("wrong shape", "one row", lambda: npy(NORMAL[0]))
    yield whole("wrong shape", "four numbers", lambda: npy(NORMAL[..., [0, 1, 2, 0]]))
    yield whole("wrong shape", "a number", lambda: npy(np.float64(3)))
    yield whole("wrong shape", "nothing", lambda: npy(NORMAL[:0]))
    yield whole("NaN", "everywhere", lambda: npy(np.full_like(NORMAL, np.nan)))
    yield whole("NaN", "infinite everywhere", lambda: npy(np.full_like(NORMAL, np.inf)))


def of_mat() -> Iterator[Case]:
    yield from any_file(MAT, cuts=(0.1, 0.4, 0.8), magic_at=124)

    def whole(kind: str, name: str, content: Callable[[], bytes]) -> Case:
        return damaged(MAT, kind, name, lambda _: content())

    at = mat(Normal_gt=NORMAL).index(struct.pack("<3i", 4, 5, 3))

    def sized(*shape: int) -> Callable[[bytes], bytes]:
        return lambda c: c[:at] + struct.pack("<3i", *shape) + c[at + 12 :]

    yield damaged(MAT, "absurd header", "100,000 x 100,000 x 3", sized(HUGE, HUGE, 3))
    yield damaged(MAT, "absurd header", "2^31 x 3 x 3", sized(2**31 - 1, 3, 3))
    yield damaged(MAT, "wrong shape", "negative", sized(-4, 5, 3))
    yield damaged(MAT, "wrong shape", "more than is there", sized(40, 5, 3))

    numbers = mat(Normal_gt=NORMAL).index(struct.pack("<II", 9, NORMAL.size * 8))
    for kind in (0, 8, 14, 19, 0xFFFF):
        yield damaged(
            MAT,
            "wrong dtype",
            f"numbers of type {kind}",
            lambda c, k=kind: c[:numbers] + struct.pack("<I", k) + c[numbers + 4 :],
        )

    def compressed(claimed: int) -> bytes:
        """One element that unpacks to 16 MB of zeros, and claims so many bytes."""
        packed = zlib.compress(struct.pack("<II", 14, claimed) + bytes(2**24))
        return mat()[:128] + struct.pack("<II", 15, len(packed)) + packed

    yield whole("bomb", "16 x what is there", lambda: compressed(2**30))
    yield whole("bomb", "4 GiB", lambda: compressed(2**32 - 1))
    yield whole("bomb", "less than is there", lambda: compressed(8))
    yield whole("wrong dtype", "text", lambda: mat(Normal_gt="up"))
    yield whole("wrong dtype", "a structure", lambda: mat(Normal_gt={"x": NORMAL}))
    yield whole(
        "wrong dtype", "cells", lambda: mat(Normal_gt=np.array([NORMAL, None], dtype=object)[:1])
    )
    yield whole("wrong dtype", "complex", lambda: mat(Normal_gt=NORMAL + 1j))
    yield whole("wrong shape", "flat", lambda: mat(Normal_gt=NORMAL[..., 0]))
    yield whole("wrong shape", "four numbers", lambda: mat(Normal_gt=NORMAL[..., [0, 1, 2, 0]]))
    yield whole("NaN", "everywhere", lambda: mat(Normal_gt=np.full_like(NORMAL, np.nan)))
    yield whole("NaN", "infinite everywhere", lambda: mat(Normal_gt=np.full_like(NORMAL, np.inf)))
    yield whole("missing key", "another name", lambda: mat(normals=NORMAL))
    yield whole("missing key", "nothing", mat)
    yield whole("wrong type", "an .npz", lambda: npz(normal=NORMAL))
    yield whole(
        "wrong type",
        "version 7.3",
        lambda: (
            b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + b"\x89HDF\r\n\x1a\n" + bytes(600)
        ),
    )


def of_exr() -> Iterator[Case]:
    yield from any_file(EXR)

    def saved(kind: str, name: str, **changed: np.ndarray | None) -> Case:
        """With other channels, by the last parts of their names; None takes one out."""

        def make(folder: Path) -> Path:
            path = EXR.write(folder)
            channels = read_channels(path) | {
                f"V.{k.replace('_', '.')}": v for k, v in changed.items()
            }
            return write_channels(path, {k: v for k, v in channels.items() if v is not None})

        return Case(EXR, kind, name, make)

    flat = np.ones((4, 5), np.float32)
    nothing: dict[str, Any] = {f"Normal_{axis}": 0 * flat for axis in "XYZ"}
    yield saved("wrong shape", "no foreground", **nothing)
    yield saved("missing key", "no z of the normal", Normal_Z=None)
    yield saved("NaN", "every normal", Normal_X=np.nan * flat)
    yield saved("NaN", "every position", Position_X=np.inf * flat)
    yield saved("NaN", "every index", IndexOB_X=np.nan * flat)
    yield saved("wrong dtype", "every index a mean of several", IndexOB_X=0.5 * flat)
    yield saved("wrong dtype", "every index too large", IndexOB_X=1e9 * flat)
    yield saved("wrong dtype", "every index below 0", IndexOB_X=-flat)


def cases() -> Iterator[Case]:
    for of in (of_npz, of_npy, of_mat, of_exr):
        yield from of()
