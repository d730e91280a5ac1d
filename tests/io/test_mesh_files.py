"""PLY, STL and glTF files, and every mesh of the shared data: what is read, what is refused."""

import json
import logging
import warnings

import jax
import numpy as np
import pytest
from mesh_cases import CUBE, CUBE_FACES, CUBE_QUADS
from mesh_files import glb, gltf, ply, refusal, stl, stl_binary, written
from shared import shared_data

import diffshade as ds

# PLY


@pytest.mark.parametrize("kind", ["ascii 1.0", "binary_little_endian 1.0", "binary_big_endian 1.0"])
@pytest.mark.parametrize("faces", [CUBE_FACES, CUBE_QUADS], ids=["triangles", "quads"])
def test_ply(tmp_path, kind, faces):
    mesh = ds.load_mesh(written(tmp_path, "a.ply", ply(CUBE, faces.tolist(), kind=kind)))
    np.testing.assert_array_equal(mesh.vertices, CUBE)
    assert mesh.faces.shape == (12, 3)
    outwards = np.asarray(mesh.face_normals().to_array()) * CUBE[np.asarray(mesh.faces)].mean(1)
    assert (outwards.sum(axis=1) > 0.5).all()
    assert mesh.normals is None  # trimesh would give its own


def test_ply_polygons_and_normals(tmp_path, tolerance):
    flat = [[0, 2, 0], [0, 0, 0], [2, 0, 0], [2, 2, 0], [1, 0.25, 0]]
    normals = [[0, 0, 2], [0, 0, 0], [1, 0, 1], [0, 0, 1], [0, 0, 1]]
    path = written(tmp_path, "a.ply", ply(flat, [[0, 1, 2, 3, 4]], normals))
    mesh = ds.load_mesh(path)
    assert (np.asarray(mesh.face_normals().z) > 0.99).all()  # concave, and filled once
    expected = [[0, 0, 1], [0, 0, 1], [0.5**0.5, 0, 0.5**0.5], [0, 0, 1], [0, 0, 1]]
    np.testing.assert_allclose(mesh.vertex_normals().to_array(), expected, atol=10 * tolerance)


def test_ply_of_mixed_polygons(tmp_path):
    faces = [[0, 1, 2], [0, 2, 3, 4]]
    pentagon = [[0, 0, 0], [2, 0, 0], [3, 2, 0], [1, 3, 0], [-1, 2, 0]]
    mesh = ds.load_mesh(written(tmp_path, "a.ply", ply(pentagon, faces)))
    assert mesh.faces.shape == (3, 3)
    binary = written(tmp_path, "b.ply", ply(pentagon, faces, kind="binary_little_endian 1.0"))
    assert "no PLY file that can be read" in refusal(binary)


def test_ply_that_is_cut_off_is_refused(tmp_path):
    whole = ply(CUBE, CUBE_FACES.tolist())
    lines = whole.decode().splitlines()
    for left in (len(lines) - 1, len(lines) - 15):
        text = "\n".join(lines[:left]) + "\n"
        assert "the file is cut off" in refusal(written(tmp_path, "a.ply", text))
    binary = ply(CUBE, CUBE_FACES.tolist(), kind="binary_little_endian 1.0")
    assert "no PLY file" in refusal(written(tmp_path, "b.ply", binary[:-5]))


def test_ply_with_wrong_indices_or_vertices_is_refused(tmp_path):
    path = written(tmp_path, "a.ply", ply(CUBE, [[0, 1, 8]]))
    assert "faces refer to vertices 0 to 8 of 8" in refusal(path)
    broken = CUBE.copy()
    broken[3, 1] = np.nan
    path = written(tmp_path, "b.ply", ply(broken, [[0, 1, 2]]))
    assert "vertex number 3 is not finite" in refusal(path)
    path = written(tmp_path, "c.ply", ply(CUBE, [[0, 1, 2]]).replace(b"3 0 1 2", b"3 0 one 2"))
    assert "no PLY file that can be read" in refusal(path)


# STL


@pytest.mark.parametrize("write", [stl, stl_binary])
def test_stl_corners_at_one_place_are_one_vertex(tmp_path, write):
    corners = CUBE[CUBE_FACES]
    mesh = ds.load_mesh(written(tmp_path, "a.stl", write(corners)))
    assert mesh.vertices.shape == (8, 3)
    np.testing.assert_array_equal(np.asarray(mesh.vertices)[np.asarray(mesh.faces)], corners)
    np.testing.assert_array_equal(mesh.faces[0], [0, 1, 2])  # numbered as they appear
    assert mesh.normals is None
    assert mesh.slot is None


def test_stl_solids_are_slots(tmp_path):
    corners = CUBE[CUBE_FACES]
    mesh = ds.load_mesh(written(tmp_path, "a.stl", stl(corners, "a") + stl(corners + 4.0, "b")))
    np.testing.assert_array_equal(mesh.slot, [0] * 12 + [1] * 12)
    assert mesh.vertices.shape == (16, 3)


def test_stl_that_is_none_is_refused(tmp_path):
    whole = stl_binary(CUBE[CUBE_FACES])
    assert "no STL file" in refusal(written(tmp_path, "a.stl", whole[:-7]))
    assert "no faces" in refusal(written(tmp_path, "b.stl", "hello\n"))
    assert "no faces" in refusal(written(tmp_path, "c.stl", stl_binary(np.zeros((0, 3, 3)))))


# glTF


def test_glb(tmp_path):
    mesh = ds.load_mesh(written(tmp_path, "a.glb", glb(*gltf([{}]))))
    np.testing.assert_array_equal(mesh.vertices, CUBE)
    np.testing.assert_array_equal(mesh.faces, CUBE_FACES)
    assert mesh.normals is None
    assert mesh.slot is None


def test_gltf_with_its_data_beside_it(tmp_path):
    header, data = gltf([{}])
    header["buffers"][0]["uri"] = "cube.bin"
    path = written(tmp_path, "a.gltf", json.dumps(header))
    assert "cube.bin: there is no such file" in refusal(path)
    written(tmp_path, "cube.bin", data)
    np.testing.assert_array_equal(ds.load_mesh(path).faces, CUBE_FACES)


def test_gltf_nodes_move_their_meshes(tmp_path, tolerance):
    normals = CUBE / 3**0.5
    nodes = [
        {"translation": [10, 0, 0], "scale": [1, 2, 4]},
        {"scale": [-1, 1, 1]},  # a mirror image: the faces turn round, the outside stays outside
    ]
    mesh = ds.load_mesh(written(tmp_path, "a.glb", glb(*gltf(nodes, normals))))
    assert mesh.slot is None  # one primitive, and so one material, at two places
    far = np.asarray(mesh.vertices)[:, 0] > 5
    assert (np.diff(np.flatnonzero(far)) == 1).all()
    first, second = np.asarray(mesh.vertices)[far], np.asarray(mesh.vertices)[~far]
    np.testing.assert_allclose(first, CUBE * np.array([1, 2, 4]) + np.array([10, 0, 0]))
    np.testing.assert_allclose(second, CUBE * np.array([-1, 1, 1]))
    stretched = CUBE / np.array([1, 2, 4])  # normals shrink where the surface stretches
    stretched /= np.linalg.norm(stretched, axis=1, keepdims=True)
    normals = np.asarray(mesh.vertex_normals().to_array())
    np.testing.assert_allclose(normals[far], stretched, atol=1e-6)
    np.testing.assert_allclose(normals[~far], second / 3**0.5, atol=1e-6)
    outwards = np.asarray(mesh.face_normals().to_array())
    centres = np.asarray(mesh.vertices)[np.asarray(mesh.faces)].mean(axis=1)
    centres[centres[:, 0] > 5] -= [10, 0, 0]
    assert ((outwards * centres).sum(axis=1) > 0.5).all()


def test_gltf_primitives_are_slots(tmp_path):
    header, data = gltf([{}])
    header["meshes"][0]["primitives"] *= 2
    header["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "mode": 0})  # points
    mesh = ds.load_mesh(written(tmp_path, "a.glb", glb(header, data)))
    np.testing.assert_array_equal(mesh.slot, [0] * 12 + [1] * 12)
    assert mesh.materials == ()


def test_compressed_gltf_is_refused_and_not_read_as_zeros(tmp_path, capfd):
    header, data = gltf([{}])
    extension = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
    header["meshes"][0]["primitives"][0]["extensions"] = extension
    header["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    for accessor in header["accessors"]:
        del accessor["bufferView"]
    refusal(written(tmp_path, "a.glb", glb(header, data)))
    assert capfd.readouterr() == ("", "")


# all


def test_what_is_not_there_or_of_another_kind_is_refused(tmp_path):
    assert "there is no such file" in refusal(tmp_path / "gone.obj")
    assert "there is no such file" in refusal(tmp_path)
    for name in ("a.fbx", "a", "a.mtl"):
        assert "is no mesh format" in refusal(written(tmp_path, name, "x"))


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "glb", "gltf"])
def test_noise_is_refused_in_silence(tmp_path, suffix, capfd, rng):
    capfd.readouterr()
    for content in (b"", b"no mesh\n", rng.bytes(3000), b"ply\n", b"glTF" + bytes(20)):
        refusal(written(tmp_path, f"a.{suffix}", content))
    assert capfd.readouterr() == ("", "")
    assert logging.getLogger("trimesh").propagate
    assert not logging.getLogger("trimesh").handlers


REFUSED = {"empty.obj", "obj_empty.obj", "ply_points_bin.ply", "stl_empty_bin.stl"}
WARNED = {
    "polygonfaces.obj": "material 'Material' was not found",
    "singlevn.obj": "material 'Material' was not found",
    "wallhole.obj": "9 of 66 faces have no area: left out",
}
SCENE = ds.Scene(ambient=0.1, lights=ds.ParallelLight((1, 2, 3)))
MATERIAL = ds.Material(ka=1.0, kd=0.6, specular=ds.Phong(0.3, 20.0))
vertex_normals = jax.jit(lambda mesh: mesh.vertex_normals().to_array())


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["clean", "nasty"])
def test_every_shared_mesh_is_rendered_or_refused(kind, capfd):
    files = [
        path
        for path in sorted(shared_data("meshes", kind).iterdir())
        if path.suffix in (".obj", ".ply", ".stl", ".glb")
    ]
    assert len(files) > 10
    frequencies = [ds.PhongShading(), ds.FlatShading(), ds.GouraudShading()]
    for turn, path in enumerate(files):
        if path.name in REFUSED:
            assert "no faces; give a mesh of triangles" in refusal(path)
            continue
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            mesh = ds.load_mesh(path)
        assert len(caught) == (path.name in WARNED), path.name
        for warning in caught:
            assert str(warning.message).startswith(f"{path}: {WARNED[path.name]}")
        corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
        low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        size, target = float((high - low).max()), (low + high) / 2
        camera = ds.OrthographicCamera(
            16, 16, 1.1 * size, position=target + size * np.array([1.0, 2, 3]), target=target
        )
        seen = ds.visibility(mesh, camera)
        assert seen.index.size > 5, path.name
        assert not mesh.degenerate()[np.asarray(seen.face)].any()
        # In turns, as each compiles a program for each mesh; several materials know no Gouraud shading
        shading = frequencies[turn % (3 if mesh.slot is None else 2)]
        image = np.asarray(
            ds.render(ds.gbuffer(mesh, camera, seen, shading=shading), SCENE, MATERIAL)
        )
        assert np.isfinite(image).all(), path.name
        assert image.max() > 0.1, path.name
        if kind == "clean":
            continue
        lengths = np.linalg.norm(vertex_normals(mesh), axis=1)
        used = lengths[np.unique(np.asarray(mesh.faces)[~mesh.degenerate()])]
        has_normal = np.abs(used - 1) < 1e-5
        assert (has_normal | (used == 0)).all()  # where two faces lie back to back it is zero
        assert has_normal.mean() > 0.99
    assert capfd.readouterr() == ("", "")
