"""Visibility of meshes, against every ray tried with every triangle."""

import sys

import jax.numpy as jnp
import numpy as np
import pytest
from mesh_cases import CUBE, CUBE_FACES, brute_force, cube, icosphere

import diffshade as ds
from diffshade.geometry import raycast


def soup(rng, triangles=60):
    """Triangles that share nothing and pass through each other."""
    centres = rng.normal(size=(triangles, 1, 3))
    vertices = (centres + 0.6 * rng.normal(size=(triangles, 3, 3))).reshape(-1, 3)
    return ds.Mesh(vertices, np.arange(3 * triangles).reshape(-1, 3))


CAMERAS = {
    "orthographic": ds.OrthographicCamera(31, 23, 4.0),
    "placed": ds.OrthographicCamera(31, 23, 4.0, position=(0.3, 0.1, 0.2), target=(0, 0, -1)),
    "perspective": ds.PerspectiveCamera(31, 23, 0.9, position=(1, 2, 4), target=(0.2, 0.1, 0)),
    "in the middle": ds.PerspectiveCamera(31, 23, 1.5, position=(0.1, 0.2, 0.3), target=(1, 0, 0)),
}


def weights_of(seen):
    return np.asarray(seen.barycentric.to_array())


@pytest.mark.parametrize("view", CAMERAS)
@pytest.mark.parametrize("shape", ["icosphere", "soup"])
def test_against_every_triangle(shape, view, rng):
    camera = CAMERAS[view]
    mesh = soup(rng) if shape == "soup" else ds.Mesh(*icosphere(1))
    seen = ds.visibility(mesh, camera)
    pixel, face, weights, _ = brute_force(mesh, camera)
    assert pixel.size > 80
    np.testing.assert_array_equal(seen.index, pixel)
    # Where a ray meets an edge exactly, either side is right.
    same = np.asarray(seen.face) == face
    assert same.mean() > 0.9
    assert (np.sort(weights[~same], axis=1)[:, 0] < 1e-6).all()
    np.testing.assert_allclose(weights_of(seen)[same], weights[same], atol=2e-5)
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)[face]]
    position = np.asarray(ds.gbuffer(mesh, camera, seen).position.to_array())
    np.testing.assert_allclose(position, (corners * weights[..., None]).sum(axis=1), atol=1e-5)


@pytest.mark.float64
@pytest.mark.parametrize("view", CAMERAS)
def test_points_lie_on_the_pixels_rays_to_double_precision(view):
    camera, mesh = CAMERAS[view], ds.Mesh(*icosphere(2))
    seen = ds.visibility(mesh, camera)
    position = np.asarray(ds.gbuffer(mesh, camera, seen).position.to_array())
    origin, direction = (np.asarray(v.to_array()) for v in camera.rays(seen.index))
    off_ray = np.linalg.norm(np.cross(position - origin, direction), axis=1)
    # Where a ray passes an edge, single precision may choose the neighbour: there the point is put
    # on the edge, which is as near as that.
    assert np.quantile(off_ray, 0.95) < 1e-14
    assert off_ray.max() < 1e-6


def test_weights_are_a_partition_of_one(tolerance):
    mesh = ds.Mesh(*icosphere(3))
    weights = weights_of(ds.visibility(mesh, ds.OrthographicCamera(64, 64, 2.2)))
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=10 * tolerance)
    assert weights.dtype == mesh.vertices.dtype


def test_no_ray_slips_through_an_edge():
    # Every pixel of the diagonal looks exactly along the edge that two triangles share.
    seen = ds.visibility(cube(), ds.OrthographicCamera(50, 50, 2.0))
    assert seen.index.size == 2500
    vertices, faces = icosphere(2)
    camera = ds.OrthographicCamera(64, 64, 0.6)  # a window inside the outline: all foreground
    assert ds.visibility(ds.Mesh(vertices, faces), camera).index.size == 64 * 64
    assert ds.gbuffer(ds.Mesh(vertices, faces), camera).index is None


def test_a_mesh_fills_the_outline_of_its_sphere():
    vertices, faces = icosphere(4)
    camera = ds.OrthographicCamera(200, 200, 2.2)
    of_mesh = set(np.asarray(ds.visibility(ds.Mesh(vertices, faces), camera).index).tolist())
    of_sphere = set(np.asarray(ds.visibility(ds.Sphere(), camera).index).tolist())
    assert of_mesh <= of_sphere
    assert len(of_sphere - of_mesh) < 0.01 * len(of_sphere)


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1e3, 1e9])
def test_size_does_not_matter(scale):
    vertices, faces = icosphere(3)
    expected = ds.visibility(ds.Mesh(vertices, faces), ds.OrthographicCamera(48, 48, 2.2))
    mesh = ds.Mesh(vertices * scale, faces)
    seen = ds.visibility(mesh, ds.OrthographicCamera(48, 48, 2.2 * scale))
    np.testing.assert_array_equal(seen.index, expected.index)
    np.testing.assert_allclose(weights_of(seen), weights_of(expected), atol=1e-4)


@pytest.mark.float64
@pytest.mark.parametrize("distance", [1e3, 1e6])
def test_distance_does_not_matter(distance):
    vertices, faces = icosphere(3)
    expected = ds.visibility(ds.Mesh(vertices, faces), ds.OrthographicCamera(48, 48, 2.2))
    # The mesh far from the origin, the camera as far again from the mesh.
    far = np.array([distance, -2 * distance, 0.5 * distance])
    camera = ds.OrthographicCamera(
        48, 48, 2.2, position=far + np.array([0, 0, distance]), target=far
    )
    seen = ds.visibility(ds.Mesh(vertices + far, faces), camera)
    np.testing.assert_array_equal(seen.index, expected.index)
    np.testing.assert_array_equal(seen.face, expected.face)
    np.testing.assert_allclose(weights_of(seen), weights_of(expected), atol=1e-6)


def test_a_camera_with_a_position_sees_only_what_lies_before_it():
    layers = np.concatenate(
        [CUBE * np.array([1, 1, 0.1]) + np.array([0, 0, z]) for z in (0, 5, 10)]
    )
    faces = np.concatenate([CUBE_FACES + 8 * k for k in range(3)])
    mesh = ds.Mesh(layers, faces)

    def layer(camera):
        return set((np.asarray(ds.visibility(mesh, camera).face) // 12).tolist())

    assert layer(ds.OrthographicCamera(4, 4, 1.0)) == {2}
    assert layer(ds.OrthographicCamera(4, 4, 1.0, position=(0, 0, 7))) == {1}
    assert layer(ds.PerspectiveCamera(4, 4, 0.2, position=(0, 0, 3))) == {0}
    assert layer(ds.PerspectiveCamera(4, 4, 0.2, position=(0, 0, 3), target=(0, 0, 9))) == {1}
    assert layer(ds.OrthographicCamera(4, 4, 1.0, position=(0, 0, -2), target=(0, 0, -9))) == set()


def test_both_sides_are_seen():
    inside_out = ds.Mesh(CUBE, CUBE_FACES[:, ::-1])
    assert ds.visibility(inside_out, ds.OrthographicCamera(8, 8, 2.0)).index.size == 64


def test_blocks_join_without_a_seam(monkeypatch):
    mesh, camera = ds.Mesh(*icosphere(2)), ds.OrthographicCamera(37, 29, 2.5)
    whole = ds.visibility(mesh, camera)
    monkeypatch.setattr(raycast, "BLOCK", 100)
    parts = ds.visibility(mesh, camera)
    np.testing.assert_array_equal(parts.index, whole.index)
    np.testing.assert_array_equal(parts.face, whole.face)
    np.testing.assert_array_equal(weights_of(parts), weights_of(whole))


def test_degenerate_triangles_are_left_out():
    vertices, faces = icosphere(1)
    more = np.concatenate([[[0, 0, 1], [2, 2, 2]], faces, [[3, 4, 3]]])
    camera = ds.OrthographicCamera(24, 24, 2.2)
    plain, mixed = (ds.visibility(ds.Mesh(vertices, f), camera) for f in (faces, more))
    np.testing.assert_array_equal(mixed.index, plain.index)
    np.testing.assert_array_equal(mixed.face, np.asarray(plain.face) + 2)


def test_nothing_in_view_is_no_pixels():
    seen = ds.visibility(
        ds.Mesh(CUBE + np.array([50, 0, 0]), CUBE_FACES), ds.OrthographicCamera(6, 4, 2.0)
    )
    assert seen.shape == (4, 6)
    assert seen.index.shape == seen.face.shape == seen.barycentric.x.shape == (0,)
    assert ds.gbuffer(cube(), ds.OrthographicCamera(6, 4, 2.0), seen).pixel_count == 0


def test_vertices_of_no_face_may_be_anything():
    vertices = jnp.array(np.concatenate([CUBE, [[np.nan, np.inf, 0]]]))
    g = ds.gbuffer(ds.Mesh(vertices, CUBE_FACES), ds.OrthographicCamera(4, 4, 1.0))
    np.testing.assert_array_equal(g.position.z, np.ones(16))
    assert np.isfinite(g.normal.to_array()).all()


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (ds.Mesh(np.zeros((3, 3)), np.zeros((0, 3), int)), "3 vertices and no faces"),
        (ds.Mesh(np.zeros((3, 3)), [[0, 1, 2]]), "none of the mesh's 1 triangles has an area"),
        (
            ds.Mesh(jnp.array([[0.0, 0, 0], [1, 0, 0], [0, 1, jnp.nan]]), [[0, 1, 2]]),
            "1 vertices of the mesh are not finite, the first of them number 2",
        ),
    ],
)
def test_a_mesh_that_cannot_be_seen_is_refused(mesh, message):
    with pytest.raises(ds.BadInput, match=message) as refusal:
        ds.visibility(mesh, ds.OrthographicCamera(4, 4, 2.0))
    assert "\n" not in str(refusal.value)


def test_without_embree_a_mesh_is_refused_and_a_sphere_is_not(monkeypatch):
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    camera = ds.OrthographicCamera(4, 4, 1.0)
    with pytest.raises(ds.BadInput, match="pip install embreex"):
        ds.visibility(cube(), camera)
    assert ds.visibility(ds.Sphere(), camera).index.size == 16
