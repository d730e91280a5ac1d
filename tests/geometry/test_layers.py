"""Layers: everything that a pixel's ray meets, in order, against each ray tried with each surface."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from every_hit import every_hit
from mesh_cases import CUBE, CUBE_FACES, cube, icosphere

import diffshade as ds
from diffshade.geometry import crossings, raycast

FLAT = ds.OrthographicCamera(31, 23, 4.0)
CAMERAS = {
    "orthographic": FLAT,
    "placed": ds.OrthographicCamera(31, 23, 4.0, position=(0.3, 0.1, 0.2), target=(0, 0, -1)),
    "perspective": ds.PerspectiveCamera(31, 23, 0.9, position=(1, 2, 4), target=(0.2, 0.1, 0)),
    "in the middle": ds.PerspectiveCamera(31, 23, 1.5, position=(0.1, 0.2, 0.3), target=(1, 0, 0)),
}


def soup(triangles=40):
    """Triangles that share nothing and pass through each other; shaded with their planes' normals."""
    rng = np.random.default_rng(5)
    centres = rng.normal(size=(triangles, 1, 3))
    vertices = (centres + 0.6 * rng.normal(size=(triangles, 3, 3))).reshape(-1, 3)
    return ds.Mesh(vertices, np.arange(3 * triangles).reshape(-1, 3))


def sheets(*heights, tilt=0.0):
    """Squares one above the other, as one mesh, turned about the y axis."""
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    vertices = np.concatenate([square + np.array([0, 0, z]) for z in heights])
    c, s = np.cos(tilt), np.sin(tilt)
    vertices = vertices @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(len(heights))])
    return ds.Mesh(vertices, faces)


def sizes(peeled):
    return [[seen.index.size for seen in layer] for layer in peeled]


@pytest.mark.float64
@pytest.mark.parametrize("view", CAMERAS)
def test_against_every_hit(view):
    """Triangles and two spheres that all pass through each other."""
    camera = CAMERAS[view]
    objects = [soup(), ds.Sphere((0.2, 0.1, 0), 0.8), ds.Sphere((-0.4, 0.3, 0.2), 0.7)]
    hits = every_hit(objects, camera)
    peeled = ds.peel(objects, camera)
    found = ds.layers(objects, camera, visibility=peeled)
    assert len(found) >= 5
    assert sum(map(sum, sizes(peeled))) == hits.pixel.size
    for k, layer in enumerate(found):
        for owner, g in enumerate(layer):
            expected = hits.layer(k, owner)
            seen = peeled[k][owner]
            np.testing.assert_array_equal(seen.index, expected.pixel)
            np.testing.assert_array_equal(seen.inside, expected.inside)
            if owner == 0:
                np.testing.assert_array_equal(seen.face, expected.face)
            np.testing.assert_allclose(g.position.to_array(), expected.position, atol=1e-12)
            np.testing.assert_allclose(g.normal.to_array(), expected.normal, atol=1e-12)


@pytest.mark.parametrize("view", CAMERAS)
def test_the_first_layer_is_what_is_seen(view):
    camera, mesh = CAMERAS[view], ds.Mesh(*icosphere(1))
    ((layer,),) = ds.peel(mesh, camera, 1)
    seen = ds.visibility(mesh, camera)
    np.testing.assert_array_equal(layer.index, seen.index)
    np.testing.assert_array_equal(layer.face, seen.face)


def test_a_count_is_the_first_of_all(rng):
    objects, camera = [soup(), ds.Sphere((0.2, 0.1, 0), 0.8)], CAMERAS["perspective"]
    everything = ds.peel(objects, camera)
    for count in (1, 2, 4):
        for some, all_ in zip(ds.peel(objects, camera, count), everything, strict=False):
            for one, other in zip(some, all_, strict=True):
                np.testing.assert_array_equal(one.index, other.index)
    assert len(ds.peel(objects, camera, 4)) == 4
    assert len(ds.peel(objects, camera, 1000)) == len(everything)


@pytest.mark.parametrize("tilt", [0.0, 0.3, 1.2, 1.5])
@pytest.mark.parametrize("gap", [1e-4, 1e-5])
def test_thin_layers_are_not_lost(gap, tilt):
    """Two sheets, nearly edge-on at 1.5 radians; in one mesh, and as two objects."""
    camera = ds.OrthographicCamera(15, 9, 0.1)
    both = ds.peel(sheets(gap, 0, tilt=tilt), camera)
    assert sizes(both) == [[135], [135]]
    assert (np.asarray(both[0][0].face) < 2).all()
    apart = [sheets(z, tilt=tilt) for z in (0, gap)]
    assert sizes(ds.peel(apart, camera)) == [[0, 135], [135, 0]]


@pytest.mark.float64
def test_where_it_lies_does_not_matter():
    far = np.array([1e5, -2e5, 3e5])
    mesh = sheets(1e-4, 0)
    moved = ds.Mesh(np.asarray(mesh.vertices) + far, mesh.faces)
    camera = ds.PerspectiveCamera(9, 9, 0.01, position=far + np.array([0, 0, 100]), target=far)
    assert sizes(ds.peel(moved, camera)) == [[81], [81]]


def test_no_edge_counts_twice():
    """Pixels on the diagonal look along the edge that two triangles share."""
    assert sizes(ds.peel(cube(), ds.OrthographicCamera(50, 50, 1.9))) == [[2500], [2500]]
    camera = ds.PerspectiveCamera(50, 50, 0.1, position=(0, 0, 5))
    assert sizes(ds.peel(cube(), camera)) == [[2500], [2500]]
    assert (
        sizes(ds.peel(ds.Mesh(*icosphere(3)), ds.OrthographicCamera(64, 64, 1.0))) == [[4096]] * 2
    )


def test_coincident_triangles_of_a_mesh_are_one_surface():
    vertices = np.concatenate([CUBE, CUBE])
    twice = ds.Mesh(vertices, np.concatenate([CUBE_FACES, CUBE_FACES[:, ::-1] + 8]))
    assert sizes(ds.peel(twice, ds.OrthographicCamera(8, 8, 1.9))) == [[64], [64]]


def test_of_coincident_objects_the_first_is_in_front():
    """Triangulated differently, so that distances differ by rounding."""
    camera = ds.PerspectiveCamera(24, 24, 0.3, position=(0.3, 0.7, 5), target=(0.1, 0, 0))
    a, b = sheets(0, tilt=0.7), sheets(0, tilt=0.7)
    b = ds.Mesh(b.vertices, [[0, 1, 3], [1, 2, 3]])
    for pair in ([a, b], [b, a]):
        near, far = ds.peel(pair, camera)
        assert sizes([near, far]) == [[near[0].index.size, 0], [0, near[0].index.size]]
        assert near[0].index.size > 300


def test_a_surface_from_inside_faces_the_viewer():
    camera = CAMERAS["perspective"]
    for surface in (ds.Sphere(), ds.Mesh(*icosphere(3))):
        near, far = (layer[0] for layer in ds.layers(surface, camera))
        for g in (near, far):
            view = g.viewer.direction(g.position)
            towards = np.sum(np.asarray(g.normal.to_array()) * np.asarray(view.to_array()), axis=1)
            assert (towards > -0.1).all()  # interpolated normals may turn away at the outline
            assert np.mean(towards > 0) > 0.98
        outward = np.asarray(far.normal.to_array()) * np.asarray(far.position.to_array())
        assert (outward.sum(axis=1) < -0.9).all()


def test_a_camera_inside_a_sphere_sees_its_far_side():
    camera = ds.PerspectiveCamera(8, 8, 1.0, position=(0, 0, 0.5), target=(0, 0, -1))
    (layer,) = ds.peel(ds.Sphere(), camera)
    assert layer[0].index.size == 64
    assert np.asarray(layer[0].inside).all()
    assert ds.visibility(ds.Sphere(), camera).index.size == 0


def test_nothing_behind_and_nothing_at_all():
    assert sizes(ds.peel(sheets(0.0), FLAT)) == [
        [np.count_nonzero(ds.gbuffer(sheets(0.0), FLAT).mask)]
    ]
    away = ds.Mesh(CUBE + np.array([50, 0, 0]), CUBE_FACES)
    assert sizes(ds.peel([away, ds.Sphere((0, 50, 0))], FLAT)) == [[0, 0]]


def test_blocks_join(monkeypatch):
    mesh = soup()
    whole = ds.peel(mesh, FLAT)
    monkeypatch.setattr(raycast, "BLOCK", 100)
    parts = ds.peel(ds.Mesh(np.asarray(mesh.vertices), mesh.faces), FLAT)
    assert sizes(parts) == sizes(whole)
    for one, other in zip(parts, whole, strict=True):
        np.testing.assert_array_equal(one[0].index, other[0].index)
        np.testing.assert_array_equal(one[0].face, other[0].face)


def test_a_triangle_met_again_does_not_count_again(monkeypatch):
    """A ray that starts where it crossed meets the same triangle: it goes on."""
    monkeypatch.setattr(crossings, "APART", 1e-12)
    assert (
        sizes(ds.peel(sheets(1e-4, 0, tilt=1.2), ds.OrthographicCamera(15, 9, 0.1))) == [[135]] * 2
    )


def test_slots_and_faces_follow():
    mesh = cube()
    slotted = ds.Mesh(mesh.vertices, mesh.faces, slot=np.arange(12))
    for layer in ds.layers(slotted, FLAT):
        assert layer[0].slot.shape == layer[0].normal.x.shape
    flat = ds.gbuffer(slotted, FLAT, ds.peel(slotted, FLAT)[1][0], shading=ds.FlatShading())
    np.testing.assert_allclose(flat.normal.z, 1)
    with pytest.raises(ds.BadInput, match="seen from both sides"):
        ds.gbuffer(mesh, FLAT, ds.peel(mesh, FLAT)[0][0], shading=ds.GouraudShading())


@pytest.mark.slow
@pytest.mark.float64
def test_derivatives_at_fixed_visibility():
    """Of both sides of a sphere and of a mesh, against finite differences."""
    camera = ds.PerspectiveCamera(5, 4, 0.3, position=(1, 2, 4))
    mesh, sphere = ds.Mesh(*icosphere(0)), ds.Sphere((0.1, 0.2, 0.0), 0.9)
    peeled = ds.peel([mesh, sphere], camera)
    assert sizes(peeled)[2:] == [[8, 10], [10, 8]]

    @jax.jit
    def total(vertices, center, radius):
        objects = [ds.Mesh(vertices, mesh.faces), ds.Sphere(center, radius)]
        found = ds.layers(objects, camera, visibility=peeled)
        return sum(jnp.sum(jnp.sin(x)) for x in jax.tree.leaves(found) if x.dtype == float)

    at = mesh.vertices, sphere.center, sphere.radius
    moves = tuple(jnp.asarray(np.random.default_rng(1).normal(size=x.shape)) for x in at)
    forward = jax.jvp(total, at, moves)[1]
    slopes = jax.grad(total, argnums=(0, 1, 2))(*at)
    reverse = sum(jnp.vdot(x, move) for x, move in zip(slopes, moves, strict=True))
    np.testing.assert_allclose(reverse, forward, rtol=1e-12)
    step = 1e-4
    lower, upper = (
        total(*(x + h * m for x, m in zip(at, moves, strict=True))) for h in (-step, step)
    )
    np.testing.assert_allclose((upper - lower) / (2 * step), forward, rtol=1e-6)
    assert all(np.any(np.asarray(x)) for x in slopes)


def test_what_is_refused():
    with pytest.raises(ds.BadInput, match="no objects are given"):
        ds.peel([], FLAT)
    with pytest.raises(ds.BadInput, match="count is 0: give at least 1 layer"):
        ds.peel(ds.Sphere(), FLAT, 0)
    (near,), far = ds.peel(ds.Sphere(), FLAT)
    seen = ds.visibility(ds.Sphere(), FLAT)
    for count, visibility in ((2, ((near,), far)), (1, ((seen,), far)), (1, ())):
        with pytest.raises(ds.BadInput, match=f"not that of layers of {count} objects"):
            ds.layers([ds.Sphere()] * count, FLAT, visibility=visibility)
    with pytest.raises(ds.BadInput, match=r"compute ds\.peel\(objects, camera\) outside"):
        jax.jit(lambda r: ds.layers(ds.Sphere(radius=r), FLAT)[0][0].normal.x)(1.0)
