"""Wavefront OBJ files: vertices, polygons, normals, and which material each polygon has.

Not by `trimesh`, whose reader is made for textures and not for shading. It cuts a surface at the
seams of its texture and between materials, so that means of neighbouring normals stop at the cut;
it counts negative indices from the end of the file instead of from the line they stand in; it fans
concave polygons; it drops all normals where one polygon has none. The tests show each.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from diffshade.errors import BadInput, naming
from diffshade.geometry.triangulate import triangulate
from diffshade.io.contents import read_bytes
from diffshade.io.limits import FARTHEST

__all__ = ["Obj", "read_obj"]


class Obj(NamedTuple):
    """An OBJ file's triangles, in the order of its polygons, over its own lists of vertices."""

    vertices: Float[np.ndarray, "V 3"]
    normals: Float[np.ndarray, "N 3"]
    faces: Int[np.ndarray, "F 3"]
    face_normals: Int[np.ndarray, "F 3"]
    """The number of each corner's normal, -1 where the file gives it none."""
    material: Int[np.ndarray, "F"]
    """Each triangle's place in `materials`."""
    materials: tuple[str | None, ...]
    """Names by `usemtl`, in the order of their first triangles; None: before any `usemtl`."""
    group: Int[np.ndarray, "F"]
    """The number of each triangle's object (`o`), in the order of their first triangles."""
    libraries: tuple[str, ...]
    """The rest of every `mtllib` line."""


class _Polygon(NamedTuple):
    line: int
    vertices: list[int]
    normals: list[int]
    material: str | None
    group: str | None


def read_obj(path: Path) -> Obj:
    """Read an OBJ file. Lines, points, curves, texture coordinates and smoothing are passed over.

    Raises `BadInput`, with the line, for numbers that are none and indices of nothing.
    """
    text = read_bytes(path).decode("utf-8-sig", errors="replace").replace("\r\n", "\n")
    vertices: list[list[float]] = []
    normals: list[list[float]] = []
    polygons: list[_Polygon] = []
    libraries: list[str] = []
    material = group = None
    for number, line in enumerate(text.replace("\r", "\n").replace("\\\n", " ").split("\n"), 1):
        key, *words = line.split(None, 1) or [""]
        rest = words[0].strip() if words else ""
        if "#" in rest and key in ("v", "vn", "f"):  # names may have one
            rest = rest.partition("#")[0]
        try:
            if key == "v":
                vertices.append(_triple(rest))
                if not all(abs(x) < FARTHEST for x in vertices[-1]):
                    raise ValueError(f"the vertex {rest} is not finite, or {FARTHEST:g} away")
            elif key == "vn":
                normals.append(_triple(rest))
            elif key == "f":
                corners = [corner.split("/") for corner in rest.split()]
                of_vertices = [_index(corner[0], len(vertices)) for corner in corners]
                of_normals = [
                    _index(corner[2], len(normals)) if len(corner) > 2 and corner[2] else -1
                    for corner in corners
                ]
                if len(corners) < 3:
                    raise ValueError("a polygon needs three corners or more")
                polygons.append(_Polygon(number, of_vertices, of_normals, material, group))
            elif key == "usemtl":
                material = rest
            elif key == "o":
                group = rest
            elif key == "mtllib":
                libraries.append(rest)
        except ValueError as error:
            raise BadInput(f"{path}, line {number}: {error}; correct the line") from None
    _check_range(path, polygons, len(vertices), len(normals))
    with naming(path):
        return _triangles(
            np.array(vertices, np.float64).reshape(-1, 3),
            np.array(normals, np.float64).reshape(-1, 3),
            polygons,
            tuple(libraries),
        )


def _triple(rest: str) -> list[float]:
    values = [float(word) for word in rest.split()[:3]]  # a weight or a colour may follow
    if len(values) != 3:
        raise ValueError(f"{len(values)} coordinates where three belong")
    return values


def _index(word: str, so_far: int) -> int:
    """From 1 in order, or from -1 back from the line where it stands."""
    index = int(word)
    index = index - 1 if index > 0 else index + so_far if index < 0 else -1
    if index < 0:
        raise ValueError(f"there is no number {word} among {so_far}")
    return index


def _check_range(path: Path, polygons: list[_Polygon], vertices: int, normals: int) -> None:
    for polygon in polygons:
        for what, numbers, count in (
            ("vertex", polygon.vertices, vertices),
            ("normal", polygon.normals, normals),
        ):
            if max(numbers) >= count and max(numbers) >= 0:
                raise BadInput(
                    f"{path}, line {polygon.line}: refers to {what} {max(numbers) + 1} of {count};"
                    " correct the line, or complete the file"
                )


def _triangles(
    vertices: Float[np.ndarray, "V 3"],
    normals: Float[np.ndarray, "N 3"],
    polygons: list[_Polygon],
    libraries: tuple[str, ...],
) -> Obj:
    """Every polygon cut into triangles, all polygons with the same number of corners at once."""
    by_size: dict[int, list[int]] = {}
    for place, polygon in enumerate(polygons):
        by_size.setdefault(len(polygon.vertices), []).append(place)
    origin = [np.zeros(0, np.int64)]
    faces = [np.zeros((0, 3), np.int64)]
    face_normals = [np.zeros((0, 3), np.int64)]
    for size, places in by_size.items():
        of_vertices = np.array([polygons[place].vertices for place in places])
        of_normals = np.array([polygons[place].normals for place in places])
        corners = triangulate(vertices[of_vertices])
        origin.append(np.repeat(places, size - 2))
        for found, numbers in ((faces, of_vertices), (face_normals, of_normals)):
            found.append(np.take_along_axis(numbers[:, None], corners, axis=2).reshape(-1, 3))
    order = np.argsort(np.concatenate(origin), kind="stable")
    origin_sorted = np.concatenate(origin)[order]
    materials, material = _numbered([polygon.material for polygon in polygons])
    _, group = _numbered([polygon.group for polygon in polygons])
    return Obj(
        vertices,
        normals,
        faces=np.concatenate(faces)[order],
        face_normals=np.concatenate(face_normals)[order],
        material=material[origin_sorted],
        materials=materials,
        group=group[origin_sorted],
        libraries=libraries,
    )


def _numbered(
    names: list[str | None],
) -> tuple[tuple[str | None, ...], Int[np.ndarray, "N"]]:
    """Different names in the order of their first use, and the place of each name among them."""
    places: dict[str | None, int] = {}
    numbers = [places.setdefault(name, len(places)) for name in names]
    return tuple(places), np.array(numbers, np.int64)
