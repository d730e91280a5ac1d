"""Visibility of meshes, against every ray tried with every triangle."""

import gc
import sys
import weakref

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
    camera = ds.OrthographicCamera(37, 29, 2.5)
    whole = ds.visibility(ds.Mesh(*icosphere(2)), camera)
    monkeypatch.setattr(raycast, "BLOCK", 100)
    parts = ds.visibility(ds.Mesh(*icosphere(2)), camera)
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


class Counted:
    """Calls of what it stands for."""

    def __init__(self, function):
        self.function, self.calls = function, 0

    def __call__(self, *arguments):
        self.calls += 1
        return self.function(*arguments)


@pytest.fixture
def count(monkeypatch):
    """A way to count the calls of one of the ray caster's functions."""

    def watch(name):
        counted = Counted(getattr(raycast, name))
        monkeypatch.setattr(raycast, name, counted)
        return counted

    return watch


def test_unchanged_geometry_is_not_cast_at_again(count):
    built, cast = count("_embree"), count("_cast")
    vertices, faces = icosphere(2)
    mesh = ds.Mesh(vertices, faces)
    first = ds.visibility(mesh, ds.OrthographicCamera(31, 23, 2.5))
    again = ds.visibility(mesh, ds.OrthographicCamera(31, 23, 2.5))
    assert again is first
    # Another mesh of the same arrays is the same geometry, whatever else it has.
    ds.gbuffer(ds.Mesh(mesh.vertices, mesh.faces, slot=np.arange(320)), CAMERAS["orthographic"])
    assert (built.calls, cast.calls) == (1, 2)
    ds.visibility(ds.Mesh(vertices, faces), ds.OrthographicCamera(31, 23, 2.5))
    assert (built.calls, cast.calls) == (2, 3)


def test_another_camera_sees_something_else(count):
    built, cast = count("_embree"), count("_cast")
    mesh = ds.Mesh(*icosphere(2))
    views = [
        ds.OrthographicCamera(31, 23, 2.5),
        ds.OrthographicCamera(23, 31, 2.5),
        ds.OrthographicCamera(31, 23, 2.6),
        ds.OrthographicCamera(31, 23, 2.5, position=(0, 0, 3)),
        ds.PerspectiveCamera(31, 23, 2.5, position=(0, 0, 3)),
    ]
    seen = [ds.visibility(mesh, view) for view in views]
    assert (built.calls, cast.calls) == (1, len(views))
    assert [s.shape for s in seen[:2]] == [(23, 31), (31, 23)]
    assert seen[2].index.size < seen[0].index.size
    # The last few are remembered, and no more.
    assert len(views) == raycast.VIEWS + 1
    for view in views[1:]:
        ds.visibility(mesh, view)
    assert cast.calls == len(views)
    ds.visibility(mesh, views[0])
    assert cast.calls == len(views) + 1


def test_what_is_remembered_goes_with_the_mesh():
    mesh = ds.Mesh(*icosphere(2))
    ds.gbuffer(mesh, CAMERAS["orthographic"])
    arrays = [weakref.ref(array) for array in (mesh.vertices, mesh.faces)]
    views = weakref.ref(ds.visibility(mesh, CAMERAS["orthographic"]).index)
    del mesh
    gc.collect()
    assert [array() for array in arrays] == [None, None]
    assert views() is None


def test_the_owner_of_an_array_may_write_to_it():
    faces = CUBE_FACES.astype(np.int32)
    mesh = ds.Mesh(CUBE, faces)
    faces[:] = 0
    np.testing.assert_array_equal(mesh.faces, CUBE_FACES)


def test_points_are_those_of_double_precision(precise_case):
    """Whatever JAX's own precision: the error is that of the rounded result alone."""
    mesh, camera = precise_case
    seen = ds.visibility(mesh, camera)
    _, face, weights, _ = brute_force(mesh, camera)
    same = np.asarray(seen.face) == face
    assert same.mean() > 0.9
    eps = np.finfo(mesh.vertices.dtype).eps
    np.testing.assert_allclose(weights_of(seen)[same], weights[same], atol=max(2 * eps, 1e-13))


@pytest.fixture
def precise_case():
    # Rays and vertices that single precision holds exactly, so that the reference has no error.
    vertices = np.round(64 * np.concatenate([CUBE, [[0.3, 0.2, 1.7]]])) / 64
    mesh = ds.Mesh(vertices, np.concatenate([CUBE_FACES, [[0, 4, 8], [1, 5, 8], [3, 7, 8]]]))
    return mesh, ds.OrthographicCamera(64, 64, 4.0)
