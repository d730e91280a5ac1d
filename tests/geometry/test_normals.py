"""Normals of polygons and of vertices: published values, hand-worked cases, the singular ones."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from mesh_cases import CUBE, CUBE_FACES, icosphere
from shared import shared_data

from diffshade.geometry.normals import (
    angle_weights,
    area_weights,
    face_normals,
    newell_normal,
    plane_normals,
    sphere_weights,
    uniform_weights,
    vertex_normals,
)
from diffshade.vector import Vec3

WEIGHTS = [uniform_weights, area_weights, angle_weights, sphere_weights]
means = jax.jit(vertex_normals, static_argnames="weights")


def corners(vertices, faces):
    return tuple(Vec3.from_array(jnp.asarray(vertices)[np.asarray(faces)[:, k]]) for k in range(3))


def published(function):
    entries = json.loads(shared_data("reference_values.json").read_text())
    found = [entry for entry in entries if entry["function"] == function]
    assert found
    return found


def test_published_face_normals():
    for entry in published("face_normals (flat shading)"):
        vertices = jnp.array(entry["inputs"]["vertices"], float)
        a, b, c = corners(vertices, [entry["inputs"]["face"]])
        tolerance = entry["tol"]
        np.testing.assert_allclose(
            plane_normals(a, b, c).to_array()[0], entry["expected"], **tolerance
        )
        np.testing.assert_allclose(newell_normal(vertices), entry["expected"], **tolerance)


@pytest.mark.parametrize("weights", [uniform_weights, area_weights])
def test_published_vertex_normals(weights):
    for entry in published("vertex_normals (Gouraud/Phong shading)"):
        vertices = jnp.array(entry["inputs"]["vertices"], float)
        faces = jnp.array(entry["inputs"]["faces"])
        normals = means(vertices, faces, weights=weights)
        np.testing.assert_allclose(normals.to_array(), entry["expected"], **entry["tol"])


def test_a_face_normal_is_twice_the_area_long(tolerance):
    a, b, c = corners([[1.0, 0, 2], [4, 0, 2], [1, 5, 2]], [[0, 1, 2]])
    np.testing.assert_allclose(face_normals(a, b, c).to_array(), [[0, 0, 15]], rtol=tolerance)


POLYGONS = {
    "square": ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [0, 0, 1]),
    # A concave corner first: the cross product of its own edges points the wrong way.
    "concave": ([[1, 0.2, 0], [0, 2, 0], [0, 0, 0], [2, 0, 0], [2, 2, 0]], [0, 0, 1]),
    "collinear corners": ([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, 2], [0, 0, 2]], [0, -1, 0]),
    "repeated corner": ([[0, 0, 0], [0, 0, 0], [0, 1, 0], [0, 0, 1]], [1, 0, 0]),
    # A saddle: its projections on the coordinate planes have areas 0, 0 and 1.
    "saddle": ([[0, 0, 0.3], [1, 0, -0.3], [1, 1, 0.3], [0, 1, -0.3]], [0, 0, 1]),
}


@pytest.mark.parametrize("name", POLYGONS)
def test_newell(name, tolerance):
    polygon, expected = POLYGONS[name]
    polygon = jnp.array(polygon, float)
    np.testing.assert_allclose(newell_normal(polygon), expected, atol=tolerance)
    np.testing.assert_allclose(newell_normal(polygon[::-1]), -np.array(expected), atol=tolerance)
    turned = jnp.roll(polygon, 2, axis=0)
    np.testing.assert_allclose(newell_normal(turned), expected, atol=tolerance)


def test_newell_of_a_non_planar_polygon_by_hand(tolerance):
    # Twice the areas of the projections on yz, zx and xy, by the shoelace formula.
    polygon = jnp.array([[0.0, 0, 0], [2, 0, 1], [2, 1, 0], [0, 1, 2]])
    areas = np.array([_shoelace(polygon, 1, 2), _shoelace(polygon, 2, 0), _shoelace(polygon, 0, 1)])
    np.testing.assert_allclose(
        newell_normal(polygon), areas / np.linalg.norm(areas), rtol=tolerance, atol=tolerance
    )


def _shoelace(polygon, i, j):
    u, w = np.asarray(polygon)[:, i], np.asarray(polygon)[:, j]
    return sum(u[k] * w[(k + 1) % len(u)] - u[(k + 1) % len(u)] * w[k] for k in range(len(u)))


def test_newell_far_from_the_origin():
    polygon = np.array(POLYGONS["concave"][0], float)
    far = polygon + np.array([4096.0, -8192.0, 2048.0])  # exact in float32 to 1e-3
    near = newell_normal(jnp.array(far - np.array([4096.0, -8192.0, 2048.0])))
    np.testing.assert_allclose(newell_normal(jnp.array(far)), near, atol=2e-3)
    np.testing.assert_allclose(newell_normal(jnp.array(far)), [0, 0, 1], atol=1e-9)


def test_a_polygon_without_area_has_no_normal():
    line = jnp.array([[0.0, 0, 0], [1, 1, 1], [2, 2, 2]])
    np.testing.assert_array_equal(newell_normal(line), [0, 0, 0])
    for derivative in (jax.jacrev, jax.jacfwd):
        np.testing.assert_array_equal(jax.jit(derivative(newell_normal))(line), np.zeros((3, 3, 3)))


# Two triangles in the planes z = 0 and x = 0 share the edge from the origin to (0, 1, 0). The first
# has area 1/2 and right angle at the origin; the second has area 1 and angle 45 degrees there.
WEDGE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 2**0.5, 2**0.5]])
WEDGE_FACES = np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize(
    ("weights", "ratio"),
    [
        (uniform_weights, 1.0),
        (area_weights, 2**0.5),
        (angle_weights, 0.5),
        (sphere_weights, 8**-0.5),
    ],
)
def test_the_mean_at_the_edge_of_a_wedge_by_hand(weights, ratio, tolerance):
    # At the origin the areas are 1/2 and sqrt(2)/2, the angles pi/2 and pi/4, and sin(angle) over
    # the edges' lengths 1 and sqrt(1/2)/2, so n = (0, 0, 1) + ratio (1, 0, 0).
    normals = means(jnp.array(WEDGE), jnp.array(WEDGE_FACES), weights=weights).to_array()
    expected = np.array([ratio, 0, 1]) / np.hypot(ratio, 1)
    np.testing.assert_allclose(normals[0], expected, rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(normals[1], [0, 0, 1], atol=tolerance)
    np.testing.assert_allclose(normals[3], [1, 0, 0], atol=tolerance)


def test_angle_weights_do_not_depend_on_the_triangulation(tolerance):
    normals = means(jnp.array(CUBE), jnp.array(CUBE_FACES), weights=angle_weights)
    np.testing.assert_allclose(normals.to_array(), CUBE / 3**0.5, atol=10 * tolerance)
    uniform = means(jnp.array(CUBE), jnp.array(CUBE_FACES)).to_array()
    assert np.abs(uniform - CUBE / 3**0.5).max() > 0.1


@pytest.mark.parametrize("weights", WEIGHTS[:3])
def test_a_sphere_of_triangles_has_the_normals_of_the_sphere(weights):
    errors = []
    for levels in (2, 3):
        vertices, faces = icosphere(levels)
        normals = means(jnp.array(vertices), jnp.array(faces), weights=weights)
        errors.append(np.abs(np.asarray(normals.to_array()) - vertices).max())
    assert errors[1] < 0.7 * errors[0] < 0.02


def test_sphere_weights_are_exact_on_a_sphere(rng, tolerance):
    vertices, faces = icosphere(1)
    crooked = vertices + 0.05 * rng.normal(size=vertices.shape)
    crooked /= np.linalg.norm(crooked, axis=1, keepdims=True)
    normals = means(jnp.array(3 * crooked + 1), jnp.array(faces), weights=sphere_weights)
    np.testing.assert_allclose(normals.to_array(), crooked, atol=1e3 * tolerance)


@pytest.mark.parametrize("weights", WEIGHTS)
def test_scale_and_place_do_not_matter(weights):
    vertices, faces = icosphere(1)
    expected = means(jnp.array(vertices), jnp.array(faces), weights=weights).to_array()
    for scale in (1e-12, 1e-6, 1e6, 1e12):  # areas of 1e-24 to 1e24, squared in a length
        scaled = means(jnp.array(vertices * scale), jnp.array(faces), weights=weights)
        np.testing.assert_allclose(scaled.to_array(), expected, atol=1e-5)
        flat = plane_normals(*corners(vertices * scale, faces)).to_array()
        np.testing.assert_allclose(np.linalg.norm(flat, axis=1), 1, rtol=1e-5)
    moved = means(jnp.array(vertices + 100), jnp.array(faces), weights=weights)
    np.testing.assert_allclose(moved.to_array(), expected, atol=1e-3)


def singular():
    """Vertices 0 to 2: a face and its mirror image, which cancel. 3: in no face. 4: of a point."""
    vertices = jnp.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5], [2, 2, 2], [3, 3, 3]])
    faces = jnp.array([[0, 1, 2], [0, 2, 1], [4, 4, 4], [4, 5, 5], [0, 4, 5]])
    return vertices, faces


def test_where_there_is_no_normal_it_is_zero_and_derivatives_are_finite():
    vertices, faces = singular()

    def normals(v):
        return jnp.stack([vertex_normals(v, faces, weights=w).to_array() for w in WEIGHTS])

    @jax.jit
    def derivatives(v):
        value, tangent = jax.jvp(normals, (v,), (v[:, ::-1],))
        cotangent = jax.vjp(normals, v)[1](jnp.ones_like(value))
        return value, tangent, cotangent

    value, tangent, cotangent = derivatives(vertices)
    np.testing.assert_array_equal(value, np.zeros((4, 6, 3)))
    assert np.isfinite(tangent).all()
    assert np.isfinite(cotangent).all()


@pytest.mark.parametrize("weights", WEIGHTS)
def test_normals_that_cancel_up_to_rounding_are_zero(weights):
    # Three fins about the z axis, a third of a turn apart: their normals sum to a few 1e-17.
    angles = 0.1 + np.arange(3) * 2 * np.pi / 3
    fins = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
    vertices = jnp.array(np.concatenate([[[0, 0, -0.7], [0, 0, 0.7]], fins]))
    faces = jnp.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    normals = means(vertices, faces, weights=weights).to_array()
    np.testing.assert_array_equal(normals[:2], np.zeros((2, 3)))
    np.testing.assert_allclose(np.linalg.norm(normals[2:], axis=1), 1, rtol=1e-6)


@pytest.mark.parametrize("weights", WEIGHTS)
def test_degenerate_faces_do_not_count(weights):
    vertices, faces = icosphere(0)
    expected = means(jnp.array(vertices), jnp.array(faces), weights=weights).to_array()
    more = np.concatenate([faces, [[0, 0, 1], [2, 2, 2], [3, 4, 3]]])
    with_more = means(jnp.array(vertices), jnp.array(more), weights=weights).to_array()
    np.testing.assert_array_equal(with_more, expected)


@pytest.mark.slow
def test_newell_of_a_polygon_without_area():
    """Collinear corners: zero, not what rounding leaves, at one."""
    line = jnp.outer(jnp.array([0.0, 0.3, 0.7, 1.1]), jnp.array([0.3, -0.7, 0.9]))
    assert not np.any(newell_normal(line))
    assert np.isfinite(jax.jacrev(newell_normal)(line)).all()


@pytest.mark.float64
def test_derivatives_by_finite_differences():
    faces = jnp.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]])
    vertices = jnp.array([[0.1, 0.2, 1], [1, 0, 0.1], [-0.5, 0.9, 0], [-0.6, -0.8, -0.1]])

    @jax.jit
    def all_normals(v):
        mean = [vertex_normals(v, faces, weights=weights).to_array() for weights in WEIGHTS[2:]]
        flat = plane_normals(*(Vec3.from_array(v[faces[:, k]]) for k in range(3))).to_array()
        return jnp.concatenate([*mean, flat, newell_normal(v)[None]])

    check_grads(all_normals, (vertices,), order=1, atol=1e-6, rtol=1e-6)
    _, moved = jax.jvp(all_normals, (vertices,), (vertices[:, ::-1],))
    assert (jnp.abs(moved).max(axis=1) > 1e-4).all()


@pytest.mark.parametrize("size", [1e-15, 1e-7, 1.0, 1e15])
def test_the_normal_of_a_polygon_of_any_size(size: float) -> None:
    square = jnp.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * size
    np.testing.assert_allclose(newell_normal(square), [0, 0, 1], atol=1e-6)
