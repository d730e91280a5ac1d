"""Malformed meshes and material libraries."""

import base64
import json
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from malformed.case import Case, Format, any_file, damaged, escapes, replaced
from mesh_cases import CUBE, CUBE_FACES
from mesh_files import glb, gltf, ply, stl, stl_binary

import diffshade as ds

HUGE = 3_000_000_000
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
WITH_MTL = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n"
LIBRARY = "newmtl red\nKa 0.1 0 0\nKd 0.8 0.1 0.1\nKs 0.3 0.3 0.3\nNs 40\nillum 2\n"
CORNERS = CUBE[CUBE_FACES]


def _format(name: str, file: str, content: bytes, *, text: bool = False) -> Format:
    return Format(
        name, file, lambda folder: (folder / file).write_bytes(content), ds.load_mesh, text=text
    )


def _with_mtl(folder: Path) -> None:
    (folder / "m.obj").write_text(WITH_MTL)
    (folder / "m.mtl").write_text(LIBRARY)


def _header(**changes: Any) -> dict[str, Any]:
    header, data = gltf([{}])
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    header["buffers"][0]["uri"] = uri
    return header | changes


def _beside(folder: Path) -> None:
    """A glTF file with its data in another one."""
    header, data = gltf([{}])
    header["buffers"][0]["uri"] = "cube.bin"
    (folder / "a.gltf").write_text(json.dumps(header))
    (folder / "cube.bin").write_bytes(data)


OBJ = _format("obj", "a.obj", TRIANGLE.encode(), text=True)
MTL = Format("mtl", "m.mtl", _with_mtl, lambda path: ds.load_mesh(path.with_name("m.obj")))
PLY = _format("ply", "a.ply", ply(CUBE, CUBE_FACES.tolist()), text=True)
PLY_BINARY = _format(
    "ply, binary", "a.ply", ply(CUBE, CUBE_FACES.tolist(), kind="binary_little_endian 1.0")
)
STL = _format("stl", "a.stl", stl(CORNERS).encode(), text=True)
STL_BINARY = _format("stl, binary", "a.stl", stl_binary(CORNERS))
GLTF = _format("gltf", "a.gltf", json.dumps(_header()).encode(), text=True)
GLB = _format("glb", "a.glb", glb(*gltf([{}])))
FORMATS = (OBJ, MTL, PLY, PLY_BINARY, STL, STL_BINARY, GLTF, GLB)


def of_obj() -> Iterator[Case]:
    for case in any_file(OBJ, cuts=(0.1, 0.5, 0.9)):
        if case.name != "bytes":  # names are in any encoding
            yield case
    for number in ("nan", "inf", "-Infinity", "1e30"):
        yield replaced(OBJ, "NaN", number, "v 1 0 0", f"v 1 {number} 0")
    for name, line in {
        "an index beyond": "f 1 2 4",
        "index 0": "f 0 1 2",
        "an index before": "f -1 -2 -9",
        "two corners": "f 1 2",
        "a normal beyond": "f 1//1 2//1 3//1",
        "an index of many digits": f"f 1 2 {'9' * 5000}",
        "a large index": f"f 1 2 {10**30}",
    }.items():
        kind = "wrong shape" if "digits" not in name and "large" not in name else "absurd header"
        yield replaced(OBJ, kind, name, "f 1 2 3", line)
    yield replaced(OBJ, "wrong shape", "two coordinates", "v 1 0 0", "v 1 0")
    yield replaced(OBJ, "wrong type", "a coordinate in words", "v 1 0 0", "v one 0 0")
    yield replaced(OBJ, "wrong type", "an index in words", "f 1 2 3", "f one 2 3")
    yield replaced(OBJ, "wrong type", "an index with a point", "f 1 2 3", "f 1.5 2 3")
    yield replaced(OBJ, "wrong type", "no index", "f 1 2 3", "f / 2 3")
    yield replaced(OBJ, "missing key", "no faces", "f 1 2 3", "")
    yield replaced(OBJ, "missing key", "no vertices", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "")
    yield damaged(OBJ, "bomb", "a star of 20,000 corners", lambda _: _star(20_000))
    yield damaged(OBJ, "bomb", "a star of 5,000 corners", lambda _: _star(5_000))
    yield from escapes(
        Format("obj", "m.obj", _with_mtl, ds.load_mesh),
        "m.mtl",
        lambda path, other: _write(path, WITH_MTL.replace("m.mtl", other)),
    )


def _star(corners: int) -> bytes:
    """One polygon that is concave at every second corner: to cut off its ears takes the cube of it."""
    turn = np.arange(corners) * 2 * np.pi / corners
    radius = np.where(np.arange(corners) % 2, 0.5, 1.0)
    places = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    lines = [f"v {x} {y} 0" for x, y in places]
    return "\n".join([*lines, "f " + " ".join(map(str, range(1, corners + 1)))]).encode()


def _write(path: Path, text: str) -> None:
    path.write_text(text)


def of_mtl() -> Iterator[Case]:
    for case in any_file(MTL):
        if case.kind == "too large" and "device" not in case.name:  # which counts as absent
            yield case
    # Without magic, and empty, it is a library that lacks the material.
    yield damaged(MTL, "truncated", "in a colour", lambda c: c[: c.index(b" 0\nKd")])
    yield damaged(MTL, "truncated", "before a colour", lambda c: c[: c.index(b" 0.8")])
    yield damaged(MTL, "truncated", "before a number", lambda c: c[: c.index(b" 40")])
    for number in ("nan", "inf", "-1", "1e999"):
        yield replaced(MTL, "NaN", f"Ns {number}", "Ns 40", f"Ns {number}")
        yield replaced(MTL, "NaN", f"Kd {number}", "Kd 0.8", f"Kd {number}")
    yield replaced(MTL, "wrong shape", "two colours", "Kd 0.8 0.1 0.1", "Kd 0.8 0.1")
    yield replaced(MTL, "wrong shape", "no colours", "Kd 0.8 0.1 0.1", "Kd")
    yield replaced(MTL, "wrong shape", "two exponents", "Ns 40", "Ns 40 41")
    yield replaced(MTL, "wrong type", "a colour in words", "Kd 0.8", "Kd red")
    yield replaced(MTL, "wrong type", "a spectrum", "Kd 0.8 0.1 0.1", "Kd spectral a.rfl")
    yield replaced(MTL, "wrong type", "illum in words", "illum 2", "illum Phong")
    yield replaced(MTL, "absurd header", "a number of many digits", "Ns 40", f"Ns {'9' * 5000}")
    yield replaced(MTL, "absurd header", "a coefficient of 1e300", "Kd 0.8", f"Kd {10**309}")


def _plys(format: Format) -> Iterator[Case]:
    for element, count in (("vertex", HUGE), ("face", HUGE), ("vertex", 10**30)):
        old = {"vertex": "element vertex 8", "face": "element face 12"}[element]
        yield replaced(
            format, "absurd header", f"{count} of {element}", old, f"element {element} {count}"
        )
    yield replaced(
        format, "wrong type", "a count in words", "element vertex 8", "element vertex many"
    )
    yield replaced(
        format, "wrong shape", "a negative count", "element vertex 8", "element vertex -8"
    )
    yield replaced(format, "wrong shape", "one vertex more", "element vertex 8", "element vertex 9")
    yield replaced(format, "wrong shape", "one face more", "element face 12", "element face 13")
    yield replaced(format, "wrong dtype", "an unknown type", "property float x", "property text x")
    yield replaced(
        format, "wrong dtype", "a list of x", "property float x", "property list uchar float x"
    )
    yield replaced(format, "missing key", "no x", "property float x", "property float u")
    yield replaced(format, "missing key", "no end of header", "end_header", "end_of_it")


def of_ply() -> Iterator[Case]:
    yield from any_file(PLY, cuts=(0.05, 0.6, 0.9))
    yield from _plys(PLY)
    yield replaced(PLY, "missing key", "no faces", "vertex_indices", "others")
    for number in ("nan", "inf", "1e30"):
        yield replaced(PLY, "NaN", number, "end_header\n-1.0", f"end_header\n{number}")
    yield replaced(
        PLY, "wrong type", "a coordinate in words", "end_header\n-1.0", "end_header\none"
    )
    yield damaged(PLY, "wrong shape", "an index beyond", lambda c: c.rstrip()[:-1] + b"9\n")
    yield from any_file(PLY_BINARY)
    yield from _plys(PLY_BINARY)
    start = PLY_BINARY_CONTENT.index(b"end_header\n") + 11
    for value in (np.nan, np.inf, 1e30):
        yield damaged(
            PLY_BINARY,
            "NaN",
            str(value),
            lambda c, v=value: c[:start] + struct.pack("<f", v) + c[start + 4 :],
        )
    lists = start + 8 * 12
    yield damaged(
        PLY_BINARY, "bomb", "a list of 255", lambda c: c[:lists] + b"\xff" + c[lists + 1 :]
    )
    long = PLY_BINARY_CONTENT.replace(b"list uchar int", b"list uint int")
    yield damaged(
        PLY_BINARY,
        "bomb",
        "a list of 4e9",
        lambda _: long[: lists - 1] + struct.pack("<I", 2**32 - 1) + long[lists - 1 :],
    )


PLY_BINARY_CONTENT = ply(CUBE, CUBE_FACES.tolist(), kind="binary_little_endian 1.0")


def of_stl() -> Iterator[Case]:
    yield from any_file(STL)
    for number in ("nan", "inf", "1e30"):
        yield damaged(
            STL,
            "NaN",
            number,
            lambda c, n=number: c.replace(b"vertex -1", f"vertex {n}".encode(), 1),
        )
    yield replaced(STL, "wrong type", "a coordinate in words", "vertex -1.0", "vertex one")
    yield damaged(STL, "wrong shape", "a corner of two numbers", _two_numbers)
    yield replaced(STL, "missing key", "no end", "endsolid", "end of it")
    yield damaged(STL, "missing key", "no corners", lambda c: c.replace(b"vertex", b"corner"))
    yield replaced(
        STL, "wrong shape", "the end first", "solid made here", "endsolid\nsolid made here"
    )
    yield from any_file(STL_BINARY, magic_at=None)
    for count in (13, 2**32 - 1, 11):
        yield damaged(
            STL_BINARY,
            "absurd header" if count > 13 else "wrong shape",
            f"{count} triangles",
            lambda c, n=count: c[:80] + struct.pack("<I", n) + c[84:],
        )
    for value in (np.nan, -np.inf, 1e30):
        yield damaged(
            STL_BINARY,
            "NaN",
            str(value),
            lambda c, v=value: c[:96] + struct.pack("<f", v) + c[100:],
        )


def _two_numbers(content: bytes) -> bytes:
    lines = content.split(b"\n")
    lines[3] = b" ".join(lines[3].split()[:3])
    return b"\n".join(lines)


def _gltf_headers() -> Iterator[tuple[str, str, Callable[[dict[str, Any]], object]]]:
    """Changes of a header, each with its class and name."""

    def accessor(number: int, **values: Any) -> Callable[[dict[str, Any]], object]:
        return lambda header: header["accessors"][number].update(values)

    def without(*keys: Any) -> Callable[[dict[str, Any]], object]:
        def change(header: dict[str, Any]) -> None:
            inside: Any = header
            for key in keys[:-1]:
                inside = inside[key]
            del inside[keys[-1]]

        return change

    yield "absurd header", "3e9 vertices", accessor(0, count=HUGE)

    def from_nothing(header: dict[str, Any]) -> None:
        header["accessors"][0]["count"] = HUGE
        del header["accessors"][0]["bufferView"]

    yield "absurd header", "3e9 vertices from nothing", from_nothing
    yield "missing key", "vertices from nothing", without("accessors", 0, "bufferView")
    yield "missing key", "indices from nothing", without("accessors", 1, "bufferView")
    yield "absurd header", "10^30 indices", accessor(1, count=10**30)
    yield "absurd header", "a long view", lambda h: h["bufferViews"][0].update(byteLength=2**40)

    def million(header: dict[str, Any]) -> None:
        """A million faces, in so many bytes more."""
        header["more"] = 2 * 3 * 10**6
        at = sum(view["byteLength"] for view in header["bufferViews"])
        header["bufferViews"].append({"buffer": 0, "byteOffset": at, "byteLength": header["more"]})
        header["accessors"][1] |= {"bufferView": 2, "count": 3 * 10**6}
        header["buffers"][0]["byteLength"] += header["more"]

    def instances(header: dict[str, Any]) -> None:
        """A million corners at a thousand places: no file of any size, but 3e9 numbers."""
        million(header)
        header["nodes"] = [{"mesh": 0} for _ in range(1000)]
        header["scenes"][0]["nodes"] = list(range(1000))

    yield "bomb", "a thousand places", instances

    def primitives(header: dict[str, Any]) -> None:
        million(header)
        header["meshes"][0]["primitives"] *= 1000

    yield "bomb", "a thousand primitives", primitives
    yield "wrong dtype", "an unknown type", accessor(0, componentType=9999)
    yield "wrong dtype", "an unknown shape", accessor(0, type="VEC9")
    yield "wrong shape", "two coordinates", accessor(0, type="VEC2", count=12)
    yield "wrong shape", "an index beyond", accessor(0, count=4)
    yield "wrong shape", "no third index", accessor(1, count=35)
    yield "wrong shape", "a negative count", accessor(0, count=-8)
    yield "wrong shape", "a negative offset", lambda h: h["bufferViews"][0].update(byteOffset=-9)
    yield "wrong shape", "a matrix of 9", lambda h: h["nodes"][0].update(matrix=[1] * 9)
    yield "NaN", "in a matrix", lambda h: h["nodes"][0].update(translation=[0, 0, float("nan")])
    yield "NaN", "a scale of 1e300", lambda h: h["nodes"][0].update(scale=[1, 1, 1e300])
    yield "NaN", "an infinite scale", lambda h: h["nodes"][0].update(scale=[1, 1, float("inf")])
    yield "missing key", "no accessors", without("accessors")
    yield (
        "missing key",
        "no POSITION",
        without("meshes", 0, "primitives", 0, "attributes", "POSITION"),
    )
    yield "missing key", "no meshes", without("meshes")
    yield "missing key", "no scenes", without("scenes")
    yield "missing key", "no count", without("accessors", 0, "count")
    yield "wrong type", "a count in words", accessor(0, count="eight")
    yield "wrong type", "a list of nodes in words", lambda h: h.update(nodes="none")
    yield "wrong type", "a mesh beyond", lambda h: h["nodes"][0].update(mesh=7)
    yield (
        "wrong type",
        "an accessor beyond",
        lambda h: h["meshes"][0]["primitives"][0].update(indices=9),
    )
    yield "wrong type", "version 1", lambda h: h["asset"].update(version="1.0")
    yield (
        "wrong type",
        "compressed",
        lambda h: h.update(extensionsRequired=["EXT_meshopt_compression"]),
    )

    def circle(header: dict[str, Any]) -> None:
        header["nodes"] = [{"children": [1]}, {"children": [0]}]

    yield "bomb", "nodes in a circle", circle


def of_gltf() -> Iterator[Case]:
    yield from any_file(GLTF)
    yield from any_file(GLB)
    for kind, name, change in _gltf_headers():

        def text(content: bytes, change: Callable[[dict[str, Any]], object] = change) -> bytes:
            header = json.loads(content)
            change(header)
            more = base64.b64encode(bytes(header.pop("more", 0))).decode()
            header["buffers"][0]["uri"] += more
            return json.dumps(header).encode()

        def binary(_: bytes, change: Callable[[dict[str, Any]], object] = change) -> bytes:
            header, data = gltf([{}])
            change(header)
            return glb(header, data + bytes(header.pop("more", 0)))

        yield damaged(GLTF, kind, name, text)
        yield damaged(GLB, kind, name, binary)
    for value in (np.nan, np.inf, 1e30):
        yield damaged(
            GLB,
            "NaN",
            str(value),
            lambda c, v=value: c.replace(struct.pack("<f", -1), struct.pack("<f", v), 1),
        )
    yield damaged(
        GLB, "absurd header", "a long chunk", lambda c: c[:12] + b"\xff\xff\xff\xff" + c[16:]
    )
    yield damaged(GLB, "wrong shape", "another version", lambda c: c[:4] + b"\3" + c[5:])
    yield damaged(GLTF, "bomb", "nested", lambda _: b"[" * 10**6)
    yield damaged(GLTF, "wrong type", "a list", lambda _: b"[]")
    yield damaged(GLTF, "wrong type", "a number of 5,000 digits", lambda _: b"9" * 5000)
    yield damaged(GLTF, "missing key", "nothing", lambda _: b"{}")

    def named(path: Path, other: str) -> None:
        header = json.loads(path.read_text())
        header["buffers"][0]["uri"] = other
        path.write_text(json.dumps(header))

    yield from escapes(Format("gltf", "a.gltf", _beside, ds.load_mesh), "cube.bin", named)


def cases() -> Iterator[Case]:
    for of in (of_obj, of_mtl, of_ply, of_stl, of_gltf):
        yield from of()
