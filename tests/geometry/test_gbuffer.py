"""G-buffers: from plain arrays, from meshes with derivatives, and to and from images."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from mesh_cases import CUBE, CUBE_FACES, cube, icosphere

import diffshade as ds

UP = np.tile([0.0, 0.0, 2.0], (3, 4, 1))  # 3 rows, 4 columns, not of unit length
PLACE = np.arange(36.0).reshape(3, 4, 3)


def test_from_arrays_normalises_and_keeps_row_order(tolerance):
    g = ds.GBuffer.from_arrays(PLACE, UP)
    assert g.shape == (3, 4)
    assert g.index is None
    assert g.pixel_count == 12
    np.testing.assert_allclose(g.normal.to_array(), np.tile([0, 0, 1], (12, 1)), atol=tolerance)
    np.testing.assert_array_equal(g.position.to_array(), PLACE.reshape(12, 3))
    np.testing.assert_array_equal(g.viewer.direction(g.position).to_array(), [0, 0, 1])


def test_a_vector_is_not_iterated():
    """It has an index, which JAX clamps: iteration by it would never end."""
    with pytest.raises(TypeError, match="not iterable"):
        iter(ds.GBuffer.from_arrays(None, np.ones((2, 2, 3))).normal)


def test_a_mask_picks_pixels():
    mask = np.zeros((3, 4), bool)
    mask[0, 3] = mask[2, 1] = True
    for given in (mask, 255 * mask.astype(np.uint8), mask.astype(float)):
        g = ds.GBuffer.from_arrays(PLACE, UP, given)
        np.testing.assert_array_equal(g.index, [3, 9])
        np.testing.assert_array_equal(g.position.to_array(), [PLACE[0, 3], PLACE[2, 1]])
        np.testing.assert_array_equal(g.mask, mask)


def test_without_a_mask_pixels_without_a_normal_are_background():
    normal = UP.copy()
    normal[0, 0] = 0
    normal[1, 2] = np.nan
    normal[2, 3, 1] = np.inf
    place = PLACE.copy()
    place[0, 0] = np.nan  # background may be anything
    g = ds.GBuffer.from_arrays(place, normal)
    np.testing.assert_array_equal(np.flatnonzero(~g.mask), [0, 6, 11])
    assert np.isfinite(g.position.to_array()).all()


def test_viewers(tolerance):
    eye = ds.GBuffer.from_arrays(PLACE, UP, eye=(0, 1, 7))
    v = eye.viewer.direction(eye.position).to_array()
    np.testing.assert_allclose(v[0], np.array([0, 0, 5]) / 5, atol=tolerance)
    assert eye.viewer.direction(eye.position).x.shape == (12,)
    far = ds.GBuffer.from_arrays(None, UP, view=(0, 3, 4))
    np.testing.assert_allclose(far.viewer.direction(None).to_array(), [0, 0.6, 0.8], rtol=tolerance)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((None, UP[0]), {}, r"normal has shape \(4, 3\): give an array of shape \[H, W, 3\]"),
        ((None, UP[..., :2]), {}, r"normal has shape \(3, 4, 2\)"),
        ((PLACE[:2], UP), {}, r"position is \(2, 4\) pixels where normal is \(3, 4\)"),
        ((PLACE, UP, np.ones((4, 3))), {}, r"mask has shape \(4, 3\)"),
        ((PLACE, UP, np.zeros((3, 4))), {}, "the mask is empty"),
        ((PLACE, 0 * UP), {}, "the mask is empty"),
        ((None, UP), {"eye": (0, 0, 1)}, "an eye needs positions"),
        ((None, UP), {"view": (0, 1)}, "view has shape"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(arguments, options, message):
    with pytest.raises(ds.BadInput, match=message) as refusal:
        ds.GBuffer.from_arrays(*arguments, **options)
    assert "\n" not in str(refusal.value)


def test_masked_pixels_that_cannot_be_shaded_are_refused():
    everything = np.ones((3, 4))
    for value, what in ((0, "normal is zero"), (np.nan, "normal is not finite")):
        normal = UP.copy()
        normal[1, 2] = normal[2, 0] = value
        with pytest.raises(ds.BadInput, match=f"{what} at 2 masked pixels, .* row 1, column 2"):
            ds.GBuffer.from_arrays(PLACE, normal, everything)
    place = PLACE.copy()
    place[2, 3, 0] = np.inf
    with pytest.raises(ds.BadInput, match="position is not finite at 1 masked pixels"):
        ds.GBuffer.from_arrays(place, UP)


def test_whole_numbers_and_lists_are_taken():
    whole = ds.GBuffer.from_arrays(jnp.zeros((1, 2, 3), int), jnp.ones((1, 2, 3), int))
    lists = ds.GBuffer.from_arrays([[[0, 0, 0], [0, 0, 0]]], [[[1, 1, 1], [1, 1, 1]]])
    for g in (whole, lists):
        np.testing.assert_allclose(g.normal.to_array(), 3**-0.5, rtol=1e-6)


def test_from_arrays_may_be_traced_if_the_mask_is_not(tolerance):
    mask = np.ones((3, 4), bool)
    mask[1, 1] = False

    def total(normal, mask):
        return jnp.sum(ds.GBuffer.from_arrays(None, normal, mask).normal.x)

    by_normal = jax.jit(jax.grad(total), static_argnums=1)
    gradient = np.asarray(jax.grad(lambda n: total(n, mask))(jnp.asarray(UP)))
    np.testing.assert_allclose(gradient[mask][:, 0], 0.5, rtol=tolerance)  # d(x/|n|)/dx at |n| = 2
    np.testing.assert_array_equal(gradient[1, 1], 0)
    assert by_normal(jnp.asarray(UP), None).shape == UP.shape
    with pytest.raises(ds.BadInput, match="mask is traced"):
        jax.jit(total)(UP, mask)


def test_image_and_planes_round_trip(rng):
    mask = rng.random((5, 7)) < 0.5
    normal = np.tile([0.0, 0, 1], (5, 7, 1))
    for given in (mask, None):
        g = ds.GBuffer.from_arrays(None, normal, given)
        image = jnp.asarray(rng.random((5, 7, 3)))
        planes = g.from_image(image)
        assert planes.shape == (3, g.pixel_count)
        back = g.to_image(tuple(planes))
        inside = np.ones((5, 7), bool) if given is None else mask
        np.testing.assert_array_equal(back, np.where(inside[..., None], image, 0))


def test_pixels_may_come_in_any_order(rng):
    some = ds.GBuffer.from_arrays(None, rng.normal(size=(3, 4, 3)), rng.random((3, 4)) < 0.7)
    order = rng.permutation(some.pixel_count)
    mixed = ds.GBuffer(some.shape, some.normal[order], some.viewer, index=some.index[order])
    scene, material = ds.Scene(0.1, ds.ParallelLight((0, 0, 1))), ds.Material(0.3, 0.5)
    image = ds.render(some, scene, material)
    np.testing.assert_array_equal(ds.render(mixed, scene, material), image)
    np.testing.assert_allclose(jax.jit(ds.render)(mixed, scene, material), image, rtol=1e-6)
    np.testing.assert_array_equal(mixed.from_image(image), some.from_image(image)[:, order])


def bent(vertices):
    return ds.Mesh(vertices, CUBE_FACES)


@pytest.mark.float64
@pytest.mark.parametrize("shading", [ds.PhongShading(), ds.FlatShading(), ds.GouraudShading()])
def test_a_mesh_is_differentiable_in_its_vertices(shading):
    camera = ds.PerspectiveCamera(5, 4, 0.8, position=(3, 2, 4))
    seen = ds.visibility(cube(), camera)
    assert np.unique(np.asarray(seen.face)).size >= 3

    @jax.jit
    def f(vertices):
        g = ds.gbuffer(ds.Mesh(vertices, CUBE_FACES), camera, seen, shading=shading)
        return g.position.to_array(), g.normal.to_array()

    vertices = jnp.asarray(CUBE)
    check_grads(f, (vertices,), order=1, atol=1e-6, rtol=1e-6)
    anyhow = jnp.asarray(np.sin(np.arange(24.0)).reshape(8, 3))
    for moved in jax.jvp(f, (vertices,), (anyhow,))[1]:
        assert jnp.abs(moved).max() > 0.01


@pytest.mark.float64
def test_a_position_moves_with_the_corners_of_its_face():
    camera = ds.OrthographicCamera(5, 4, 4.0, position=(3, 2, 4), target=(0, 0, 0))
    seen = ds.visibility(cube(), camera)

    def height(vertices, pixel):
        return ds.gbuffer(ds.Mesh(vertices, CUBE_FACES), camera, seen).position.z[pixel]

    by_vertices = jax.jit(jax.grad(height))
    for pixel, face in enumerate(np.asarray(seen.face)):
        expected = np.zeros((8, 3))
        expected[CUBE_FACES[face], 2] = np.asarray(seen.barycentric.to_array())[pixel]
        np.testing.assert_allclose(by_vertices(jnp.asarray(CUBE), pixel), expected, atol=1e-14)


def test_jit_with_given_visibility_gives_the_same():
    camera = ds.PerspectiveCamera(9, 7, 0.8, position=(3, 2, 4))
    for geometry in (ds.Mesh(*icosphere(1)), ds.Sphere()):
        seen = ds.visibility(geometry, camera)
        plain = ds.gbuffer(geometry, camera)
        jitted = jax.jit(ds.gbuffer)(geometry, camera, seen)
        np.testing.assert_array_equal(jitted.index, plain.index)
        for name in ("position", "normal"):
            np.testing.assert_allclose(
                getattr(jitted, name).to_array(), getattr(plain, name).to_array(), atol=1e-6
            )


def test_visibility_inside_jit_is_refused():
    camera = ds.OrthographicCamera(4, 4, 2.0)
    with pytest.raises(ds.BadInput, match="inside jit, grad or vmap"):
        jax.jit(lambda radius: ds.gbuffer(ds.Sphere(radius=radius), camera).position.z)(1.0)


def test_a_visibility_of_another_size_is_refused():
    seen = ds.visibility(ds.Sphere(), ds.OrthographicCamera(4, 4, 2.0))
    with pytest.raises(
        ds.BadInput, match="visibility is of 4 x 4 pixels, and the camera has 6 x 8"
    ):
        ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 6, 2.0), seen)


def test_slots_reach_the_pixels():
    mesh = ds.Mesh(CUBE, CUBE_FACES, slot=np.arange(12))
    camera = ds.OrthographicCamera(6, 6, 1.0)
    seen = ds.visibility(mesh, camera)
    np.testing.assert_array_equal(ds.gbuffer(mesh, camera, seen).slot, seen.face)


def test_a_full_image_needs_no_index():
    g = ds.gbuffer(cube(), ds.OrthographicCamera(4, 4, 1.0))
    assert g.index is None
    assert g.mask.all()


def test_the_foreground_is_the_same_inside_jit():
    """Plain arrays that a traced function closes over decide the foreground there as outside."""
    normal = np.zeros((4, 4, 3))
    normal[1, 2] = (0.0, 0.6, 0.8)
    outside = ds.GBuffer.from_arrays(None, normal)
    inside = jax.jit(lambda k: ds.GBuffer.from_arrays(None, normal).normal.z * k)(1.0)
    assert outside.pixel_count == inside.size == 1

    camera = ds.OrthographicCamera(8, 8, 2.4)
    expected = ds.gbuffer(ds.Sphere(), camera).position.z
    closed_over = jax.jit(lambda k: ds.gbuffer(ds.Sphere(), camera).position.z * k)(1.0)
    np.testing.assert_allclose(closed_over, expected, rtol=1e-6)


def test_a_camera_can_be_replaced():
    camera = dataclasses.replace(ds.OrthographicCamera(8, 8, 2.4), extent=2.0)
    assert float(camera.extent) == 2.0
    assert ds.visibility(ds.Sphere(), camera).index.size > 0
