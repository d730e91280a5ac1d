"""What a mesh is built of, and what it says about itself."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mesh_cases import CUBE, CUBE_FACES, cube

import diffshade as ds

TRIANGLE = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def test_face_normals_point_outwards(tolerance):
    centroids = CUBE[CUBE_FACES].mean(axis=1)
    normals = np.asarray(cube().face_normals().to_array())
    np.testing.assert_allclose(np.abs(normals).max(axis=1), 1, atol=tolerance)
    assert ((normals * centroids).sum(axis=1) > 0.9).all()


def test_given_normals_are_used_and_normalised(tolerance):
    mesh = ds.Mesh(TRIANGLE, [[0, 1, 2]], [[0, 0, 2], [3, 0, 4], [0, 0, 0]])
    expected = [[0, 0, 1], [0.6, 0, 0.8], [0, 0, 0]]
    np.testing.assert_allclose(mesh.vertex_normals().to_array(), expected, atol=tolerance)


def test_degenerate_faces_are_named():
    vertices = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [0.1, 0.1, 0.1], [0.3, 0.3, 0.3]]
    faces = [[0, 1, 2], [0, 1, 3], [0, 0, 3], [4, 5, 0], [3, 3, 3]]
    mesh = ds.Mesh(vertices, faces)
    np.testing.assert_array_equal(mesh.degenerate(), [True, False, True, True, True])
    for scale in (1e-15, 1e15):
        scaled = ds.Mesh(scale * np.array(vertices), faces)
        np.testing.assert_array_equal(scaled.degenerate(), mesh.degenerate())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]]), r"vertices has shape \(3, 2\)"),
        ((TRIANGLE, [0, 1, 2]), r"faces has shape \(3,\)"),
        ((TRIANGLE, [[0, 1, 2, 0]]), r"faces has shape \(1, 4\)"),
        ((TRIANGLE, [[0.0, 1.0, 2.0]]), "faces holds float64 numbers: give whole numbers"),
        ((TRIANGLE, [[0, 1, 3]]), "faces refers to vertices 0 to 3 of 3"),
        ((TRIANGLE, [[0, 1, -1]]), "faces refers to vertices -1 to 1 of 3"),
        ((TRIANGLE, [[0, 1, 2]], [[0, 0, 1]]), r"normals has shape \(1, 3\)"),
        ((TRIANGLE, [[0, 1, 2]], None, [0, 1]), r"slot has shape \(2,\) for 1 faces"),
        ((TRIANGLE, [[0, 1, 2]], None, [0.5]), "slot holds float64"),
        (([[0, 0, np.nan], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), "vertices .* must be finite"),
    ],
)
def test_what_is_no_mesh_is_refused(arguments, message):
    with pytest.raises(ds.BadInput, match=message) as refusal:
        ds.Mesh(*arguments)
    assert "\n" not in str(refusal.value)


def test_a_mesh_can_be_built_of_traced_vertices():
    def height(vertices):
        return ds.Mesh(vertices, CUBE_FACES).vertex_normals().z[7]

    assert np.isfinite(jax.jit(jax.grad(height))(jnp.array(CUBE))).all()


def test_a_visibility_of_something_else_is_refused():
    camera = ds.OrthographicCamera(4, 4, 2.0)
    of_sphere = ds.visibility(ds.Sphere(), camera)
    for shading in (ds.PhongShading(), ds.FlatShading(), ds.GouraudShading()):
        with pytest.raises(ds.BadInput, match="has no faces, so it is not that of a mesh"):
            ds.gbuffer(cube(), camera, of_sphere, shading=shading)


def test_normals_of_another_precision_fit_in():
    normals = np.tile(np.float32([0, 0, 1]), (8, 1))
    mesh = ds.Mesh(CUBE, CUBE_FACES, normals)
    assert mesh.vertex_normals().z.dtype == mesh.vertices.dtype
