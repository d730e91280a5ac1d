"""The ceiling: the same shading and gradient in C by hand (`ceiling.c`), compiled here when first used.

The compiled library is kept in the temporary directory, under a hash of the source and the flags.
"""

import ctypes
import functools
import getpass
import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.rivals import threads

__all__ = ["forward", "gradient", "library"]

SOURCE = Path(__file__).with_suffix(".c")
FLAGS = ("-O3", "-march=native", "-ffast-math", "-fopenmp", "-shared", "-fPIC")
ALIGNED = 64
"""Floats that a plane is padded to: the most pixels that go through the lights together."""

Floats = ctypes.POINTER(ctypes.c_float)


class _Scene(ctypes.Structure):
    """`struct scene`."""

    _fields_ = (
        ("points", Floats),
        ("normals", Floats),
        ("lights", Floats),
        ("count", ctypes.c_int64),
        ("stride", ctypes.c_int64),
        ("light_count", ctypes.c_int64),
        ("eye", ctypes.c_float * 3),
        ("ambient", ctypes.c_float),
        ("ka", ctypes.c_float * 3),
        ("kd", ctypes.c_float * 3),
        ("ks", ctypes.c_float * 3),
        ("shininess", ctypes.c_float),
        ("constants", ctypes.c_float * 3),
        ("coloured", ctypes.c_int32),
        ("attenuated", ctypes.c_int32),
        ("threads", ctypes.c_int32),
    )


@functools.cache
def library(dense: bool = False) -> ctypes.CDLL:
    """The compiled functions; `dense` computes what no pixel of a group can see too."""
    name = os.environ.get("CC", "cc")
    compiler = shutil.which(name)
    if compiler is None:
        raise RuntimeError(
            f"the ceiling needs a C compiler with OpenMP, and `{name}` is not on the path:"
            " install gcc or clang, or name one in the environment variable CC"
        )
    flags = (*FLAGS, f"-DDENSE={int(dense)}")
    key = hashlib.sha256("\0".join((SOURCE.read_text(), compiler, *flags)).encode()).hexdigest()
    folder = Path(tempfile.gettempdir()) / f"diffshade-ceiling-{getpass.getuser()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    compiled = folder / f"{key[:32]}.so"
    if not compiled.exists():
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            built = Path(scratch) / compiled.name
            command = [compiler, *flags, str(SOURCE), "-o", str(built), "-lm"]
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode:
                raise RuntimeError(
                    f"the ceiling does not compile (OpenMP missing?): {' '.join(command)}\n"
                    f"{done.stderr}"
                )
            built.replace(compiled)  # whole or not at all, whoever else compiles
    return ctypes.CDLL(str(compiled))


def _planes(count: int, values: np.ndarray | None = None) -> np.ndarray:
    """Aligned planes [3, >= count] with whole groups of pixels, zero past the last."""
    stride = -(-count // ALIGNED) * ALIGNED
    memory = np.zeros(3 * stride + ALIGNED, np.float32)
    shift = -memory.ctypes.data % (4 * ALIGNED) // 4
    planes = memory[shift : shift + 3 * stride].reshape(3, stride)
    if values is not None:
        planes[:, :count] = values
    return planes


def _pointer(array: np.ndarray) -> Any:
    return array.ctypes.data_as(Floats)


def _scene(
    points: np.ndarray, normals: np.ndarray, eye: np.ndarray, scene: dict[str, Any]
) -> tuple[_Scene, tuple[np.ndarray, ...]]:
    """The C structure, and the arrays that it points into."""
    count = points.shape[1]
    intensities = np.asarray(scene["intensities"], np.float32)
    coloured = intensities.ndim == 2
    intensities = np.broadcast_to(intensities.reshape(len(intensities), -1), (len(intensities), 3))
    lights = np.concatenate([scene["positions"], intensities], axis=1).astype(np.float32)
    lights = np.ascontiguousarray(lights[intensities.any(axis=1)])
    arrays = _planes(count, points), _planes(count, normals), lights
    constants = scene["constants"]
    return _Scene(
        *map(_pointer, arrays),
        count,
        arrays[0].shape[1],
        len(lights),
        tuple(eye),
        scene["ambient"],
        *(tuple(scene[k]) for k in ("ka", "kd", "ks")),
        scene["shininess"],
        (1.0, 0.0, 0.0) if constants is None else tuple(constants),
        coloured,
        constants is not None,
        threads(),
    ), arrays


def forward(
    points: np.ndarray,
    normals: np.ndarray,
    eye: np.ndarray,
    scene: dict[str, Any],
    dense: bool = False,
) -> Callable[[], np.ndarray]:
    """A call shades once, into the same planes [3, P]."""
    compiled = library(dense)
    data, arrays = _scene(points, normals, eye, scene)
    image = _planes(points.shape[1])
    seen = image[:, : points.shape[1]]

    def run(_keep: Any = arrays) -> np.ndarray:
        compiled.forward(ctypes.byref(data), _pointer(image))
        return seen

    return run


def gradient(
    points: np.ndarray,
    normals: np.ndarray,
    eye: np.ndarray,
    scene: dict[str, Any],
    target: np.ndarray,
    dense: bool = False,
) -> Callable[[], tuple[float, np.ndarray]]:
    """A call returns the loss and its gradient [13] in ka, kd, ks, n, c0, c1 and c2."""
    compiled = library(dense)
    data, arrays = _scene(points, normals, eye, scene)
    planes = _planes(points.shape[1], target)
    out = np.empty(14)

    def run(_keep: Any = arrays) -> tuple[float, np.ndarray]:
        compiled.gradient(
            ctypes.byref(data),
            _pointer(planes),
            out.ctypes.data_as(ctypes.POINTER(ctypes.c_double)),
        )
        return float(out[0]), out[1:].copy()

    return run
