"""Flat, Gouraud and Phong shading: where a mesh is shaded, and how that reaches the pixels."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mesh_cases import cube, icosphere

import diffshade as ds
from diffshade.geometry.normals import area_weights, sphere_weights

SCENE = ds.Scene(ambient=0.1, lights=ds.ParallelLight((0.3, 0.4, 1.0), intensity=0.8))
MATTE = ds.Material(ka=0.5, kd=0.6)


def gouraud_by_scan_lines(vertices, intensities, x, y):
    """I_p of text B: down the two edges from the scan line, then across it.

    I_4 = (y_4 - y_2)/(y_1 - y_2) I_1 + (y_1 - y_4)/(y_1 - y_2) I_2 and I_5 likewise on the edge
    from 2 to 3, where 2 is the vertex that both edges of the scan line at y = y_4 = y_5 share.
    """
    order = np.argsort(vertices[:, 1])
    low, middle, high = order
    shared = low if y < vertices[middle, 1] else high
    one, three = (k for k in order if k != shared)
    ends = []
    for k in (one, three):
        xk, yk = vertices[k, :2]
        x2, y2 = vertices[shared, :2]
        part = (y - y2) / (yk - y2)
        ends.append(
            (x2 + part * (xk - x2), part * intensities[k] + (1 - part) * intensities[shared])
        )
    (x4, i4), (x5, i5) = ends
    return (x5 - x) / (x5 - x4) * i4 + (x - x4) / (x5 - x4) * i5


def test_gouraud_equals_the_scan_line_formula(tolerance):
    vertices = np.array([[-0.9, -0.7, 0.2], [0.8, -0.3, -0.4], [-0.1, 0.95, 0.6]])
    normals = np.array([[0.1, 0.3, 1.0], [-0.6, 0.1, 0.8], [0.2, -0.7, 0.5]])
    mesh = ds.Mesh(vertices, [[0, 1, 2]], normals)
    camera = ds.OrthographicCamera(21, 21, 2.0)
    seen = ds.visibility(mesh, camera)
    g = ds.gbuffer(mesh, camera, seen, shading=ds.GouraudShading())
    image = np.asarray(ds.render(g, SCENE, MATTE))[..., 0].ravel()[np.asarray(seen.index)]

    light = np.array([0.3, 0.4, 1.0]) / np.linalg.norm([0.3, 0.4, 1.0])
    n = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    intensities = 0.1 * 0.5 + 0.8 * 0.6 * n @ light
    row, column = np.divmod(np.asarray(seen.index), 21)
    x, y = (column + 0.5) * 2 / 21 - 1, 1 - (row + 0.5) * 2 / 21
    expected = [gouraud_by_scan_lines(vertices, intensities, *at) for at in zip(x, y, strict=True)]
    assert image.size > 100
    np.testing.assert_allclose(image, expected, atol=20 * tolerance)


def test_flat_shading_is_one_intensity_a_face_of_its_plane(tolerance):
    mesh = ds.Mesh(*icosphere(1))
    camera = ds.OrthographicCamera(40, 40, 2.2)
    seen = ds.visibility(mesh, camera)
    g = ds.gbuffer(mesh, camera, seen, shading=ds.FlatShading())
    image = np.asarray(ds.render(g, SCENE, MATTE))[..., 0].ravel()[np.asarray(seen.index)]
    light = np.array([0.3, 0.4, 1.0]) / np.linalg.norm([0.3, 0.4, 1.0])
    a, b, c = np.moveaxis(np.asarray(mesh.vertices)[np.asarray(mesh.faces)], 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    of_face = 0.05 + 0.48 * np.maximum(normal @ light, 0)
    np.testing.assert_allclose(image, of_face[np.asarray(seen.face)], atol=20 * tolerance)


def test_flat_shading_uses_centroids(tolerance):
    g = ds.gbuffer(cube(), ds.OrthographicCamera(4, 4, 1.0), shading=ds.FlatShading())
    vertices = np.asarray(cube().vertices)[np.asarray(cube().faces)]
    np.testing.assert_allclose(g.position.to_array(), vertices.mean(axis=1), atol=tolerance)


@pytest.mark.parametrize("shading", [ds.FlatShading(), ds.GouraudShading(), ds.PhongShading()])
def test_all_agree_on_a_plane_under_a_far_light(shading, tolerance):
    mesh = ds.Mesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    g = ds.gbuffer(mesh, ds.OrthographicCamera(6, 6, 1.0), shading=shading)
    shiny = ds.Material(kd=0.5, specular=ds.Phong(ks=0.4, shininess=10))
    expected = ds.render(
        ds.GBuffer.from_arrays(None, np.tile([0.0, 0, 1], (6, 6, 1))), SCENE, shiny
    )
    np.testing.assert_allclose(ds.render(g, SCENE, shiny), expected, atol=20 * tolerance)


@pytest.mark.slow
def test_phong_shading_approaches_the_sphere_and_gouraud_loses_its_highlight():
    camera = ds.OrthographicCamera(48, 48, 1.2)
    shiny = ds.Material(kd=0.3, specular=ds.Phong(ks=0.7, shininess=60))
    exact = np.asarray(ds.render(ds.gbuffer(ds.Sphere(), camera), SCENE, shiny))

    def error(levels, shading, weights):
        mesh = ds.Mesh(*icosphere(levels), weights=weights)
        image = ds.render(ds.gbuffer(mesh, camera, shading=shading), SCENE, shiny)
        return np.sqrt(np.mean((np.asarray(image) - exact) ** 2))

    second_order = [error(levels, ds.PhongShading(), sphere_weights) for levels in (1, 2, 3)]
    assert second_order[0] > 3.5 * second_order[1] > 3.5**2 * second_order[2]
    # Where six unequal faces meet, the other means are off by a part of the edge's length.
    assert error(3, ds.PhongShading(), area_weights) > 5 * second_order[2]
    assert error(2, ds.GouraudShading(), sphere_weights) > 10 * second_order[1]


def test_interpolated_normals_have_unit_length(tolerance):
    g = ds.gbuffer(ds.Mesh(*icosphere(0)), ds.OrthographicCamera(20, 20, 2.0))
    np.testing.assert_allclose(np.linalg.norm(g.normal.to_array(), axis=1), 1, atol=10 * tolerance)


def test_interpolated_normals_that_cancel_are_zero_and_derivatives_are_finite():
    mesh = ds.Mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]])
    camera = ds.OrthographicCamera(1, 1, 0.1)  # looks at the origin: weights 1/4, 1/4, 1/2
    seen = ds.visibility(mesh, camera)

    def normal(normals):
        bent = ds.Mesh(mesh.vertices, mesh.faces, normals)
        return ds.gbuffer(bent, camera, seen).normal.to_array()

    opposite = jnp.array([[0.0, 0, 1], [0, 0, 1], [0, 0, -1]])
    np.testing.assert_array_equal(normal(opposite), [[0, 0, 0]])
    for derivative in (jax.jacrev, jax.jacfwd):
        assert np.isfinite(jax.jit(derivative(normal))(opposite)).all()


def two_slots():
    """A square of two materials: slot 0 below the diagonal from bottom left to top right."""
    vertices = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    return ds.Mesh(vertices, [[0, 1, 2], [0, 2, 3]], slot=[0, 1])


@pytest.mark.parametrize("shading", [ds.FlatShading(), ds.PhongShading()])
def test_slots_have_their_own_coefficients(shading, tolerance):
    g = ds.gbuffer(two_slots(), ds.OrthographicCamera(3, 3, 2.0), shading=shading)
    both = [
        ds.Material(kd=0.25, specular=ds.Phong(ks=0.5, shininess=2)),
        ds.Material(kd=(0.5, 0.75, 1.0), specular=ds.Phong(ks=0.25, shininess=3)),
    ]
    head_on = ds.Scene(lights=ds.ParallelLight((0, 0, 1)))
    image = ds.render(g, head_on, both)
    np.testing.assert_allclose(image[2, 1], [0.75, 0.75, 0.75], atol=10 * tolerance)
    np.testing.assert_allclose(image[0, 1], [0.75, 1.0, 1.25], atol=10 * tolerance)


def test_gouraud_shading_of_slots_is_refused():
    with pytest.raises(ds.BadInput, match=r"Gouraud .* use PhongShading\(\) or FlatShading\(\)"):
        ds.gbuffer(two_slots(), ds.OrthographicCamera(3, 3, 2.0), shading=ds.GouraudShading())


@pytest.mark.parametrize("shading", [ds.FlatShading(), ds.GouraudShading()])
def test_a_sphere_has_no_faces(shading):
    with pytest.raises(ds.BadInput, match=r"Shading of a Sphere, which has no faces"):
        ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(3, 3, 2.0), shading=shading)


def test_shading_frequency_follows_the_mesh_it_is_given():
    g = ds.gbuffer(cube(), ds.OrthographicCamera(3, 3, 1.0), shading=ds.GouraudShading())
    assert g.normal.x.shape == (8,)
    assert g.pixel_count == 9
    np.testing.assert_allclose(g.spread(jnp.ones(8)), np.ones(9), rtol=1e-6)
