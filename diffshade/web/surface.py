"""The surface and the camera as the shader takes them: which pixel sees what, and where that is.

Which pixels are foreground, and which face each sees, is the library's decision (`ds.visibility`); where
on it the shader finds out again. Faces that no pixel sees are left out. Everything is measured from the
middle of the surface, so that float32 has its digits where they are needed.
"""

from __future__ import annotations

import base64
import zlib
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from diffshade.geometry.camera import AbstractCamera, PerspectiveCamera
from diffshade.geometry.frequency import FlatShading
from diffshade.geometry.mesh import Mesh
from diffshade.geometry.view import visibility
from diffshade.web.shown import Shown

__all__ = ["surface"]

ROW = 1024
"""Texels in a row of the textures that hold faces and vertices."""


def surface(shown: Shown) -> dict[str, Any]:
    """The `origin` and the `radius` of the ball, or of one about the mesh; the camera; textures."""
    seen = visibility(shown.geometry, shown.camera)
    middle, radius = _ball(shown.geometry)
    face = np.full(seen.shape, -1, np.int32)
    face.reshape(-1)[np.asarray(seen.index)] = 0
    textures = {"seen": face}
    if isinstance(shown.geometry, Mesh):
        numbers, own = np.unique(np.asarray(seen.on_mesh()[0]), return_inverse=True)
        face.reshape(-1)[np.asarray(seen.index)] = own
        textures |= _mesh(shown, numbers, middle)
    return {
        "origin": middle.tolist(),
        "radius": radius,
        "perspective": isinstance(shown.camera, PerspectiveCamera),
        "camera": _camera(shown.camera, middle, radius),
        "textures": [_texture(name, values) for name, values in textures.items()],
    }


def _ball(geometry: Any) -> tuple[np.ndarray, float]:
    """The sphere, or one about the mesh."""
    if not isinstance(geometry, Mesh):
        return np.asarray(geometry.center, np.float64), float(geometry.radius)
    corners = np.asarray(geometry.vertices, np.float64)[np.asarray(geometry.faces)].reshape(-1, 3)
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    return middle, float(np.linalg.norm(corners - middle, axis=1).max())


def _camera(camera: AbstractCamera, middle: np.ndarray, radius: float) -> dict[str, Any]:
    """A ray goes through middle + x across + y upwards, x and y as `Frame.points` gives them.

    That plane lies in the middle of the surface, or before the eye where the eye is nearer than that.
    """
    with jax.enable_x64(True):
        exact: Any = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf, np.float64)), camera)
        right, up, back = (np.asarray(axis.to_array()) for axis in exact.axes())
        exact = jax.tree.map(np.asarray, exact)
    eye = -middle if exact.position is None else exact.position - middle
    found = {"back": back, "side": camera.frame.side}
    if isinstance(exact, PerspectiveCamera):
        distance = max(float(eye @ back), radius)
        scale = 2 * np.tan(exact.fov / 2) * distance
        found |= {"eye": eye, "middle": eye - distance * back}
    else:
        scale = exact.extent
        found["middle"] = eye - (eye @ back) * back
    found |= {"across": right * scale, "upwards": up * scale, "right": right, "up": up}
    return {name: np.asarray(value).tolist() for name, value in found.items()}


def _mesh(shown: Shown, seen: np.ndarray, middle: np.ndarray) -> dict[str, np.ndarray]:
    """The faces that are seen, and their vertices."""
    mesh: Any = shown.geometry
    used, corners = np.unique(np.asarray(mesh.faces)[seen], return_inverse=True)
    vertices = np.asarray(mesh.vertices, np.float64)[used] - middle
    found = {"faces": _rows(corners.reshape(-1, 3), np.int32), "vertices": _rows(vertices)}
    if not isinstance(shown.shading, FlatShading):
        normals = np.asarray(mesh.prepared().vertex_normals().to_array())
        found["normals"] = _rows(normals[used])
    return found


def _rows(values: np.ndarray, dtype: Any = np.float32) -> np.ndarray:
    """[N, 3] as an image [H, ROW, 3], whose last row is filled with zeros."""
    height = max(1, -(-len(values) // ROW))
    rows = np.zeros((height * ROW, 3), dtype)
    rows[: len(values)] = values
    return rows.reshape(height, ROW, 3)


def _texture(name: str, values: np.ndarray) -> dict[str, Any]:
    """An image of 32-bit numbers in little-endian order, deflated, as text."""
    packed = zlib.compress(values.astype(values.dtype.newbyteorder("<")).tobytes(), 9)
    return {
        "name": name,
        "height": values.shape[0],
        "width": values.shape[1],
        "format": f"{'RGB' if values.ndim == 3 else 'R'}32{'F' if values.dtype.kind == 'f' else 'I'}",
        "data": base64.b64encode(packed).decode(),
    }
