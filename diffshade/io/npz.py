"""NumPy's own files, `.npy` and `.npz`: arrays of plain numbers, never pickled objects."""

from collections.abc import Collection
from io import BytesIO
from pathlib import Path
from typing import IO
from zipfile import ZipFile

import numpy as np

from diffshade.errors import BadInput
from diffshade.io.contents import read_bytes, refusing
from diffshade.io.limits import check_size

__all__ = ["read_npy", "read_npz"]

_NPY, _ZIP = b"\x93NUMPY", b"PK"
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
"""By version; a third is for names of fields only."""


def read_npy(path: Path) -> np.ndarray:
    """The array of an `.npy` file; raises `BadInput`."""
    data = read_bytes(path)
    if data.startswith(_ZIP):
        raise BadInput(f"{path}: is an archive, not one array; name it .npz")
    with refusing(path, "is not an .npy of numbers", "use np.save"):
        return _array(BytesIO(data))


def read_npz(path: Path, known: Collection[str]) -> dict[str, np.ndarray]:
    """The arrays of an `.npz` file by name; raises `BadInput`, also for a name that is not `known`."""
    data = read_bytes(path)
    if data.startswith(_NPY):
        raise BadInput(f"{path}: holds one array, not an .npz archive; use np.savez")
    arrays = {}
    with (
        refusing(path, "is not an .npz of plain arrays", "use np.savez"),
        ZipFile(BytesIO(data)) as archive,
    ):
        for member in archive.infolist():
            name = member.filename.removesuffix(".npy")
            if name not in known:
                raise BadInput(f"unknown array {name!r}; the arrays here are {', '.join(known)}")
            with archive.open(member) as stream:
                arrays[name] = _array(stream)
    return arrays


def _array(stream: IO[bytes]) -> np.ndarray:
    """An array whose header was believed only after a look at it."""
    version = np.lib.format.read_magic(stream)
    if version not in _HEADERS:
        raise BadInput(f"has the .npy version {version}; save plain numbers")
    shape, _, dtype = _HEADERS[version](stream)
    if dtype.kind not in "biuf" or dtype.hasobject:
        raise BadInput(f"holds {dtype} values; give numbers")
    check_size(shape)
    stream.seek(0)
    array: np.ndarray = np.lib.format.read_array(stream, allow_pickle=False)
    return array
