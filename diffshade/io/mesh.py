"""Meshes from files: OBJ with its `.mtl`, PLY, STL, glTF.

| format | vertices | vertex normals | slots | materials |
|---|---|---|---|---|
| OBJ | as in the file, or one for each position and normal | `vn` | `usemtl`, or else `o` | `.mtl` |
| PLY | as in the file | `nx`, `ny`, `nz` | none | none |
| STL | corners at exactly the same place are one | computed | solids | none |
| glTF | as in the file, moved by their nodes | `NORMAL` | primitives | none |

Where a file gives only some of its vertices a normal, the others have the mean of their faces'
normals, weighted by area; where it gives none, `Mesh` computes them, and they move with the vertices.
The facet normals of an STL file say nothing that its corners do not; a faceted look is
`FlatShading()`. glTF's materials are metallic-roughness and have no Phong form. Textures and the
smoothing groups of OBJ files are not read.
"""

import os
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from diffshade.errors import BadInput, naming
from diffshade.geometry.mesh import Mesh
from diffshade.io.limits import FARTHEST
from diffshade.io.obj import Obj, read_obj
from diffshade.io.obj_materials import read_materials
from diffshade.io.trimesh_formats import Part, merged, read_gltf, read_ply, read_stl

__all__ = ["load_mesh", "read_mesh"]

READERS: dict[str, Callable[[Path, bool], list[Part]]] = {
    ".ply": read_ply,
    ".stl": read_stl,
    ".gltf": read_gltf,
    ".glb": read_gltf,
}


def load_mesh(path: str | Path, *, normals: bool = True, allow_outside: bool = False) -> Mesh:
    """One mesh of all that a file holds: `.obj` with its `.mtl`, `.ply`, `.stl`, `.gltf`, `.glb`.

    Polygons are cut into triangles; axes and units are those of the file. With `normals=False` its
    vertex normals are left aside, and computed from its faces: some files store one a face, which no
    interpolation can smooth. A file of several materials, or else objects, gives each face its
    `slot`. `materials` are those of the `.mtl`, in the order of the slots, with the halfway-vector
    lobe (Blinn) of its `illum 2`. They have one form: where one lacks a term that another has, its
    coefficient is 0.

    Warns where the materials that an OBJ file names are not found or have textures, and of faces
    without area, which no pixel sees (`Mesh.degenerate`). Raises `BadInput`, naming the file, for what
    is missing, no mesh, or has no triangles; and for a file outside its folder that it names, such as
    `../a.mtl`, unless `allow_outside`.

    >>> mesh = load_mesh("bunny.obj")
    >>> image = ds.render(ds.gbuffer(mesh, camera), scene, material)
    """
    mesh, notes = read_mesh(Path(path), normals=normals, allow_outside=allow_outside)
    for note in notes:
        warnings.warn(f"{path}: {note}", stacklevel=2)
    return mesh


def read_mesh(
    path: Path, *, normals: bool = True, allow_outside: bool = False
) -> tuple[Mesh, tuple[str, ...]]:
    """What `load_mesh` gives, and what it warns of."""
    suffix = path.suffix.lower()
    if not os.path.isfile(path):
        raise BadInput(f"{path}: there is no such file; check the path")
    notes: tuple[str, ...] = ()
    with naming(path):
        if suffix == ".obj":
            file = read_obj(path)
            mesh = _from_obj(file, normals)
        elif suffix in READERS:
            mesh = _from_parts(READERS[suffix](path, allow_outside), normals)
        else:
            known = ", ".join((".obj", *READERS))
            raise BadInput(f"is no mesh format that is read; give one of {known}")
    if suffix == ".obj" and any(file.materials):
        materials, notes = read_materials(path, file, allow_outside=allow_outside)
        mesh = replace(mesh, materials=materials)
    count = mesh.faces.shape[0]
    if not count:
        given = mesh.vertices.shape[0]
        raise BadInput(f"{path}: holds {given} vertices and no faces; give a mesh of triangles")
    if flat := int(np.count_nonzero(mesh.degenerate())):
        notes += (f"{flat} of {count} faces have no area: left out",)
    return mesh, notes


def _from_parts(parts: list[Part], keep_normals: bool) -> Mesh:
    parts = [part for part in parts if len(part.faces)] or parts
    vertices, faces, normals = merged(parts)
    if not keep_normals:
        normals = None
    if normals is not None:
        normals = _complete(normals, lambda: _means(vertices, faces))
    slot = np.repeat(np.arange(len(parts)), [len(part.faces) for part in parts])
    return _mesh(vertices, faces, normals, slot=slot if len(parts) > 1 else None)


def _from_obj(file: Obj, keep_normals: bool) -> Mesh:
    vertices, faces = file.vertices, file.faces
    normals = None
    if keep_normals:
        all_normals = np.append(file.normals, np.zeros((1, 3)), axis=0)  # number -1 is none
        values, number = np.unique(all_normals, axis=0, return_inverse=True)
        corners = np.stack([faces, number.reshape(-1)[file.face_normals]], axis=-1).reshape(-1, 2)
        pairs, number = np.unique(corners, axis=0, return_inverse=True)
        of_vertex, of_normal = pairs.T
        normals = _complete(values[of_normal], lambda: _means(vertices, faces)[of_vertex])
        if normals is not None:
            vertices, faces = vertices[of_vertex], number.reshape(-1, 3)
    slot = file.material if any(file.materials) else file.group
    return _mesh(vertices, faces, normals, slot=slot if slot.any() else None)


def _mesh(*arguments: Any, **options: Any) -> Mesh:
    return Mesh(*arguments, **options)  # of NumPy arrays, which its fields convert


def _means(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> Float[np.ndarray, "V 3"]:
    return np.asarray(_mesh(vertices, faces).vertex_normals().to_array(), np.float64)


def _complete(
    given: Float[np.ndarray, "V 3"], compute: Callable[[], Float[np.ndarray, "V 3"]]
) -> Float[np.ndarray, "V 3"] | None:
    """A file's normals, computed where they are zero or no lengths; None where all are."""
    usable = (np.abs(given) < FARTHEST).all(axis=1) & (given != 0).any(axis=1)
    if usable.all() or not usable.any():
        return given if usable.any() else None
    return np.where(usable[:, None], given, compute())
