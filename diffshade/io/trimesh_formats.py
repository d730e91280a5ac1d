"""PLY, STL and glTF files, by the readers of `trimesh`.

Its readers are called, and not its meshes built: those would merge vertices, and have normals of
their own where the file has none.
"""

import json
import logging
import struct
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from diffshade.errors import BadInput, naming
from diffshade.geometry.triangulate import triangulate
from diffshade.io.contents import read_bytes, within
from diffshade.io.limits import FARTHEST, check_size

__all__ = ["Part", "merged", "read_gltf", "read_ply", "read_stl"]


class Part(NamedTuple):
    """One piece of a mesh file."""

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    normals: Float[np.ndarray, "V 3"] | None
    """Those of the vertices, where the file has them."""


def read_ply(path: Path, allow_outside: bool) -> list[Part]:
    """Text or binary PLY. Of faces with different numbers of corners only text can be read, and
    there concave ones are cut as if they were convex.
    """
    from trimesh.exchange.ply import load_ply

    data = read_bytes(path)
    with _reading(path):
        _check_ply(data)
        # Without `fix_texture` vertices stay as they are at the seams of a texture.
        read = load_ply(BytesIO(data), skip_materials=True, fix_texture=False)
        part = _part(read)
        for element, elements, found in (
            ("vertex", "vertices", part.vertices),
            ("face", "faces", part.faces),
        ):
            promised = read["metadata"]["_ply_raw"].get(element, {}).get("length", 0)
            if len(found) < promised:
                raise BadInput(
                    f"its header promises {promised} {elements}, and {len(found)} are there; the"
                    " file is cut off"
                )
        return [part]


def _check_ply(data: bytes) -> None:
    """Refuse a header that claims too much: trimesh believes it."""
    header, _, _ = data.partition(b"end_header")
    count = claimed = 0
    for line in header.splitlines():
        words = line.split()
        if words and b"element" in words[0]:
            count = int(words[-1])
        elif words and b"property" in words[0]:
            claimed += count
        if count < 0:
            raise BadInput(f"its header promises {count} {words[1].decode()}; correct it")
    check_size((claimed,))


def read_stl(path: Path, allow_outside: bool) -> list[Part]:
    """Text or binary STL, one part a solid; corners at exactly the same place are one vertex."""
    from trimesh.exchange.stl import load_stl

    data = read_bytes(path)
    with _reading(path):
        read = load_stl(BytesIO(data))
        solids = read["geometry"].values() if "geometry" in read else [read]
        return [_joined(_part(solid)) for solid in solids]


def read_gltf(path: Path, allow_outside: bool) -> list[Part]:
    """glTF 2.0, `.gltf` or `.glb`, one part a primitive, at every place where a node puts it."""
    from trimesh.exchange.gltf import load_glb, load_gltf
    from trimesh.scene.transforms import SceneGraph

    data = read_bytes(path)
    load = load_glb if path.suffix.lower() == ".glb" else load_gltf
    with _reading(path):
        _check_gltf(data)
        beside: Any = _Beside(path.parent, allow_outside)
        read = load(BytesIO(data), resolver=beside, skip_materials=True)
        graph = SceneGraph(base_frame=read.get("base_frame", "world"))
        for edge in read["graph"]:
            graph.update(**edge)
        geometry = read["geometry"]
        places: dict[Any, list[Float[np.ndarray, "4 4"]]] = {name: [] for name in geometry}
        for node in graph.nodes_geometry:
            matrix, name = graph[node]
            places[name].append(np.asarray(matrix))
        values = {name: _value_count(part) for name, part in geometry.items()}
        check_size((sum(values[name] * len(at) for name, at in places.items()),))
        primitives = ((_part(geometry[name]), at) for name, at in places.items() if at)
        return [merged([_moved(part, matrix) for matrix in at]) for part, at in primitives]


def _value_count(read: Mapping[str, Any]) -> int:
    return sum(np.size(read.get(key, ())) for key in ("vertices", "faces", "vertex_normals"))


class _Beside:
    """The files that a glTF file names, as trimesh asks for them."""

    def __init__(self, folder: Path, allow_outside: bool) -> None:
        self.folder, self.allow_outside = folder, allow_outside

    def __getitem__(self, name: str) -> bytes:
        return read_bytes(within(self.folder, name, allow_outside=self.allow_outside))


_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


def _check_gltf(data: bytes) -> None:
    """Refuse accessors that claim too much, and what trimesh would read zeros of: accessors of a mesh
    that are not plain, and extensions that change meshes.
    """
    if data[:4] == b"glTF":  # the header is the first chunk
        (length,) = struct.unpack_from("<I", data, 12)
        data = data[20 : 20 + length]
    header = json.loads(data)
    version = str(header.get("asset", {}).get("version", "2"))
    if version.split(".")[0] != "2":
        raise BadInput(f"is glTF {version}; export it as glTF 2.0")
    accessors = header.get("accessors", [])
    check_size((sum(int(a["count"]) * _COMPONENTS[a["type"]] for a in accessors),))
    harmless = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_")
    for name in header.get("extensionsRequired", []):
        if not name.startswith(harmless):
            raise BadInput(
                f"needs the glTF extension {name}, which is not read; export it without compression"
            )
    for mesh in header.get("meshes", []):
        for primitive in mesh["primitives"]:
            attributes = primitive["attributes"]
            used = [attributes[key] for key in ("POSITION", "NORMAL") if key in attributes]
            for number in (*used, primitive.get("indices")):
                if number is not None and "bufferView" not in accessors[number]:
                    raise BadInput(
                        f"accessor {number} has no data (it may be sparse, or compressed): it would"
                        " be read as zeros; export plain arrays"
                    )


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


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Whatever trimesh raises or logs for a file, and what does not fit together in it, is `BadInput`."""
    kind = path.suffix[1:].upper()
    remedy = "check that the file is whole and what its name says, or write it again"
    try:
        with naming(path), _complaints() as complaints, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # how NumPy says that there is text where numbers belong
            warnings.filterwarnings("error", message=".*could not be read")
            yield
    except BadInput:
        raise
    except Exception as error:
        reason = next(iter(str(error).splitlines()), "") or type(error).__name__
        if isinstance(error, ModuleNotFoundError) and error.name == "charset_normalizer":
            reason = "neither its binary form nor UTF-8 text"
        raise BadInput(f"{path}: no {kind} file that can be read ({reason}); {remedy}") from None
    if complaints:
        raise BadInput(f"{path}: can be read only in part ({complaints[0]}); {remedy}")


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


def _part(read: Mapping[str, Any]) -> Part:
    vertices = np.asarray(read.get("vertices", np.zeros((0, 3))), np.float64)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise BadInput(f"its vertices have shape {vertices.shape}; give three coordinates each")
    polygons = np.asarray(read.get("faces", ()), np.int64)
    if polygons.ndim != 2:  # of no faces
        polygons = polygons.reshape(-1, 3)
    normals = read.get("vertex_normals")
    _check_vertices(vertices)
    if polygons.size and not (polygons.min() >= 0 and polygons.max() < len(vertices)):
        raise BadInput(
            f"faces refer to vertices {polygons.min()} to {polygons.max()} of {len(vertices)}; check"
            " that the file is whole"
        )
    if normals is not None:
        normals = np.asarray(normals, np.float64).reshape(vertices.shape)
    corners = triangulate(vertices[polygons])
    faces = np.take_along_axis(polygons[:, None], corners, axis=2).reshape(-1, 3)
    return Part(vertices, faces, normals)


def _check_vertices(vertices: Float[np.ndarray, "V 3"]) -> None:
    near = (np.abs(vertices) < FARTHEST).all(axis=1)
    if not near.all():
        raise BadInput(
            f"vertex number {np.argmin(near)} is not finite, or {FARTHEST:g} away; repair the file"
        )


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
    vertices = part.vertices @ linear.T + shift
    _check_vertices(vertices)
    return Part(vertices, faces, normals)
