"""Which ray each pixel looks along: the conventions of the interface, checked by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradients import check_gradients, dead_inputs

import diffshade as ds


def rays(camera, *pixels):
    origin, direction = camera.rays(jnp.array(pixels))
    count = (len(pixels), 3)
    return (np.broadcast_to(np.asarray(v.to_array()), count) for v in (origin, direction))


def test_pixel_centres_of_an_orthographic_camera(tolerance):
    camera = ds.OrthographicCamera(width=4, height=2, extent=8.0)  # pixels of 2 x 2 world units
    origin, direction = rays(camera, 0, 3, 4, 7)  # the corners: top left, top right, bottom ...
    np.testing.assert_allclose(
        origin, [[-3, 1, 0], [3, 1, 0], [-3, -1, 0], [3, -1, 0]], atol=tolerance
    )
    np.testing.assert_allclose(direction, np.tile([0, 0, -1], (4, 1)), atol=tolerance)


def test_the_middle_of_an_odd_image_is_the_axis(tolerance):
    for camera in (
        ds.OrthographicCamera(5, 3, 7.0),
        ds.PerspectiveCamera(5, 3, 0.9, position=(0, 0, 4)),
    ):
        origin, direction = rays(camera, 7)
        np.testing.assert_allclose(origin[0, :2], [0, 0], atol=tolerance)
        np.testing.assert_allclose(direction[0], [0, 0, -1], atol=tolerance)


def test_an_orthographic_camera_with_a_position_looks_at_its_target(tolerance):
    camera = ds.OrthographicCamera(1, 1, 2.0, position=(5, 1, 0), target=(0, 1, 0))
    right, up, back = (axis.to_array() for axis in camera.axes())
    np.testing.assert_allclose(right, [0, 0, -1], atol=tolerance)
    np.testing.assert_allclose(up, [0, 1, 0], atol=tolerance)
    np.testing.assert_allclose(back, [1, 0, 0], atol=tolerance)
    origin, direction = rays(camera, 0)
    np.testing.assert_allclose(origin[0], [5, 1, 0], atol=tolerance)
    np.testing.assert_allclose(direction[0], [-1, 0, 0], atol=tolerance)
    np.testing.assert_allclose(camera.viewer.direction(None).to_array(), [1, 0, 0], atol=tolerance)


def test_up_turns_the_image(tolerance):
    camera = ds.OrthographicCamera(2, 2, 2.0, up=(1, 0, 0))  # the top of the image is world x
    origin, _ = rays(camera, 0)
    np.testing.assert_allclose(origin[0], [0.5, 0.5, 0], atol=tolerance)
    origin, _ = rays(camera, 1)
    np.testing.assert_allclose(origin[0], [0.5, -0.5, 0], atol=tolerance)


def test_axes_are_orthonormal_and_right_handed(tolerance):
    camera = ds.PerspectiveCamera(8, 8, 1.0, position=(3, -2, 5), target=(1, 1, 1), up=(0.2, 1, 0))
    axes = np.stack([axis.to_array() for axis in camera.axes()])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=10 * tolerance)
    assert np.linalg.det(axes) == pytest.approx(1, abs=10 * tolerance)


def test_the_field_of_view_of_a_perspective_camera_is_vertical(tolerance):
    fov = 2 * np.arctan(0.75)
    camera = ds.PerspectiveCamera(width=4, height=2, fov=fov, position=(1, 2, 3), target=(1, 2, 0))
    # Half the height is 0.75 at distance 1: a pixel is 0.75 wide and high.
    origin, direction = rays(camera, 0, 7)
    np.testing.assert_allclose(origin, [[1, 2, 3], [1, 2, 3]], atol=tolerance)
    expected = np.array([[-1.125, 0.375, -1], [1.125, -0.375, -1]])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(direction, expected, atol=tolerance)


def test_an_eye_sees_along_the_ray_backwards(tolerance):
    camera = ds.PerspectiveCamera(3, 3, 1.0, position=(1, 2, 3), target=(0, 0, 0))
    origin, direction = camera.rays(jnp.arange(9))
    v = camera.viewer.direction(origin + direction * 2.5)
    np.testing.assert_allclose(v.to_array(), -direction.to_array(), atol=10 * tolerance)


@pytest.mark.float64
def test_rays_are_differentiable_in_every_number_of_a_camera():
    def orthographic(numbers):
        camera = ds.OrthographicCamera(3, 2, **numbers)
        return jnp.concatenate([v.to_array().ravel() for v in camera.rays(jnp.arange(6))])

    def perspective(numbers):
        camera = ds.PerspectiveCamera(3, 2, **numbers)
        return jnp.concatenate([v.to_array().ravel() for v in camera.rays(jnp.arange(6))])

    pose = {
        "position": jnp.array([1.0, 2.0, 3.0]),
        "target": jnp.array([0.1, -0.2, 0.3]),
        "up": jnp.array([0.1, 1.0, 0.2]),
    }
    for f, size in ((orthographic, "extent"), (perspective, "fov")):
        largest = check_gradients(f, [{**pose, size: jnp.array(1.1)}])
        assert dead_inputs(largest[0]) == []


def test_a_camera_can_be_built_inside_jit():
    def corner(fov):
        camera = ds.PerspectiveCamera(2, 2, fov, position=(0, 0, 1))
        return camera.rays(jnp.arange(4)).direction.x[0]

    assert jax.jit(corner)(0.5) < 0


@pytest.mark.parametrize("size", [0, -3, 2.5, "4", None])
def test_a_size_that_is_no_count_is_refused(size):
    with pytest.raises(ds.BadInput, match=r"width is .*: give a whole number"):
        ds.OrthographicCamera(size, 4, 1.0)
    with pytest.raises(ds.BadInput, match=r"height is .*: give a whole number"):
        ds.PerspectiveCamera(4, size, 1.0, position=(0, 0, 1))


def test_numpy_sizes_are_counts():
    assert ds.OrthographicCamera(np.int64(4), np.int32(2), 1.0).width == 4


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(ds.BadInput, match=r"extent has shape \(2,\): give one number"):
        ds.OrthographicCamera(2, 2, (1.0, 2.0))
    with pytest.raises(ds.BadInput, match="position has shape"):
        ds.PerspectiveCamera(2, 2, 1.0, position=(1.0, 2.0))


def test_a_target_without_a_position_is_refused():
    with pytest.raises(ds.BadInput, match="a target and no position"):
        ds.OrthographicCamera(2, 2, 1.0, target=(0, 0, 1))


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        (ds.OrthographicCamera(2, 2, 0.0), "extent is 0"),
        (ds.OrthographicCamera(2, 2, -1.0), "extent is -1"),
        (ds.PerspectiveCamera(2, 2, 0.0, position=(0, 0, 1)), "fov is 0"),
        (ds.PerspectiveCamera(2, 2, 60.0, position=(0, 0, 1)), "fov is 60: .* radians"),
        (ds.PerspectiveCamera(2, 2, 1.0, position=(1, 1, 1), target=(1, 1, 1)), "same point"),
        (ds.PerspectiveCamera(2, 2, 1.0, position=(0, 3, 0)), r"own up direction, \(0, 1, 0\)"),
        (ds.OrthographicCamera(2, 2, 1.0, up=(0, 0, 2)), "own up direction"),
    ],
)
def test_a_camera_that_makes_no_picture_is_refused_when_it_looks(camera, message):
    with pytest.raises(ds.BadInput, match=message):
        ds.visibility(ds.Sphere(), camera)
