"""Lights with extent, against closed forms: of polygons, discs, spheres and tubes."""

import jax
import numpy as np
import pytest

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.shading.quadrature import resolved

WHITE = ds.Material(kd=1.0)


def irradiance(light: object, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    g = ds.GBuffer.from_arrays(points[None], normals[None])
    return np.asarray(ds.render(g, ds.Scene(lights=light), WHITE), float)[0, :, 0]


def polygon(corners: np.ndarray, point: np.ndarray, normal: np.ndarray) -> float:
    """Lambert (1760): L / 2 times the sum of angles between corners times n . their plane's normal.

    Of a polygon that is all above the horizon, its corners counter-clockwise as the point sees it.
    """
    s = corners - point
    s /= np.linalg.norm(s, axis=1, keepdims=True)
    total = 0.0
    for a, b in zip(s, np.roll(s, -1, axis=0), strict=True):
        across = np.cross(a, b)
        angle = np.arctan2(np.linalg.norm(across), a @ b)
        total += angle * (across / np.linalg.norm(across)) @ normal
    return 0.5 * abs(total)


CENTER, U, V = np.array([0.2, -0.1, 1.2]), np.array([0.9, 0.1, 0.2]), np.array([0.1, -0.7, 0.1])
POINTS = np.array([[0.0, 0.0, 0.0], [0.5, 0.3, -0.1], [-0.6, 0.2, 0.1], [1.0, -1.0, 0.0]])
NORMALS = np.array([[0.0, 0.0, 1.0], [0.1, 0.1, 0.98], [0.3, 0.0, 0.95], [-0.3, 0.4, 0.86]])
NORMALS /= np.linalg.norm(NORMALS, axis=1, keepdims=True)


def test_a_rectangle_is_lamberts_polygon(tolerance: float) -> None:
    corners = np.array(
        [CENTER + a * U + b * V for a, b in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
    )
    expected = [polygon(corners, p, n) for p, n in zip(POINTS, NORMALS, strict=True)]
    errors = []
    for samples in (1, 2, 4, 8, 16):
        found = irradiance(ds.RectangleLight(CENTER, U, V, samples=samples), POINTS, NORMALS)
        errors.append(np.abs(found - expected).max())
    assert errors[0] > 1e-3
    assert (np.diff(errors[:3]) < 0).all()
    assert errors[2] < errors[0] / 300  # exponentially, as all of it is seen
    assert errors[-1] < (1e-11 if jax.config.jax_enable_x64 else 50 * tolerance)


def test_its_back_is_dark() -> None:
    assert (irradiance(ds.RectangleLight(CENTER, V, U), POINTS, NORMALS) == 0).all()


def test_a_disc_over_a_point(tolerance: float) -> None:
    """Parallel and above: pi L sin^2 of its half angle."""
    point, up = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    for radius, height in ((0.3, 1.0), (1.0, 1.0), (2.0, 1.5)):
        lamp = ds.DiscLight((0, 0, height), (0, 0, -1), radius, 2.0, samples=16)
        expected = 2 * np.pi * radius**2 / (radius**2 + height**2)
        np.testing.assert_allclose(irradiance(lamp, point, up), expected, rtol=20 * tolerance)


def test_a_tilted_disc_is_a_polygon_of_many_corners(tolerance: float) -> None:
    axis = np.array([0.2, -0.3, -0.93])
    axis /= np.linalg.norm(axis)
    a = np.cross(axis, [0.0, 0.0, 1.0])
    a /= np.linalg.norm(a)
    t = np.linspace(0, 2 * np.pi, 4001)[:-1]
    rim = CENTER + 0.4 * (np.outer(np.cos(t), a) + np.outer(np.sin(t), np.cross(axis, a)))
    expected = [polygon(rim, p, n) for p, n in zip(POINTS, NORMALS, strict=True)]
    found = irradiance(ds.DiscLight(CENTER, axis, 0.4, samples=12), POINTS, NORMALS)
    np.testing.assert_allclose(found, expected, rtol=2e-6 + 20 * tolerance)


def test_a_sphere_is_a_point_light(tolerance: float) -> None:
    """pi L R^2 / d^2 n.l where all of it is above the horizon; it converges like 1 / samples^2."""
    lamp = ds.PointLight(CENTER, np.pi * 0.3**2 * 1.5, ds.InverseSquare())
    expected = irradiance(lamp, POINTS, NORMALS)
    errors = [
        np.abs(
            irradiance(ds.SphereLight(CENTER, 0.3, 1.5, samples), POINTS, NORMALS) - expected
        ).max()
        for samples in (5, 10, 20)
    ]
    assert errors[0] < 0.08 * expected.max()
    assert errors[2] < errors[0] / 8


def test_a_tube_over_a_floor(tolerance: float) -> None:
    """Parallel to the floor, above the middle: the integral of sin^2 cos / d^2 in closed form."""
    half, height = 1.3, 0.8
    lamp = ds.LineLight((-half, 0, height), (half, 0, height), 0.7, samples=32)
    u = half / height
    # sin(theta) n.l / d^2 = h^2 / (h^2 + x^2)^2, integrated over x
    expected = 0.7 / height * (np.arctan(u) + u / (1 + u * u))
    found = irradiance(lamp, np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(found, expected, rtol=1e-8 + 20 * tolerance)


@pytest.mark.slow
def test_as_few_samples_as_a_tolerance_takes() -> None:
    g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(20, 20, 2.2))
    material = ds.Material(kd=0.5, specular=ds.Phong(0.3, 20.0))
    lamp = ds.RectangleLight((0.5, 1.0, 2.5), (1, 0, 0), (0, -0.6, 0.6), 3.0)
    fine = ds.render(g, ds.Scene(lights=lamp.with_samples(16)), material)
    used = []
    for tolerance in (0.1, 0.01, 0.002):
        few = resolved(lamp, g, material, tolerance)
        used.append(few.samples)
        error = np.abs(np.asarray(ds.render(g, ds.Scene(lights=few), material) - fine)).max()
        assert error <= 1.5 * tolerance  # the difference from the next rule is an estimate
    assert used == sorted(used)
    assert used[0] < used[-1] < 12
    near = ds.RectangleLight((0, 0, 1.001), (2, 0, 0), (0, -2, 0), 3.0)
    with pytest.raises(BadInput, match="24 samples along a side, more than the tolerance of 1e-05"):
        resolved(near, g, material, 1e-5)


def test_derivatives_reach_its_place_and_size() -> None:
    g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(12, 12, 2.2))

    def total(center: jax.Array, radius: jax.Array) -> jax.Array:
        lamp = ds.DiscLight(center, (0, 0, -1), radius, samples=2)
        return ds.render(g, ds.Scene(lights=lamp), WHITE).sum()

    at = np.array([0.3, 0.2, 3.0]).astype(g.normal.x.dtype), np.asarray(0.5, g.normal.x.dtype)
    slopes = jax.grad(total, argnums=(0, 1))(*at)
    step = 1e-3
    for slope, which in ((slopes[0][2], 0), (slopes[1], 1)):
        ends = []
        for sign in (-1, 1):
            moved = [x.copy() for x in at]
            moved[which][... if which else 2] += sign * step
            ends.append(float(total(*moved)))
        np.testing.assert_allclose(slope, (ends[1] - ends[0]) / (2 * step), rtol=2e-2)


def test_what_is_refused() -> None:
    with pytest.raises(BadInput, match="samples is 0: give a whole number of at least 1"):
        ds.SphereLight((0, 0, 2), 0.1, samples=0)
    assert ds.SphereLight((0, 0, 2), 0.1, samples=np.int64(4)).samples == 4
    for nowhere, complaint in (
        (ds.RectangleLight((0, 0, 2), (1, 0, 0), (2, 0, 0)), "u and v are parallel, or zero"),
        (ds.DiscLight((0, 0, 2), (0, 0, 0), 0.1), "a disc's normal is zero"),
        (ds.LineLight((0, 0, 2), (0, 0, 2)), "start and end are one point"),
    ):
        with pytest.raises(BadInput, match=complaint):
            ds.Scene(lights=nowhere)
    with pytest.raises(BadInput, match="a light is 1: give lights"):
        ds.Scene(lights=[1])
    with pytest.raises(BadInput, match=r"the light's radius is -1\.: it cannot be negative"):
        ds.DiscLight((0, 0, 2), (0, 0, -1), -1)
