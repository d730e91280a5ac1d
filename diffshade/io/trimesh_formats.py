"""PLY, STL and glTF files, by the readers of `trimesh`.

Its readers are called, and not its meshes built: those would merge vertices, and have normals of
their own where the file has none.
"""

import json
import logging
import struct
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from diffshade.errors import BadInput
from diffshade.geometry.triangulate import triangulate

__all__ = ["Part", "merged", "read_gltf", "read_ply", "read_stl"]


class Part(NamedTuple):
    """One piece of a mesh file."""

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    normals: Float[np.ndarray, "V 3"] | None
    """Those of the vertices, where the file has them."""


def read_ply(path: Path) -> list[Part]:
    """Text or binary PLY. Of faces with different numbers of corners only text can be read, and
    there concave ones are cut as if they were convex.
    """
    from trimesh.exchange.ply import load_ply

    # Without `fix_texture` vertices stay as they are at the seams of a texture.
    read = _by_trimesh(path, load_ply, skip_materials=True, fix_texture=False)
    part = _part(path, read)
    for element, elements, found in (
        ("vertex", "vertices", part.vertices),
        ("face", "faces", part.faces),
    ):
        promised = read["metadata"]["_ply_raw"].get(element, {}).get("length", 0)
        if len(found) < promised:
            raise BadInput(
                f"{path}: its header promises {promised} {elements}, and {len(found)} are there;"
                " the file is cut off"
            )
    return [part]


def read_stl(path: Path) -> list[Part]:
    """Text or binary STL, one part a solid; corners at exactly the same place are one vertex."""
    from trimesh.exchange.stl import load_stl

    read = _by_trimesh(path, load_stl)
    solids = read["geometry"].values() if "geometry" in read else [read]
    return [_joined(_part(path, solid)) for solid in solids]


def read_gltf(path: Path) -> list[Part]:
    """glTF 2.0, `.gltf` or `.glb`, one part a primitive, at every place where a node puts it."""
    from trimesh.exchange.gltf import load_glb, load_gltf
    from trimesh.resolvers import FilePathResolver
    from trimesh.scene.transforms import SceneGraph

    load = load_glb if path.suffix.lower() == ".glb" else load_gltf
    read = _by_trimesh(path, load, resolver=FilePathResolver(str(path)), skip_materials=True)
    if unknown := _extensions_of_geometry(path):
        raise BadInput(
            f"{path}: needs the glTF extension {unknown[0]}, which is not read; export it without"
            " compression"
        )
    graph = SceneGraph(base_frame=read.get("base_frame", "world"))
    for edge in read["graph"]:
        graph.update(**edge)
    places: dict[Any, list[Float[np.ndarray, "4 4"]]] = {name: [] for name in read["geometry"]}
    for node in graph.nodes_geometry:
        matrix, name = graph[node]
        places[name].append(np.asarray(matrix))
    primitives = ((_part(path, read["geometry"][name]), at) for name, at in places.items() if at)
    return [merged([_moved(part, matrix) for matrix in at]) for part, at in primitives]


def _extensions_of_geometry(path: Path) -> list[str]:
    """Those that a file requires and that change its meshes, of which some versions of trimesh read
    zeros.
    """
    content = path.read_bytes()
    if content[:4] == b"glTF":  # the header is the first chunk
        (length,) = struct.unpack("<I", content[12:16])
        content = content[20 : 20 + length]
    required = json.loads(content).get("extensionsRequired", [])
    harmless = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_")
    return [name for name in required if not name.startswith(harmless)]


def merged(parts: list[Part]) -> Part:
    """One part of several. Normals are zero where a part has none, and None where none has any."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=False)]
    normals = [
        np.zeros_like(part.vertices) if part.normals is None else part.normals for part in parts
    ]
    known = any(part.normals is not None for part in parts)
    return Part(
        np.concatenate([np.zeros((0, 3)), *(part.vertices for part in parts)]),
        np.concatenate([np.zeros((0, 3), np.int64), *faces]),
        np.concatenate(normals) if known else None,
    )


def _by_trimesh(path: Path, load: Callable[..., Any], **options: Any) -> Mapping[str, Any]:
    """What a reader of trimesh makes of a file: all of it, or `BadInput`."""
    kind = path.suffix[1:].upper()
    remedy = "check that the file is whole and what its name says, or write it again"
    try:
        content = BytesIO(path.read_bytes())
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror}); check the path") from None
    try:
        with _complaints() as complaints, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # how NumPy says that there is text where numbers belong
            warnings.filterwarnings("error", message=".*could not be read")
            read: Mapping[str, Any] = load(content, **options)
    except Exception as error:
        reason = next(iter(str(error).splitlines()), "") or type(error).__name__
        if isinstance(error, ModuleNotFoundError) and error.name == "charset_normalizer":
            reason = "neither its binary form nor UTF-8 text"
        raise BadInput(f"{path}: no {kind} file that can be read ({reason}); {remedy}") from None
    if complaints:
        raise BadInput(f"{path}: can be read only in part ({complaints[0]}); {remedy}")
    return read


@contextmanager
def _complaints() -> Iterator[list[str]]:
    """Catches the warnings that trimesh logs, which would go to standard error."""
    messages: list[str] = []

    class Keep(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            messages.append(record.getMessage().splitlines()[0])

    logger, keep = logging.getLogger("trimesh"), Keep(logging.WARNING)
    propagate, logger.propagate = logger.propagate, False
    logger.addHandler(keep)
    try:
        yield messages
    finally:
        logger.removeHandler(keep)
        logger.propagate = propagate


def _part(path: Path, read: Mapping[str, Any]) -> Part:
    vertices = np.asarray(read.get("vertices", ()), np.float64).reshape(-1, 3)
    polygons = np.asarray(read.get("faces", ()), np.int64)
    if polygons.ndim != 2:  # of no faces
        polygons = polygons.reshape(-1, 3)
    normals = read.get("vertex_normals")
    if not np.isfinite(vertices).all():
        number = int(np.argmin(np.isfinite(vertices).all(axis=1)))
        raise BadInput(f"{path}: vertex number {number} is not finite; repair the file")
    if polygons.size and not (polygons.min() >= 0 and polygons.max() < len(vertices)):
        raise BadInput(
            f"{path}: faces refer to vertices {polygons.min()} to {polygons.max()} of"
            f" {len(vertices)}; check that the file is whole"
        )
    corners = triangulate(vertices[polygons])
    faces = np.take_along_axis(polygons[:, None], corners, axis=2).reshape(-1, 3)
    return Part(vertices, faces, None if normals is None else np.asarray(normals, np.float64))


def _joined(part: Part) -> Part:
    """With vertices at exactly the same place made one, in the order of their first appearance."""
    places, first, place = np.unique(
        part.vertices + 0.0, axis=0, return_index=True, return_inverse=True
    )
    order = np.argsort(first)
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    return Part(places[order], number[place.reshape(-1)[part.faces]], None)


def _moved(part: Part, matrix: Float[np.ndarray, "4 4"]) -> Part:
    """Vertices by M, normals by its cofactors (M^-1 transposed, times its determinant)."""
    linear, shift = matrix[:3, :3], matrix[:3, 3]
    cofactors = np.cross(linear[[1, 2, 0]], linear[[2, 0, 1]])
    mirrored = np.linalg.det(linear) < 0
    normals = part.normals
    if normals is not None:
        normals = normals @ (-cofactors if mirrored else cofactors).T
    faces = part.faces[:, ::-1] if mirrored else part.faces
    return Part(part.vertices @ linear.T + shift, faces, normals)
