"""Shadows, against closed forms: of a ball over a floor, a half-plane before a lamp, and brute force."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from povray import ROUNDING, requires_povray
from povray import render as povray

import diffshade as ds
import fitting
from diffshade import interpolated
from diffshade.errors import BadInput
from diffshade.shading.shadows import shadowed

WHITE = ds.Material(kd=1.0)
RNG = np.random.default_rng(11)
FLOOR = ds.Mesh([[-3, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]], [[0, 1, 2], [0, 2, 3]])
ABOVE = ds.OrthographicCamera(48, 48, 4.0)


def points_at(points: np.ndarray, normal: tuple[float, float, float] = (0, 0, 1)) -> ds.GBuffer:
    return ds.GBuffer.from_arrays(points[None], np.broadcast_to(normal, points[None].shape))


def seen(light: object, gbuffer: ds.GBuffer, occluders: object) -> np.ndarray:
    (one,) = shadowed(light, gbuffer, occluders)  # type: ignore[arg-type]
    return np.asarray(one.visible)


def globe(bands: int, center: tuple[float, float, float] = (0, 0, 0)) -> ds.Mesh:
    """A sphere of radius 1 in triangles between meridians and parallels."""
    mesh = interpolated.ball(bands)
    return replace(mesh, vertices=np.asarray(mesh.vertices, float) + np.array(center))


@pytest.mark.parametrize("light", [ds.PointLight((0.5, 0.2, 4.0)), ds.ParallelLight((1, -0.3, 2))])
def test_a_ball_over_a_floor(light: ds.PointLight | ds.ParallelLight) -> None:
    """A point is dark where the ray to the light passes the centre nearer than the radius."""
    center, radius = np.array([0.3, -0.2, 1.5]), 0.7
    gbuffer = ds.gbuffer(FLOOR, ABOVE)
    assert gbuffer.position is not None
    p = np.asarray(gbuffer.position.to_array(), np.float64)
    if isinstance(light, ds.PointLight):
        l = np.asarray(light.position, np.float64) - p
    else:
        l = np.broadcast_to(np.asarray(light.direction, np.float64), p.shape)
    apart = np.linalg.norm(np.cross(center - p, l), axis=1) / np.linalg.norm(l, axis=1)
    clear = np.abs(apart - radius) > 1e-3
    dark = 1.0 * (apart > radius)
    assert 0.02 < 1 - dark.mean() < 0.98
    np.testing.assert_array_equal(
        seen(light, gbuffer, ds.Sphere(center, radius))[clear], dark[clear]
    )
    mesh = globe(96, tuple(center))
    mesh = replace(mesh, vertices=center + radius * (np.asarray(mesh.vertices) - center))
    clear = np.abs(apart - radius) > 2e-3
    np.testing.assert_array_equal(seen(light, gbuffer, (mesh, FLOOR))[clear], dark[clear])


@pytest.mark.parametrize("offset", [0.0, 1000.0])
def test_what_faces_the_light_is_not_in_its_own_way(offset: float) -> None:
    """A convex mesh hides of itself what turns away, and nothing else: at grazing angles too."""
    center = (offset, -offset, 0.5 * offset)
    mesh = globe(24, center)
    above = (*center[:2], center[2] + 4)
    camera = ds.OrthographicCamera(64, 64, 2.2, position=above, target=center)
    gbuffer = ds.gbuffer(mesh, camera)
    face, _ = ds.visibility(mesh, camera).on_mesh()
    n = np.asarray(mesh.face_normals().to_array(), np.float64)[np.asarray(face)]
    light = ds.ParallelLight((1.0, 0.4, 0.3))
    l = np.asarray(light.direction, np.float64) / np.linalg.norm(light.direction)
    facing = n @ l
    wrong = seen(light, gbuffer, mesh) != (facing > 0)
    # Points within rounding of an edge, on two triangles at once: far away in single precision many are
    most = 2 if jax.config.jax_enable_x64 else 4 if offset == 0 else 80
    assert wrong.sum() <= most


def test_thin_layers_hide_each_other() -> None:
    sheet = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    two = np.concatenate([sheet, 0.5 * sheet + [0, 0, 1e-4]])
    mesh = ds.Mesh(two, [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    xy = np.array([[0.1, 0.2], [0.4, -0.4], [0.7, 0.1], [-0.2, 0.8]])
    low, high = (points_at(np.c_[xy, np.full(4, z)]) for z in (0.0, 1e-4))
    light = ds.ParallelLight((0, 0, 1))
    np.testing.assert_array_equal(seen(light, low, mesh), [0, 0, 1, 1])
    np.testing.assert_array_equal(seen(light, high, mesh)[:2], [1, 1])


def test_many_triangles_by_brute_force() -> None:
    """Moeller and Trumbore (1997) over all triangles and points, in NumPy."""
    corners = RNG.uniform(-1, 1, (60, 1, 3)) + RNG.normal(0, 0.25, (60, 3, 3))
    mesh = ds.Mesh(corners.reshape(-1, 3), np.arange(180).reshape(-1, 3))
    points = RNG.uniform(-1.5, 1.5, (400, 3))
    place = np.array([0.2, 0.1, 0.9])
    d = place - points
    a, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(d[:, None], e2)
    det = (e1 * across).sum(-1)
    s = points[:, None] - a
    u = (s * across).sum(-1) / det
    v = (d[:, None] * np.cross(s, e1)).sum(-1) / det
    t = (e2 * np.cross(s, e1)).sum(-1) / det
    hit = (u > 0) & (v > 0) & (u + v < 1) & (t > 0) & (t < 1)
    found = seen(ds.PointLight(place), points_at(points), mesh)
    expected = 1.0 * ~hit.any(axis=1)
    assert 0.2 < expected.mean() < 0.8
    assert (found != expected).sum() <= 1  # a ray within rounding of an edge


def test_a_half_plane_before_a_lamp() -> None:
    """The irradiance of the part of a square lamp that an edge leaves, which is a lamp of its own."""
    lamp = ds.RectangleLight((0, 0, 2), (1, 0, 0), (0, -1, 0), radiance=1.0, samples=6)
    screen = ds.Mesh([[0, -9, 1], [9, -9, 1], [9, 9, 1], [0, 9, 1]], [[0, 1, 2], [0, 2, 3]])
    x = np.linspace(-0.6, 0.6, 13)
    floor = points_at(np.c_[x, 0 * x, 0 * x])
    found = ds.render(floor, ds.Scene(lights=shadowed(lamp, floor, screen)), WHITE)
    for k, at in enumerate(x):
        edge = np.clip(-at, -0.5, 0.5)  # the screen's edge, from the point on the lamp
        width = edge + 0.5
        expected = 0.0
        if width > 0:
            part = ds.RectangleLight(
                (0.5 * (edge - 0.5), 0, 2), (width, 0, 0), (0, -1, 0), samples=6
            )
            expected = ds.render(floor, ds.Scene(lights=part), WHITE)[0, k, 0].item()
        assert abs(found[0, k, 0].item() - expected) < 0.25 / 24


@pytest.mark.parametrize("tilt", [0.0, 0.37])
def test_a_lamp_on_a_surface_is_not_hidden_by_it(tilt: float) -> None:
    """A panel in a ceiling, a lamp on a ball, and a ball that glows: the floor under them is lit."""
    floor = points_at(RNG.uniform(-1, 1, (30, 3)) * [1, 1, 0])
    u, v = np.array([np.cos(tilt), 0, np.sin(tilt)]), np.array([0.0, -1.0, 0.0])
    at = np.array([0.013, -0.021, 2.7])
    corners = at + 3 * np.array([-u - v, u - v, u + v, -u + v])
    ceiling = ds.Mesh(corners, [[0, 1, 2], [0, 2, 3]])
    panel = ds.RectangleLight(at, u, v, samples=2)
    for element in shadowed(panel, floor, ceiling):
        np.testing.assert_array_equal(np.asarray(element.visible), 1)
    shade = ds.Mesh(corners - [0, 0, 1e-3], [[0, 1, 2], [0, 2, 3]])
    for element in shadowed(panel, floor, (ceiling, shade)):
        np.testing.assert_array_equal(np.asarray(element.visible), 0)
    ball = ds.Sphere((0.3, 0.1, 2.0), 0.6)
    below = np.array([0.3, 0.1, 2.0]) - 0.6 * np.array([np.sin(tilt), 0, np.cos(tilt)])
    under = points_at(RNG.uniform(-0.3, 0.3, (30, 3)) * [1, 1, 0] + [0.3, 0.1, 0])
    np.testing.assert_array_equal(seen(ds.PointLight(below), under, ball), 1)
    np.testing.assert_array_equal(seen(ds.PointLight((0.3, 0.1, 2.6)), under, ball), 0)
    glowing = ds.SphereLight((0.3, 0.1, 2.0), 0.6, samples=6)
    bare = ds.render(under, ds.Scene(lights=glowing), WHITE)
    itself = ds.render(under, ds.Scene(lights=shadowed(glowing, under, ball)), WHITE)
    np.testing.assert_allclose(itself, bare, rtol=0.02)


def test_shadows_add_to_those_that_are_there() -> None:
    floor = points_at(RNG.uniform(-1, 1, (200, 3)) * [1, 1, 0])
    lamp, a, b = ds.PointLight((0, 0, 4)), ds.Sphere((0.4, 0, 1), 0.4), ds.Sphere((-0.4, 0, 1), 0.4)
    one_by_one = seen(shadowed(lamp, floor, a), floor, b)
    np.testing.assert_array_equal(one_by_one, seen(lamp, floor, (a, b)))
    assert 0 < one_by_one.mean() < seen(lamp, floor, b).mean()
    half = ds.EnvironmentLight([1.0], visible=np.full(200, 0.5))
    assert all((np.asarray(x.visible) == 0.5).all() for x in half.as_lights(2))
    with pytest.raises(BadInput, match="give a share, 0 to 1"):
        ds.PointLight((0, 0, 4), visible=np.full(200, 50.0))


def test_a_light_that_rounding_makes_a_point() -> None:
    floor = points_at(RNG.uniform(-1, 1, (20, 3)) * [1, 1, 0])
    lamp = ds.DiscLight((1000, 1000, 1000), (0, 0, -1), 1e-14)
    for element in shadowed(lamp, floor, ds.Sphere((0, 0, 1), 0.1)):
        assert np.asarray(element.visible).shape == (20,)


def test_the_share_is_a_factor_on_the_light() -> None:
    gbuffer = ds.gbuffer(FLOOR, ABOVE)
    lights = (
        ds.PointLight((0.5, 0.2, 4.0), (0.9, 0.8, 0.7)),
        ds.SpotLight((1, 1, 3), (-1, -1, -3)),
    )
    ball = ds.Sphere((0.3, -0.2, 1.5), 0.7)
    material = ds.Material(ka=0.1, kd=0.6, specular=ds.Phong(0.3, 20.0))
    expected = np.asarray(ds.render(gbuffer, ds.Scene(ambient=0.2), material))
    for light in lights:
        alone = ds.render(gbuffer, ds.Scene(lights=light), material)
        plane = gbuffer.to_image((jax.numpy.asarray(seen(light, gbuffer, ball)),))
        expected = expected + np.asarray(alone * plane)
    scene = ds.Scene(0.2, shadowed(lights, gbuffer, ball))
    found = ds.render(gbuffer, scene, material)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    kept = ds.render(ds.keep_geometry(gbuffer, scene, material), scene, material)
    np.testing.assert_allclose(kept, expected, atol=1e-6)
    inside = jax.jit(ds.render)(gbuffer, scene, material)
    np.testing.assert_allclose(inside, expected, atol=1e-6)
    with pytest.raises(BadInput, match="kept geometry"):
        ds.render(ds.keep_geometry(gbuffer, ds.Scene(0.2, lights), material), scene, material)


def test_many_lights_on_many_pixels() -> None:
    """Pages of an image, and lights in chunks, each with its own part of the planes."""
    gbuffer = ds.gbuffer(FLOOR, ds.OrthographicCamera(160, 160, 4.0))
    places = RNG.uniform(-1, 1, (9, 3)) + np.array([0, 0, 4])
    lights = shadowed([ds.PointLight(p) for p in places], gbuffer, ds.Sphere((0, 0, 1.5), 0.7))
    scene, material = ds.Scene(lights=lights), ds.Material(kd=0.2)
    each = [np.asarray(ds.render(gbuffer, ds.Scene(lights=x), material)) for x in lights]
    found = ds.render(gbuffer, scene, material)
    np.testing.assert_allclose(found, np.sum(each, axis=0), atol=1e-6)
    error = ds.mean_squared_error(gbuffer, scene, material, 0 * found)
    np.testing.assert_allclose(error, np.mean(np.square(found)), rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("images", [1, 3])
def test_a_fit_knows_the_shadows(images: int) -> None:
    ball, camera = ds.Sphere(), ds.OrthographicCamera(64, 64, 2.2)
    gbuffer = ds.gbuffer(ball, camera)
    other = ds.Sphere((0.9, 0.7, 1.2), 0.45)
    material = ds.Material(ka=0.1, kd=(0.6, 0.4), specular=ds.Phong(0.3, 25.0))
    places = RNG.uniform(-0.5, 0.5, (images, 2, 3)) + np.array([[1.5, 1.5, 4], [-2, 1, 3]])
    scenes = [
        ds.Scene(0.2, shadowed([ds.PointLight(p) for p in each], gbuffer, other)) for each in places
    ]
    assert all(0 < np.mean(s.lights[0].visible) < 0.95 for s in scenes)
    taken = [ds.render(gbuffer, s, material) for s in scenes]
    fit = fitting.fit(taken, gbuffer, scenes)
    found = fit.material
    np.testing.assert_allclose(np.asarray(found.kd), [0.6, 0.4], rtol=1e-3)
    np.testing.assert_allclose(np.asarray(found.specular[0].shininess), 25, rtol=1e-3)
    blind = [ds.Scene(0.2, [replace(x, visible=None) for x in s.lights]) for s in scenes]
    assert fitting.fit(taken, gbuffer, blind).relative_residual > 0.02
    if images == 1:
        solved = fitting.solve(taken, gbuffer, scenes)
        np.testing.assert_allclose(np.asarray(solved.kd), [0.6, 0.4], rtol=1e-3)
    with pytest.raises(BadInput, match="by `valid`"):
        fitting.fit_maps(taken, gbuffer, scenes)
    if images == 3:
        halves = np.where(np.arange(64) < 32, 1, 2) * np.ones((64, 1), int)
        maps = fitting.fit_maps(taken, gbuffer, scenes, regions=halves, material=material)
        assert float(np.nanmax(np.abs(maps.material.kd - np.array([[0.6], [0.4]])))) < 1e-3


@requires_povray
def test_a_ball_and_a_floor_by_povray() -> None:
    camera = {"kind": "perspective", "width": 64, "height": 48, "fov": 0.7}
    camera |= {"position": (0.0, -6.0, 4.0), "target": (0.0, 0.0, 0.5), "up": (0.0, 0.0, 1.0)}
    ball = {"kind": "sphere", "center": (0.2, 0.1, 1.2), "radius": 0.7}
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    floor = {"kind": "mesh", "vertices": np.asarray(FLOOR.vertices, float), "normals": up}
    floor["faces"] = np.asarray(FLOOR.faces)
    matte = {"ka": 0.1, "kd": 0.6, "ks": 0.2, "shininess": 20.0}
    lamps = [
        {"kind": "point", "position": (2.0, -1.0, 4.0), "intensity": 0.7},
        {"kind": "parallel", "direction": (-1.0, -0.5, 2.0), "intensity": 0.4},
    ]
    expected = povray([(ball, matte), (floor, matte)], lamps, camera, ambient=0.5, shadows=True)
    view = ds.PerspectiveCamera(
        64,
        48,
        0.7,
        camera["position"],
        camera["target"],
        camera["up"],  # type: ignore[arg-type]
    )
    sphere = ds.Sphere(ball["center"], ball["radius"])  # type: ignore[arg-type]
    lights = (ds.PointLight((2, -1, 4), 0.7), ds.ParallelLight((-1, -0.5, 2), 0.4))
    material = ds.Material(ka=0.1, kd=0.6, specular=ds.Phong(0.2, 20.0))
    image = np.zeros((48, 64, 1))
    for surface in (FLOOR, sphere):  # the ball is in front of the floor
        gbuffer = ds.gbuffer(surface, view)
        scene = ds.Scene(0.5, shadowed(lights, gbuffer, (FLOOR, sphere)))
        own = np.asarray(ds.render(gbuffer, scene, material))
        image = np.where(gbuffer.mask[..., None], own, image)
    apart = np.abs(image - expected).max(axis=2)
    assert (apart > 0.05).sum() <= 4  # pixels at the edges of shadows and of the ball
    assert np.sort(apart.ravel())[:-4].max() < 3 * ROUNDING


def test_what_is_refused() -> None:
    gbuffer, ball, lamp = ds.gbuffer(FLOOR, ABOVE), ds.Sphere(), ds.PointLight((0, 0, 5))
    with pytest.raises(BadInput, match="normals only"):
        shadowed(lamp, ds.GBuffer.from_arrays(None, np.ones((2, 2, 3))), ball)
    with pytest.raises(BadInput, match="inside jit"):
        jax.jit(lambda g: shadowed(lamp, g, ball))(gbuffer)
    with pytest.raises(BadInput, match="finer is 0"):
        shadowed(lamp, gbuffer, ball, finer=0)
    lights = shadowed(lamp, gbuffer, ball)
    other = ds.gbuffer(FLOOR, ds.OrthographicCamera(20, 20, 4.0))
    with pytest.raises(BadInput, match=r"ds\.shadowed for this G-buffer"):
        ds.render(other, ds.Scene(lights=lights), WHITE)
    with pytest.raises(BadInput, match=r"ds\.shadowed for this G-buffer"):
        fitting.fit(np.ones((20, 20)), other, ds.Scene(lights=lights))
