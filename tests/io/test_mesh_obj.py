"""OBJ files with their `.mtl`: what is read, what is refused, and what trimesh would make of them."""

import numpy as np
import pytest
from mesh_cases import CUBE, CUBE_QUADS
from mesh_files import by_trimesh, refusal, written

import diffshade as ds

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def test_obj_keeps_the_files_vertices_and_faces(tmp_path):
    lines = [f"v {x} {y} {z}" for x, y, z in CUBE] + ["v 9 9 9"]
    lines += ["f " + " ".join(str(k + 1) for k in quad) for quad in CUBE_QUADS]
    mesh = ds.load_mesh(written(tmp_path, "cube.obj", "\n".join(lines)))
    np.testing.assert_array_equal(mesh.vertices, [*CUBE, [9, 9, 9]])
    expected = [quad[[0, k, k + 1]] for quad in CUBE_QUADS for k in (1, 2)]
    np.testing.assert_array_equal(mesh.faces, expected)
    assert mesh.normals is None
    assert mesh.slot is None
    assert mesh.materials == ()
    assert mesh.vertices.dtype == np.asarray(ds.Sphere().radius).dtype


def test_obj_syntax(tmp_path):
    text = (
        "\ufeff# a comment\r\nv 0 0 0 1.0\r\n  v\t1 0 0 0.5 0.5 nan\r\nv 1e0 1 \\\r\n -0.0\r\n"
        "vt 0 0\r\nvp 1 2 3\r\ns off\r\ng a b\r\nl 1 2\r\n\r\nf 1/1 2/1 3/1\r\n"
    )
    mesh = ds.load_mesh(written(tmp_path, "a b.OBJ", text))
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [1, 1, 0]])
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2]])


def test_obj_comments_after_a_statement(tmp_path):
    text = "v 0 0 0 # first\nv 1 0 0\nv 0 1 0 # last\nf 1 2 3 # a face\n"
    assert ds.load_mesh(written(tmp_path, "a.obj", text)).faces.shape == (1, 3)


def test_obj_negative_indices_count_back_from_their_own_line(tmp_path):
    one = "v 0 0 {z}\nv 1 0 {z}\nv 0 1 {z}\nf -3 -2 -1\n"
    path = written(tmp_path, "a.obj", one.format(z=0) + one.format(z=5))
    mesh = ds.load_mesh(path)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [3, 4, 5]])
    np.testing.assert_array_equal(np.unique(by_trimesh(path).vertices[:, 2]), [5])  # trimesh's


def test_obj_texture_seams_do_not_cut_the_surface(tmp_path, tolerance):
    text = SQUARE + "v 0 1 1\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\nf 1/3 3/1 5/2\n"
    path = written(tmp_path, "a.obj", text)
    mesh = ds.load_mesh(path)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 4]])
    # The two faces' normals, twice their areas long, are (0, 0, 1) and (1, -1, 1).
    shared = np.asarray(mesh.vertex_normals().to_array())[0]
    np.testing.assert_allclose(shared, np.array([1, -1, 2]) / 6**0.5, rtol=10 * tolerance)
    assert len(by_trimesh(path).vertices) == 6  # trimesh's: every corner apart


def test_obj_normals_are_those_of_the_file(tmp_path, tolerance):
    text = SQUARE + "vn 0 0 1\nvn 1 0 1\nvn 0 0 1\nf 1//1 2//2 3//3\nf 1//1 3//2 4//3\n"
    mesh = ds.load_mesh(written(tmp_path, "a.obj", text))
    # Vertex 3 has two normals, and so is two; vertex 1 has one, under whatever number.
    assert mesh.vertices.shape == (5, 3)
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    np.testing.assert_array_equal(
        corners[:, :, :2], [[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]]
    )
    normals = np.asarray(mesh.normals)[np.asarray(mesh.faces)]
    np.testing.assert_allclose(normals[0], [[0, 0, 1], [1, 0, 1], [0, 0, 1]], atol=tolerance)
    np.testing.assert_allclose(normals[1], [[0, 0, 1], [1, 0, 1], [0, 0, 1]], atol=tolerance)


def test_obj_normals_are_completed_where_the_file_has_none(tmp_path, tolerance):
    text = SQUARE + "vn 1 0 1\nvn 0 0 0\nvn nan 0 0\nf 1//1 2//2 3//3\nf 1 3 4\n"
    path = written(tmp_path, "a.obj", text)
    mesh = ds.load_mesh(path)
    normals = np.asarray(mesh.normals)[np.asarray(mesh.faces)]
    np.testing.assert_allclose(normals[0], [[1, 0, 1], [0, 0, 1], [0, 0, 1]], atol=tolerance)
    np.testing.assert_allclose(normals[1], np.tile([0, 0, 1], (3, 1)), atol=tolerance)
    only_zero = ds.load_mesh(written(tmp_path, "b.obj", SQUARE + "vn 0 0 0\nf 1//1 2//1 3//1\n"))
    assert only_zero.normals is None


def test_obj_concave_polygons_are_filled_once(tmp_path):
    text = "v 0 2 0\nv 0 0 0\nv 2 0 0\nv 2 2 0\nv 1 .2 0\nf 1 2 3 4 5\nf 1 2 3\nf 1 2 3 4\n"
    path = written(tmp_path, "a.obj", text)
    mesh = ds.load_mesh(path)
    assert mesh.faces.shape == (3 + 1 + 2, 3)
    normals = np.asarray(mesh.face_normals().to_array())
    np.testing.assert_array_equal(normals[:, 2] > 0.99, np.ones(6, bool))
    assert by_trimesh(path).face_normals[:, 2].min() < 0  # trimesh's fan folds back


MTL = """
newmtl red
Ka 0.1 0.2 0.3
Kd 0.123456789 0.25 0.5
Ks 0.7 0.6 0.5
Ns 96.078431
illum 2

newmtl plain
Kd 0.4
Ks 1 1 1
illum 1
"""
TWO = "v 2 0 0\nusemtl red\nf 1 2 3\nusemtl plain\nf 1 3 4\nusemtl red\nf 2 5 3\n"


def test_obj_materials(tmp_path, tolerance):
    written(tmp_path, "two.mtl", MTL)
    mesh = ds.load_mesh(written(tmp_path, "two.obj", "mtllib two.mtl\n" + SQUARE + TWO))
    np.testing.assert_array_equal(mesh.slot, [0, 1, 0])
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3], [1, 4, 2]])  # one surface
    red, plain = mesh.materials
    np.testing.assert_allclose(red.ka, [0.1, 0.2, 0.3], rtol=tolerance)
    np.testing.assert_allclose(red.kd, [0.123456789, 0.25, 0.5], rtol=tolerance)
    (lobe,) = red.specular
    assert isinstance(lobe, ds.BlinnPhong)
    np.testing.assert_allclose(lobe.ks, [0.7, 0.6, 0.5], rtol=tolerance)
    np.testing.assert_allclose(lobe.shininess, 96.078431, rtol=tolerance)
    np.testing.assert_array_equal(plain.ka, [0, 0, 0])
    np.testing.assert_allclose(plain.kd, [0.4, 0.4, 0.4], rtol=tolerance)
    np.testing.assert_array_equal(plain.specular[0].ks, [0, 0, 0])  # illum 1 has no highlight


def test_obj_materials_render_with_their_own_coefficients(tmp_path, tolerance):
    written(tmp_path, "two.mtl", MTL)
    mesh = ds.load_mesh(written(tmp_path, "two.obj", "mtllib two.mtl\n" + SQUARE + TWO))
    camera = ds.OrthographicCamera(3, 3, 1.0, position=(0.5, 0.5, 5), target=(0.5, 0.5, 0))
    scene = ds.Scene(ambient=1.0, lights=ds.ParallelLight((0, 0, 1)))
    image = ds.render(ds.gbuffer(mesh, camera), scene, mesh.materials)
    red = np.array([[0.1, 0.2, 0.3], [0.123456789, 0.25, 0.5], [0.7, 0.6, 0.5]]).sum(axis=0)
    np.testing.assert_allclose(image[2, 1], red, rtol=10 * tolerance)  # below the diagonal
    np.testing.assert_allclose(image[0, 1], [0.4, 0.4, 0.4], rtol=10 * tolerance)


@pytest.mark.parametrize(
    ("mtl", "ambient", "diffuse", "specular"),
    [
        ("Kd 1 0 0\nillum 1", False, True, False),
        ("Ka 1 1 1\nKd 1 0 0\nKs 1 1 1\nillum 0", False, True, False),
        ("Ka 1 1 1\nKs 1 1 1", True, False, True),
        ("Kd 1 1 1\nKs 0 0 0\nNs 10\nillum 2", False, True, True),
        ("Kd 1 1 1\nKs 0.5 0.5 0.5\nNs 10\nillum 7", False, True, True),
    ],
)
def test_obj_material_terms_that_the_file_lacks_are_absent(
    tmp_path, mtl, ambient, diffuse, specular
):
    written(tmp_path, "m.mtl", f"newmtl a\n{mtl}\n")
    text = "mtllib m.mtl\n" + SQUARE + "usemtl a\nf 1 2 3\n"
    (material,) = ds.load_mesh(written(tmp_path, "m.obj", text)).materials
    assert (material.ka is not None) == ambient
    assert (material.kd is not None) == diffuse
    assert bool(material.specular) == specular


def test_one_material_needs_no_slots(tmp_path):
    written(tmp_path, "m.mtl", "newmtl a b\nKd 0.5\n")
    text = "mtllib m.mtl\n" + SQUARE + "usemtl a b\nf 1 2 3\nf 1 3 4\n"
    mesh = ds.load_mesh(written(tmp_path, "m.obj", text))
    assert mesh.slot is None
    assert len(mesh.materials) == 1


def test_obj_libraries_are_found_by_their_names(tmp_path):
    written(tmp_path, "my library.mtl", "newmtl a\nKd 0.5\n")
    written(tmp_path, "other.mtl", "newmtl b\nKd 0.25\n")
    faces = SQUARE + "usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n"
    for number, named in enumerate(
        (
            "mtllib my library.mtl\nmtllib other.mtl\n",
            "mtllib C:\\somebody\\models\\my library.mtl\nmtllib ./other.mtl\n",
        )
    ):
        mesh = ds.load_mesh(written(tmp_path, f"{number}.obj", named + faces))
        assert len(mesh.materials) == 2
    written(tmp_path, "first.mtl", "newmtl a\nKd 0.5\n")
    both = written(tmp_path, "both.obj", "mtllib first.mtl other.mtl\n" + faces)
    assert len(ds.load_mesh(both).materials) == 2


def test_materials_that_are_not_there_are_warned_of(tmp_path):
    written(tmp_path, "m.mtl", "newmtl a\nKd 0.5\n")
    cases = {
        "mtllib gone.mtl\n" + SQUARE + "usemtl a\nf 1 2 3\n": "'a' was not found in gone.mtl",
        "mtllib m.mtl\n" + SQUARE + "usemtl b\nf 1 2 3\n": "'b' was not found",
        "mtllib m.mtl\n" + SQUARE + "f 1 2 3\nusemtl a\nf 1 3 4\n": "before the first usemtl",
    }
    for text, message in cases.items():
        with pytest.warns(UserWarning, match=message) as caught:
            mesh = ds.load_mesh(written(tmp_path, "m.obj", text))
        assert caught[0].filename == __file__
        assert mesh.materials == ()
    np.testing.assert_array_equal(mesh.slot, [0, 1])


def test_textures_are_warned_of(tmp_path):
    written(tmp_path, "m.mtl", "newmtl a\nKd 0.5\nmap_Kd wood.png\nbump bark.png\n")
    text = "mtllib m.mtl\n" + SQUARE + "usemtl a\nf 1 2 3\n"
    with pytest.warns(UserWarning, match=r"textures are not read \(bump, map_kd\)"):
        mesh = ds.load_mesh(written(tmp_path, "m.obj", text))
    np.testing.assert_allclose(mesh.materials[0].kd, 0.5)


def test_objects_are_slots_where_there_are_no_materials(tmp_path):
    text = SQUARE + "o one\nf 1 2 3\no two\nf 1 3 4\n"
    mesh = ds.load_mesh(written(tmp_path, "a.obj", text))
    np.testing.assert_array_equal(mesh.slot, [0, 1])
    assert mesh.materials == ()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0\n", "line 1: 2 coordinates where three belong"),
        ("v 0 0 zero\n", "line 1: could not convert string to float"),
        (SQUARE + "v 0 nan 0\n", "line 5: the vertex 0 nan 0 is not finite"),
        (SQUARE + "f 1 2\n", "line 5: a polygon needs three corners"),
        (SQUARE + "f 1 2 0\n", "line 5: there is no number 0"),
        (SQUARE + "f 1 2 -5\n", "line 5: there is no number -5 among 4"),
        (SQUARE + "\nf 1 2 5\n", "line 6: refers to vertex 5 of 4"),
        (SQUARE + "f 1//1 2//1 3//1\n", "line 5: refers to normal 1 of 0"),
        (SQUARE + "f a b c\n", "line 5: invalid literal"),
        (SQUARE, "holds 4 vertices and no faces"),
        ("", "holds 0 vertices and no faces"),
        ("Dear reader,\nthis is no mesh.\n", "holds 0 vertices and no faces"),
    ],
)
def test_what_is_no_obj_is_refused(tmp_path, text, message):
    assert message in refusal(written(tmp_path, "a.obj", text))


@pytest.mark.parametrize(
    ("mtl", "message"),
    [
        ("newmtl a\nKd red\n", "line 2: 'red' is no number"),
        ("newmtl a\nKd 1 2\n", "line 2: 2 numbers for a colour"),
        ("newmtl a\n\nKs spectral file.rfl\n", "line 3: a colour given as 'spectral'"),
        ("newmtl a\nNs -1\n", "line 2: '-1'; give a finite number"),
        ("newmtl a\nNs nan\n", "line 2: 'nan'; give a finite number"),
    ],
)
def test_what_is_no_mtl_is_refused(tmp_path, mtl, message):
    library = written(tmp_path, "m.mtl", mtl)
    path = written(tmp_path, "m.obj", "mtllib m.mtl\n" + SQUARE + "usemtl a\nf 1 2 3\n")
    with pytest.raises(ds.BadInput) as refused:
        ds.load_mesh(path)
    assert str(refused.value).startswith(f"{library}, {message}")
