"""Lights that a tile can do without: the bounds hold, and so does the tolerance, for the sum."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from registry import ATTENUATIONS, LOBES

import diffshade as ds
from diffshade.bounds import Ball, Cone, largest_cosine, smallest_cosine
from diffshade.shading import image as image_module
from diffshade.shading.cull import at_most, needed, tile_by_tile, tile_of
from diffshade.vector import Vec3, dot, unit

CAMERA = ds.PerspectiveCamera(72, 56, fov=0.6, position=(0, 0, 4), target=(0, 0, 0), up=(0, 1, 0))
GBUFFER = ds.gbuffer(ds.Sphere(), CAMERA)
MATERIAL = ds.Material(ka=0.1, kd=(0.6, 0.4, 0.2), specular=ds.Phong((0.4, 0.3, 0.5), 20.0))


def directions(rng: np.random.Generator, *shape: int) -> np.ndarray:
    v = rng.normal(size=(*shape, 3))
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def lamps(rng: np.random.Generator, count: int, law: Any, coloured: bool = True) -> tuple:
    """Point lights around the sphere."""
    places = directions(rng, count) * rng.uniform(1.1, 2.5, (count, 1))
    colours = rng.uniform(0.02, 0.1, (count, 3))
    return tuple(
        ds.PointLight(p, c if coloured else c[0], law)
        for p, c in zip(places.tolist(), colours.tolist(), strict=True)
    )


def near(value: Any, expected: Any) -> None:
    at = 1e-11 if jax.config.jax_enable_x64 else 2e-5
    for a, b in zip(jax.tree.leaves(value), jax.tree.leaves(expected), strict=True):
        if jnp.issubdtype(b.dtype, jnp.floating):
            scale = max(float(np.abs(b).max(initial=0)), 1e-3)
            np.testing.assert_allclose(a, b, rtol=0, atol=at * scale)


@pytest.mark.parametrize("width", [0.0, 1e-3, 0.3, 1.5, 3.1])
def test_cones_hold_their_cosines(rng: np.random.Generator, width: float) -> None:
    for _ in range(20):
        axes = directions(rng, 2)
        spread = directions(rng, 2, 400) * np.sin(width / 2)
        a, b = (unit(Vec3.from_array(jnp.asarray(x, float))) for x in axes[:, None] + spread)
        both = Cone.around(a), Cone.around(b)
        cosines = np.asarray(
            dot(jax.tree.map(lambda x: x[:, None], a), jax.tree.map(lambda x: x[None], b))
        )
        assert cosines.max() <= float(largest_cosine(*both))
        assert cosines.min() >= float(smallest_cosine(*both))
        if width < 0.1:
            assert float(largest_cosine(*both)) <= cosines.max() + 3 * width + 5e-3


def test_a_ball_sees_a_point_within_its_cone(rng: np.random.Generator) -> None:
    points = Vec3.from_array(jnp.asarray(rng.normal(size=(300, 3)), float))
    ball = Ball.around(points)
    for distance in (0.0, 0.5, 3.0, 40.0):
        point = Vec3.from_array(jnp.asarray(directions(rng)[None] * distance, float))[0]
        s = point - points
        cone = ball.towards(point)
        assert float(ball.nearest(point)) <= float(np.sqrt(dot(s, s)).min())
        assert np.asarray(dot(unit(s), cone.axis)).min() >= float(cone.cosine) - 1e-6


@pytest.mark.parametrize("name", LOBES)
@pytest.mark.parametrize("law", ATTENUATIONS)
def test_no_pixel_is_brighter_than_the_bound(rng: np.random.Generator, name: str, law: str) -> None:
    material = ds.Material(kd=(0.3, 0.1, 0.2), specular=LOBES[name](0.7, (9.0, 20.0, 90.0)), os=0.5)
    render = jax.jit(lambda light: ds.render(GBUFFER, ds.Scene(None, light), material, plain=True))
    bound = jax.jit(lambda tile, light: at_most(tile, light, material))
    order = tile_by_tile(GBUFFER)
    for light in (*lamps(rng, 4, ATTENUATIONS[law]), *lamps(rng, 4, ATTENUATIONS[law])):
        image = np.asarray(GBUFFER.from_image(render(light)))[:, np.asarray(order)]
        for first in range(0, 1200, 200):
            here = order[first : first + 200]
            tile = jax.tree.map(lambda x: x[here], (GBUFFER.normal, GBUFFER.position))  # noqa: B023
            of = tile_of(ds.GBuffer((1, 200), tile[0], GBUFFER.viewer, tile[1]), material)
            assert image[:, first : first + 200].max() <= float(bound(of, light)) * (1 + 1e-6)


def test_what_is_not_known_is_not_left_out() -> None:
    class Mirror(ds.Phong):
        most = ds.reflectance.lobe.AbstractLobe.most

    tile = tile_of(GBUFFER, MATERIAL)
    light = ds.ParallelLight((0, 0, 1))
    assert at_most(tile, light, ds.Material(kd=1.0)) <= 1
    assert at_most(tile, light, ds.Material(kd=1.0, specular=Mirror(0.1, 5.0))) == np.inf
    inside = ds.PointLight((0.0, 0.0, 0.9), 1.0, ds.InverseSquare())
    assert at_most(tile, inside, ds.Material(kd=1.0)) == np.inf


def test_as_many_are_left_out_as_the_tolerance_allows(rng: np.random.Generator) -> None:
    most = jnp.asarray(10.0 ** rng.uniform(-6, 0, 200), float).at[7].set(0).at[9].set(jnp.nan)
    for tolerance in (0.0, 1e-5, 1e-3, 0.1, 10.0):
        numbers, count = needed(most, jnp.asarray(tolerance))
        assert sorted(np.asarray(numbers).tolist()) == list(range(200))
        left = np.asarray(most)[np.asarray(numbers)[int(count) :]]
        assert left.sum() <= tolerance
        assert 9 in np.asarray(numbers)[: int(count)]
        assert 7 in np.asarray(numbers)[int(count) :]
        if 0 < tolerance < 10:
            kept = np.sort(np.asarray(most)[np.asarray(numbers)[: int(count)]])
            assert left.sum() + kept[0] * len(left) > tolerance / 2  # the threshold is a good one


def test_tiles_follow_each_other() -> None:
    for gbuffer in (GBUFFER, ds.GBuffer.from_arrays(None, np.ones((50, 70, 3)))):
        order = np.asarray(tile_by_tile(gbuffer))
        np.testing.assert_array_equal(np.sort(order), np.arange(gbuffer.pixel_count))
        index = order if gbuffer.index is None else np.asarray(gbuffer.index)[order]
        tile = np.stack(np.divmod(index, gbuffer.shape[1])) // 32
        steps = np.abs(np.diff(tile)).sum(0)
        assert steps.max() <= 1
        assert steps.sum() + 1 == len(np.unique(tile, axis=1).T)


@pytest.mark.slow
@pytest.mark.parametrize("coloured", [False, True])
@pytest.mark.parametrize("tolerance", [0.0, 1e-3, 0.5])
def test_the_error_of_the_sum_is_below_the_tolerance(
    rng: np.random.Generator, tolerance: float, coloured: bool
) -> None:
    lights = lamps(rng, 50, ds.InverseSquare(), coloured)
    scene = ds.Scene(0.2, (*lights, ds.ParallelLight((0, 1, 1), 0.3), *lamps(rng, 20, None)))
    exact = ds.render(GBUFFER, scene, MATERIAL, plain=True)
    error = np.abs(ds.render(GBUFFER, scene, MATERIAL, tolerance=tolerance) - exact).max()
    rounding = 1e-13 if jax.config.jax_enable_x64 else 1e-5
    assert error <= tolerance + rounding
    if tolerance == 0.5:
        assert error > 1e-4  # something was left out


def reaching() -> ds.Scene:
    rng = np.random.default_rng(5)
    return ds.Scene(0.2, lamps(rng, 40, ds.Windowed(ds.InverseSquare(), 0.9)))


def test_lights_of_finite_reach_are_left_out_unasked(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = reaching()
    exact = ds.render(GBUFFER, scene, MATERIAL, plain=True)
    near(ds.render(GBUFFER, scene, MATERIAL), exact)

    def program() -> str:
        return str(jax.make_jaxpr(lambda s: ds.render(GBUFFER, s, MATERIAL))(scene))

    assert "cumsum" in program()
    monkeypatch.setattr(image_module, "MANY", 1000)
    jax.clear_caches()
    assert "cumsum" not in program()


@pytest.mark.slow
@pytest.mark.parametrize("error", ["of render", "by mean_squared_error"])
def test_derivatives_are_those_of_all_lights(error: str) -> None:
    scene = reaching()
    target = GBUFFER.from_image(0.9 * ds.render(GBUFFER, scene, MATERIAL, plain=True))

    def loss(plain: bool) -> Callable[..., jax.Array]:
        def of(surface: Any, scene: ds.Scene, material: ds.Material) -> jax.Array:
            gbuffer = ds.GBuffer(GBUFFER.shape, *surface, index=GBUFFER.index)
            if error == "of render":
                image = ds.render(gbuffer, scene, material, plain=plain)
                return ((gbuffer.from_image(image) - target) ** 2).mean()
            return ds.mean_squared_error(gbuffer, scene, material, target, plain=plain)

        return of

    at = ((GBUFFER.normal, GBUFFER.viewer, GBUFFER.position), scene, MATERIAL)
    ours, plain = (jax.jit(jax.value_and_grad(loss(p), (0, 1, 2)))(*at) for p in (False, True))
    near(ours, plain)
    along = jax.tree.map(lambda x: jnp.cos(jnp.arange(x.size, dtype=x.dtype)).reshape(x.shape), at)
    ours, plain = (jax.jit(partial(jax.jvp, loss(p)))(at, along) for p in (False, True))
    near(ours, plain)


@pytest.mark.slow
@pytest.mark.parametrize("what", ["coefficients", "intensities"])
def test_what_is_zero_has_its_derivative(what: str) -> None:
    """At a start of 0 a light is dark, and its derivative is not."""
    scene, material = reaching(), ds.Material(kd=0.0, specular=ds.Phong(0.0, 20.0))
    if what == "intensities":
        material = MATERIAL
        scene = ds.Scene(
            0.2, tuple(ds.PointLight(x.position, 0.0, x.attenuation) for x in scene.lights)
        )

    def total(at: Any, plain: bool) -> jax.Array:
        return ds.render(GBUFFER, *at, plain=plain).sum()

    near(*(jax.jit(jax.grad(partial(total, plain=p)))((scene, material)) for p in (False, True)))


def test_normals_that_face_each_other_have_no_small_cone() -> None:
    """A cone of pi and one of pi are everything, not nothing: here light came from all over."""
    angle = np.where(np.arange(64) % 2, 0.7, -0.7)
    normal = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], -1)
    normal[:2] = 0, 0, -1
    gbuffer = ds.GBuffer.from_arrays(None, np.tile(normal, (2, 1, 1)))
    scene = ds.Scene(None, (ds.ParallelLight((np.sin(1.4), 0, np.cos(1.4))),) * 40)
    material = ds.Material(specular=ds.Phong(1.0, 32.0))
    exact = ds.render(gbuffer, scene, material, plain=True)
    assert exact.max() > 1
    np.testing.assert_allclose(
        ds.render(gbuffer, scene, material, tolerance=1e-3), exact, atol=2e-3
    )
    everything = Cone.around(Vec3.from_array(jnp.array([[0.0, 0, 1], [0, 0, -1], [0, 0, 1]])))
    assert smallest_cosine(everything, everything) == -1
    assert everything.wider_by(everything).cosine == -1


def test_nothing_to_see_and_nothing_that_lights() -> None:
    away = ds.OrthographicCamera(8, 8, 0.2, position=(9, 9, 9), target=(9, 9, 20))
    nothing = ds.gbuffer(ds.Sphere(), away)
    assert not ds.render(nothing, reaching(), MATERIAL, tolerance=0.1).any()
    assert not ds.render(nothing, reaching(), MATERIAL).any()
    large = ds.GBuffer.from_arrays(None, np.ones((160, 160, 3)))
    ambient = ds.Scene(ambient=1.0)
    for tolerance in (None, 0.1):
        image = ds.render(large, ambient, ds.Material(ka=0.25), tolerance=tolerance)
        np.testing.assert_array_equal(image, 0.25)
        error = ds.mean_squared_error(
            large, ambient, ds.Material(ka=0.25), image, tolerance=tolerance
        )
        assert error == 0


def test_it_nests_in_vmap() -> None:
    scene = reaching()
    strengths = jnp.array([0.5, 2.0])

    def image(k: jax.Array, plain: bool) -> jax.Array:
        lit = ds.Scene(
            0.2,
            tuple(ds.PointLight(x.position, k * x.intensity, x.attenuation) for x in scene.lights),
        )
        return ds.render(GBUFFER, lit, MATERIAL, plain=plain)

    near(*(jax.vmap(lambda k, p=p: image(k, p))(strengths) for p in (False, True)))


def test_nan_is_not_left_out() -> None:
    lights = reaching().lights
    bad = ds.PointLight(lights[3].position, jnp.array([jnp.nan, 1, 1]), lights[3].attenuation)
    image = ds.render(GBUFFER, ds.Scene(0.2, (*lights[:3], bad, *lights[4:])), MATERIAL)
    assert np.isnan(image).any()


def test_a_tolerance_is_one_number_and_not_negative() -> None:
    for wrong, message in ((-0.1, "cannot be negative"), ((0.1, 0.2), "give one number")):
        with pytest.raises(ds.BadInput, match=message):
            ds.render(GBUFFER, reaching(), MATERIAL, tolerance=wrong)  # type: ignore[arg-type]
