"""Mesh files written by the tests, and what becomes of them."""

import json
import struct

import numpy as np
import pytest
import trimesh
from mesh_cases import CUBE, CUBE_FACES

import diffshade as ds


def written(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def refusal(path):
    """The one line that a file is refused with; it names the file."""
    with pytest.raises(ds.BadInput) as refused:
        ds.load_mesh(path)
    (line,) = str(refused.value).splitlines()
    assert line.startswith(str(path))
    return line


def by_trimesh(path):
    return trimesh.load_scene(path, process=False).to_mesh()


def ply(vertices, faces, normals=None, kind="ascii 1.0"):
    """Text, or binary with polygons that all have as many corners as the first."""
    names = ["x", "y", "z"] + (["nx", "ny", "nz"] if normals is not None else [])
    rows = np.asarray(vertices if normals is None else np.hstack([vertices, normals]))
    header = ["ply", f"format {kind}", "comment made here", f"element vertex {len(rows)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    start = ("\n".join(header) + "\n").encode()
    if kind.startswith("ascii"):
        lines = [" ".join(map(repr, row)) for row in rows.tolist()]
        lines += [" ".join(map(str, [len(face), *face])) for face in faces]
        return start + ("\n".join(lines) + "\n").encode()
    order = "<" if "little" in kind else ">"
    binary = rows.astype(f"{order}f4").tobytes()
    return (
        start
        + binary
        + b"".join(struct.pack(f"{order}B{len(face)}i", len(face), *face) for face in faces)
    )


def stl(corners, name="made here"):
    lines = [f"solid {name}"]
    for triangle in corners:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in triangle]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, f"endsolid {name}", ""])


def stl_binary(corners):
    rows = np.zeros(len(corners), [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    rows["v"] = corners
    return b"made here".ljust(80) + struct.pack("<I", len(corners)) + rows.tobytes()


def gltf(nodes, normals=None, extra=None):
    """A triangle mesh of the cube as one primitive, in the places of the nodes; header and data."""
    arrays = [CUBE.astype("<f4"), CUBE_FACES.astype("<u2").ravel()]
    attributes = {"POSITION": 0}
    if normals is not None:
        arrays.append(normals.astype("<f4"))
        attributes["NORMAL"] = 2
    data, views, accessors = b"", [], []
    for number, array in enumerate(arrays):
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        accessors.append(
            {
                "bufferView": number,
                "componentType": 5126 if array.ndim == 2 else 5123,
                "count": len(array),
                "type": "VEC3" if array.ndim == 2 else "SCALAR",
            }
        )
        data += array.tobytes()
    header = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": [{"mesh": 0, **node} for node in nodes],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 1}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }
    return header | (extra or {}), data


def glb(header, data):
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(data), 0x004E4942) + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
