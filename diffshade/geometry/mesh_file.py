"""Meshes from files: OBJ with its `.mtl`, PLY, STL, glTF.

| format | vertices | vertex normals | slots | materials |
|---|---|---|---|---|
| OBJ | as in the file; one for each pair of `v` and `vn` where there are normals | `vn` | `usemtl`, or else objects (`o`) | the `.mtl`'s |
| PLY | as in the file | `nx`, `ny`, `nz` | none | none |
| STL | corners at exactly the same place are one vertex | computed | solids, where several | none |
| glTF | as in the file, moved by their nodes | `NORMAL` | primitives, where several | none |

Where a file gives some of its vertices no normal of any length, these have the area-weighted mean
of their faces' normals; where it gives none at all, `Mesh` computes them, and they move with the
vertices. The facet normals of an STL file say nothing that its corners do not, and a flat look is
`FlatShading()`. glTF's materials are metallic-roughness and have no Phong form. No texture is read.
"""

import logging
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from diffshade.errors import BadInput
from diffshade.geometry.mesh import Mesh
from diffshade.geometry.triangulate import triangulate

__all__ = ["load_mesh"]


class _Part(NamedTuple):
    """One piece of a file; faces with `normals` None have none of their own."""

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    normals: Float[np.ndarray, "V 3"] | None = None


def load_mesh(path: str | Path) -> Mesh:
    """One mesh of all that a file holds: `.obj` with its `.mtl`, `.ply`, `.stl`, `.gltf`, `.glb`.

    Polygons are cut into triangles. The file's axes and units are taken as they are. A file with
    several materials or objects gives each face its `slot`; `materials` are those of an OBJ file's
    `.mtl`, in the order of the slots, with the halfway-vector lobe (Blinn) of its `illum 2`. They
    have one form: where one lacks a term that another has, its coefficient is 0.

    Warns where materials that an OBJ file names are not found, and where textures are passed over.
    Raises `BadInput`, naming the file, for what is missing, not a mesh, or has no triangles.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if not path.is_file():
        raise BadInput(f"{path}: there is no such file; check the path")
    if reader is None:
        raise BadInput(
            f"{path}: {path.suffix or 'a name without suffix'} is no mesh format that is read;"
            f" give {', '.join(_READERS)}"
        )
    mesh = reader(path)
    if not mesh.faces.shape[0]:
        raise BadInput(
            f"{path}: holds {mesh.vertices.shape[0]} points and no triangles; give a mesh"
        )
    return mesh


def _obj(path: Path) -> Mesh:
    from diffshade.io.obj import read_obj

    file = read_obj(path)
    lengths = np.append(np.linalg.norm(file.normals, axis=1), 0)  # number -1: no normal
    usable = np.isfinite(lengths) & (lengths > 0)
    known = usable[file.face_normals]
    vertices, faces, normals = file.vertices, file.faces, None
    if known.any():
        corners = np.stack([file.faces, np.where(known, file.face_normals, -1)], axis=-1)
        pairs, faces = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
        of_vertex, of_normal = pairs.T
        given = np.where((of_normal >= 0)[:, None], file.normals[of_normal], 0)
        vertices, faces = file.vertices[of_vertex], faces.reshape(-1, 3)
        normals = given if known.all() else given  # completed below
        if not known.all():
            computed = _computed_normals(_Part(file.vertices, file.faces))[of_vertex]
            normals = np.where((of_normal >= 0)[:, None], given, computed)
    return Mesh(vertices, faces, normals)


def _computed_normals(part: _Part) -> Float[np.ndarray, "V 3"]:
    return np.asarray(Mesh(part.vertices, part.faces).vertex_normals().to_array(), np.float64)


_READERS: Mapping[str, Callable[[Path], Mesh]] = {}
