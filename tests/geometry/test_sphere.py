"""The analytic sphere against LIGHT-14 to LIGHT-16 by hand, and against its own definition."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

import diffshade as ds


def points(sphere, camera):
    g = ds.gbuffer(sphere, camera)
    return np.asarray(g.position.to_array()), np.asarray(g.normal.to_array())


def test_one_pixel_by_hand(tolerance):
    # Ten pixels of width 1: column 8, row 1 is x = 3.5, y = 3.5, so dx = 2.5, dy = 1.5.
    sphere = ds.Sphere(center=(1, 2, 3), radius=5.0)
    camera = ds.OrthographicCamera(10, 10, 10.0)
    seen = np.asarray(ds.visibility(sphere, camera).index)
    position, normal = points(sphere, camera)
    at = int(np.flatnonzero(seen == 18)[0])
    z = np.sqrt(25 - 2.5**2 - 1.5**2)  # LIGHT-15
    np.testing.assert_allclose(position[at], [3.5, 3.5, 3 + z], rtol=10 * tolerance)
    np.testing.assert_allclose(normal[at], [0.5, 0.3, z / 5], rtol=10 * tolerance)  # LIGHT-16


def test_the_point_of_the_worked_example(tolerance):
    # P (16, 8, 11) on a sphere of radius 21: with pixels of width 1 it is column 48, row 24.
    position, normal = points(ds.Sphere(radius=21.0), camera := ds.OrthographicCamera(65, 65, 65.0))
    seen = np.asarray(ds.visibility(ds.Sphere(radius=21.0), camera).index)
    at = int(np.flatnonzero(seen == 24 * 65 + 48)[0])
    np.testing.assert_allclose(position[at], [16, 8, 11], rtol=10 * tolerance)
    np.testing.assert_allclose(normal[at], [16 / 21, 8 / 21, 11 / 21], rtol=10 * tolerance)
    np.testing.assert_allclose(normal[at], [0.7619, 0.3810, 0.5238], atol=2e-4)


def test_the_outline_is_foreground():
    # Pixel centres at x = -1.5, -0.5, 0.5, 1.5: the outer two just touch the sphere (LIGHT-14).
    sphere, camera = ds.Sphere(radius=1.5), ds.OrthographicCamera(4, 1, 4.0)
    position, normal = points(sphere, camera)
    np.testing.assert_array_equal(position[[0, 3]], [[-1.5, 0, 0], [1.5, 0, 0]])
    np.testing.assert_array_equal(normal[[0, 3]], [[-1, 0, 0], [1, 0, 0]])
    just_smaller = ds.Sphere(radius=1.4999)
    np.testing.assert_array_equal(ds.visibility(just_smaller, camera).index, [1, 2])


def test_the_silhouette_has_the_area_of_the_disc():
    camera = ds.OrthographicCamera(300, 200, 3.0)
    index = np.asarray(ds.visibility(ds.Sphere(center=(0.2, -0.1, 9), radius=0.7), camera).index)
    assert index.size * 0.01**2 == pytest.approx(np.pi * 0.7**2, rel=1e-3)
    rows, columns = np.divmod(index, 300)
    assert columns.mean() + 0.5 == pytest.approx(150 + 20, abs=0.05)
    assert rows.mean() + 0.5 == pytest.approx(100 + 10, abs=0.05)  # y = -0.1 is further down
    assert (np.diff(index) > 0).all()


@pytest.mark.parametrize(
    "camera",
    [
        ds.OrthographicCamera(40, 30, 4.0),
        ds.OrthographicCamera(40, 30, 4.0, position=(3, 2, 4), target=(0.1, 0, 0)),
        ds.PerspectiveCamera(40, 30, 0.8, position=(1, 2, 4), target=(0.2, 0.1, 0)),
    ],
    ids=["orthographic", "placed", "perspective"],
)
def test_points_lie_on_the_sphere_on_the_ray_and_on_the_near_side(camera, tolerance):
    center, radius = np.array([0.3, 0.2, -0.4]), 0.8
    sphere = ds.Sphere(center=center, radius=radius)
    index = ds.visibility(sphere, camera).index
    position, normal = points(sphere, camera)
    origin, direction = (np.asarray(v.to_array()) for v in camera.rays(jnp.arange(40 * 30)))
    origin, direction = np.broadcast_to(origin, (1200, 3)), np.broadcast_to(direction, (1200, 3))

    to_center = center - origin
    across = np.linalg.norm(np.cross(direction, to_center), axis=1)
    np.testing.assert_array_equal(index, np.flatnonzero(across <= radius))

    inner = across[index] < 0.999 * radius  # at the rim rounding is amplified
    index, position, normal = np.asarray(index)[inner], position[inner], normal[inner]
    from_center = position - center
    np.testing.assert_allclose(np.linalg.norm(from_center, axis=1), radius, rtol=100 * tolerance)
    np.testing.assert_allclose(normal * radius, from_center, atol=100 * tolerance)
    off_ray = np.cross(position - origin[index], direction[index])
    np.testing.assert_allclose(off_ray, 0, atol=100 * tolerance)
    assert ((normal * direction[index]).sum(axis=1) < 0).all()


def test_what_lies_behind_a_camera_is_not_seen():
    sphere = ds.Sphere(center=(0, 0, 10), radius=1.0)
    assert (
        ds.visibility(sphere, ds.PerspectiveCamera(8, 8, 1.0, position=(0, 0, 5))).index.size == 0
    )
    placed = ds.OrthographicCamera(8, 8, 4.0, position=(0, 0, 5))
    assert ds.visibility(sphere, placed).index.size == 0
    assert ds.visibility(sphere, ds.OrthographicCamera(8, 8, 4.0)).index.size > 0


def test_a_camera_inside_sees_nothing():
    inside = ds.PerspectiveCamera(8, 8, 1.0, position=(0, 0, 0.5))
    assert ds.visibility(ds.Sphere(), inside).index.size == 0


def test_nothing_seen_is_an_empty_gbuffer():
    g = ds.gbuffer(ds.Sphere(center=(50, 0, 0)), ds.OrthographicCamera(4, 3, 2.0))
    assert g.pixel_count == 0
    assert not g.mask.any()
    np.testing.assert_array_equal(g.to_image((g.normal.x, g.normal.y)), np.zeros((3, 4, 2)))


@pytest.mark.float64
@pytest.mark.parametrize("view", ["orthographic", "perspective"])
def test_derivatives_in_the_sphere_and_the_camera(view):
    def camera(numbers):
        if view == "orthographic":
            return ds.OrthographicCamera(6, 5, numbers["size"], position=numbers["position"])
        return ds.PerspectiveCamera(6, 5, numbers["size"], position=numbers["position"])

    case = {
        "center": jnp.array([0.1, -0.2, 0.3]),
        "radius": jnp.array(1.2),
        "size": jnp.array(0.25 if view == "perspective" else 0.9),
        "position": jnp.array([0.5, 1.0, 4.0]),
    }
    seen = ds.visibility(ds.Sphere(case["center"], case["radius"]), camera(case))
    assert seen.index.size == 30  # well inside: nothing crosses the outline in a finite step

    @jax.jit
    def f(numbers):
        sphere = ds.Sphere(numbers["center"], numbers["radius"])
        g = ds.gbuffer(sphere, camera(numbers), seen)
        return g.position.to_array(), g.normal.to_array()

    check_grads(f, (case,), order=1, atol=1e-6, rtol=1e-6)
    alive = jax.jit(jax.grad(lambda numbers: jnp.sum(f(numbers)[1] * f(numbers)[0] ** 2)))(case)
    assert all((jnp.abs(gradient) > 1e-3).all() for gradient in alive.values())


def test_the_derivative_of_depth_by_hand(tolerance):
    # z = zc + sqrt(r^2 - dx^2 - dy^2): dz/dr = r/s, dz/dxc = dx/s, dz/dyc = dy/s, dz/dzc = 1.
    camera = ds.OrthographicCamera(1, 1, 1.0)  # looks at x = y = 0

    def depth(center, radius):
        sphere = ds.Sphere(center, radius)
        seen = ds.visibility(ds.Sphere((0.3, -0.4, 1.0), 1.3), camera)
        return ds.gbuffer(sphere, camera, seen).position.z[0]

    by_center, by_radius = jax.grad(depth, (0, 1))(jnp.array([0.3, -0.4, 1.0]), jnp.array(1.3))
    s = 1.2
    np.testing.assert_allclose(by_center, [-0.3 / s, 0.4 / s, 1], rtol=100 * tolerance)
    np.testing.assert_allclose(by_radius, 1.3 / s, rtol=100 * tolerance)


def test_derivatives_are_finite_on_the_outline():
    camera = ds.OrthographicCamera(4, 1, 4.0)
    seen = ds.visibility(ds.Sphere(radius=1.5), camera)

    def total(radius):
        g = ds.gbuffer(ds.Sphere(radius=radius), camera, seen)
        return jnp.sum(g.position.to_array()) + jnp.sum(g.normal.to_array())

    for derivative in (jax.grad, jax.jacfwd):
        assert np.isfinite(derivative(total)(jnp.array(1.5)))


def test_a_sphere_without_a_radius_is_refused():
    camera = ds.OrthographicCamera(4, 4, 2.0)
    for radius in (0.0, -1.0):
        with pytest.raises(ds.BadInput, match=f"radius is {radius:g}: it must be above 0"):
            ds.visibility(ds.Sphere(radius=radius), camera)
    with pytest.raises(ds.BadInput, match="radius has shape"):
        ds.Sphere(radius=(1.0, 2.0))
    with pytest.raises(ds.BadInput, match="must be finite"):
        ds.Sphere(center=(0, 0, np.nan))
