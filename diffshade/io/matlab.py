"""MATLAB's `.mat` files of versions 4 to 7: one array of numbers from them."""

import struct
import warnings
import zlib
from io import BytesIO
from pathlib import Path

import numpy as np

from diffshade.errors import BadInput
from diffshade.io.contents import read_bytes, refusing
from diffshade.io.limits import check_size

__all__ = ["read_matlab"]

_HEADER, _MATRIX, _COMPRESSED = 128, 14, 15
_ARRAYS, _TYPES = range(6, 16), frozenset((*range(1, 8), 9, 12, 13, *range(16, 19)))
"""The classes of matrices of numbers, and the types of their parts, as the format numbers them."""
_NUMBERS = {"single", "double", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32))}


def read_matlab(path: Path, key: str) -> np.ndarray:
    """The array of numbers of this name; the file's other variables are not read.

    Raises `BadInput`, naming the file, for what is no such file and holds no such array.
    """
    from scipy.io import loadmat, whosmat

    data = read_bytes(path)
    with refusing(path, "is not a MATLAB file", "save it again"):
        warnings.simplefilter("error")  # SciPy's, of what it reads wrongly
        file = BytesIO(_unpacked(data))
        try:
            held = {name: (shape, kind) for name, shape, kind in whosmat(file)}
        except NotImplementedError:  # what SciPy says to a MATLAB 7.3 file, which is HDF5
            raise BadInput("is a MATLAB 7.3 file; save it with save(..., '-v7')") from None
        if key not in held:
            names = ", ".join(held) or "nothing"
            raise BadInput(f"the key {key} is missing; it holds {names}")
        shape, kind = held[key]
        if kind not in _NUMBERS:
            raise BadInput(f"{key} is of the kind {kind}; save numbers")
        if min(shape) < 0:
            raise BadInput(f"{key} claims the shape {tuple(map(int, shape))}; save it again")
        check_size(map(int, shape))
        file.seek(0)
        return np.asarray(loadmat(file, variable_names=[key])[key])


def _unpacked(data: bytes) -> bytes:
    """The same file with nothing compressed: then no array can be larger than the file says."""
    if 0 in data[:4] or len(data) < _HEADER:  # version 4, which has no compression; no file at all
        return data
    order = "<" if data[126:128] == b"IM" else ">"
    parts, position, values = [data[:_HEADER]], _HEADER, 0
    while position + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, position)
        part = data[position : position + 8 + size]
        if kind == _COMPRESSED:
            part = _inflated(part[8:], order)
        _check_types(part, order)
        parts.append(part)
        values += len(part) // 8
        check_size((values,))
        position += 8 + size
    return b"".join(parts)


def _check_types(element: bytes, order: str) -> None:
    """Refuse a matrix of which a part has no type: SciPy would crash over it, and Python with it."""
    if len(element) < 24:
        return
    kind, flags = struct.unpack_from(f"{order}I12xI", element)
    is_array = kind == _MATRIX and flags & 0xFF in _ARRAYS
    position = 8
    for _ in range(5 if is_array else 0):  # flags, dimensions, name, real and imaginary part
        if position + 8 > len(element):
            break
        kind, size = struct.unpack_from(f"{order}II", element, position)
        is_short = kind > 0xFFFF  # it stands in its own tag, and its size beside its type
        kind &= 0xFFFF
        position += 8 if is_short else 8 + -(-size // 8) * 8
        if kind not in _TYPES:
            raise BadInput(f"holds numbers of an unknown type ({kind}); save it again")


def _inflated(packed: bytes, order: str) -> bytes:
    """A compressed element, as far as the number of bytes that it begins with."""
    unpack = zlib.decompressobj()
    tag = unpack.decompress(packed, 8)
    (size,) = struct.unpack_from(f"{order}4xI", tag)
    check_size((size // 8,))
    return tag + unpack.decompress(unpack.unconsumed_tail, max(size, 1))  # 0: no end
