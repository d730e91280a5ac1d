"""Transparent surfaces: stacks in closed form, whole images against every hit, sorted and added up."""

from collections import Counter
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from every_hit import every_hit
from gradients import check_gradients, dead_inputs
from test_absent_parts import equations

import diffshade as ds
from diffshade.shading.transparency import render_layers

CAMERA = ds.OrthographicCamera(16, 12, 3.0)
LIGHT = ds.ParallelLight((0.3, -0.4, 1.0), (0.9, 0.8, 0.7))
SCENE = ds.Scene(ambient=0.5, lights=LIGHT)


def sheet(z, size=1.0):
    square = size * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + np.array([0, 0, z])
    return ds.Mesh(square, [[0, 1, 2], [0, 2, 3]])


def glow(*colour):
    """What is as bright as its ambient coefficient says."""
    return ds.Material(ka=colour)


GLOW = ds.Scene(ambient=1.0)
STACK = ds.layers([sheet(z, 3.0) for z in (0.3, 0.2, 0.1, 0.0)], CAMERA)
COLOURS = np.random.default_rng(2).uniform(size=(4, 3))


@pytest.mark.parametrize("kt", [0.0, 0.3, 1.0])
def test_a_stack_of_equal_interpolated_sheets(kt: float, tolerance: float) -> None:
    """I = sum_i (1 - k) k^i I_i + k^4 I_b."""
    sheets = [glow(*c) for c in COLOURS]
    image = render_layers(
        STACK, GLOW, sheets, [ds.InterpolatedTransparency(kt)] * 4, (0.1, 0.2, 0.7)
    )
    expected = sum((1 - kt) * kt**i * COLOURS[i] for i in range(4))
    expected = expected + kt**4 * np.array([0.1, 0.2, 0.7])
    np.testing.assert_allclose(image, np.broadcast_to(expected, (12, 16, 3)), rtol=10 * tolerance)


def test_a_stack_of_equal_filters(tolerance: float) -> None:
    """I = sum_i (k O)^i I_i + (k O)^4 I_b."""
    sheets, filter_ = [glow(*c) for c in COLOURS], np.array([0.9, 0.5, 0.1])
    kinds = [ds.FilteredTransparency(0.8, filter_)] * 4
    image = render_layers(STACK, GLOW, sheets, kinds, np.ones((12, 16, 3)))
    expected = sum((0.8 * filter_) ** i * COLOURS[i] for i in range(4)) + (0.8 * filter_) ** 4
    np.testing.assert_allclose(image, np.broadcast_to(expected, (12, 16, 3)), rtol=10 * tolerance)


def test_two_sheets_by_hand(tolerance: float) -> None:
    """A filter over an interpolated sheet over an opaque one, which hides what is behind."""
    kinds = [
        ds.FilteredTransparency(0.5, (1, 0.4, 0)),
        ds.InterpolatedTransparency(0.25),
        None,
        None,
    ]
    sheets = [glow(0.1, 0.1, 0.1), glow(0.4, 0.8, 0.4), glow(0.8, 0.0, 0.4), glow(9, 9, 9)]
    image = render_layers(STACK, GLOW, sheets, kinds, 9.0)
    inner = 0.75 * np.array([0.4, 0.8, 0.4]) + 0.25 * np.array([0.8, 0.0, 0.4])
    expected = 0.1 + np.array([0.5, 0.2, 0.0]) * inner
    np.testing.assert_allclose(image[5, 7], expected, rtol=10 * tolerance)


def soup() -> ds.Mesh:
    """Triangles that share nothing and pass through each other."""
    rng = np.random.default_rng(5)
    vertices = rng.normal(size=(30, 1, 3)) + 0.6 * rng.normal(size=(30, 3, 3))
    slot = np.arange(30) % 2
    return ds.Mesh(vertices.reshape(-1, 3), np.arange(90).reshape(-1, 3), slot=slot)


MIXED = [soup(), ds.Sphere((0.2, 0.1, 0), 0.8), ds.Sphere((-0.4, 0.3, 0.2), 0.7)]
"""They pass through each other."""
KD = ((0.7, 0.2, 0.1), (0.1, 0.6, 0.3), (0.2, 0.3, 0.8), (0.5, 0.5, 0.1))
KINDS = (
    [ds.InterpolatedTransparency((0.4, 0.5, 0.6)), None],
    ds.FilteredTransparency(0.9, (0.3, 0.9, 0.7)),
    ds.InterpolatedTransparency(0.7),
)
BACKGROUND = np.random.default_rng(3).uniform(size=(12, 16, 3))


@pytest.mark.float64
@pytest.mark.parametrize("count", [1, 2, None])
def test_interpenetrating_objects_against_every_hit(count: int | None) -> None:
    materials = [
        [ds.Material(ka=0.1, kd=kd) for kd in KD[:2]],
        *(ds.Material(kd=kd) for kd in KD[2:]),
    ]
    # Of one form in one object; in several they differ
    layers = ds.layers(MIXED, CAMERA, count)
    image = np.asarray(render_layers(layers, SCENE, materials, KINDS, BACKGROUND))

    hits = every_hit(MIXED, CAMERA)
    kind = np.where(hits.owner == 0, hits.face % 2, hits.owner + 1)
    towards = np.asarray(LIGHT.direction) / np.linalg.norm(LIGHT.direction)
    cosine = np.maximum(hits.normal @ towards, 0)
    light = np.asarray(LIGHT.intensity) * cosine[:, None] * np.array(KD)[kind]
    front = light + np.where(kind < 2, 0.5 * 0.1, 0)[:, None]
    of_front = np.array([(0.6, 0.5, 0.4), (1, 1, 1), (1, 1, 1), (0.3, 0.3, 0.3)])[kind]
    of_behind = np.array([(0.4, 0.5, 0.6), (0, 0, 0), (0.27, 0.81, 0.63), (0.7, 0.7, 0.7)])[kind]
    expected = BACKGROUND.reshape(-1, 3).copy()
    for pixel in range(expected.shape[0]):
        for k in np.flatnonzero(hits.pixel == pixel)[:count][::-1]:
            expected[pixel] = of_front[k] * front[k] + of_behind[k] * expected[pixel]
    assert np.bincount(hits.pixel).max() >= 5
    np.testing.assert_allclose(image.reshape(-1, 3), expected, atol=1e-12)


GLASS = ds.Material(ka=0.1, kd=(0.5, 0.4, 0.3), specular=ds.Phong(0.5, 20.0))
WALL = ds.Material(kd=(0.2, 0.6, 0.9))
OBJECTS = [ds.Sphere(radius=0.9), sheet(-1.0)]
LAYERS = ds.layers(OBJECTS, CAMERA)


def test_where_all_is_opaque_the_nearest_is_rendered(tolerance: float) -> None:
    """Without a transparency, and with k_t = 0."""
    ball = ds.render(LAYERS[0][0], SCENE, GLASS)
    plain = np.where(LAYERS[0][0].mask[..., None], ball, ds.render(LAYERS[0][1], SCENE, WALL))
    np.testing.assert_allclose(
        ball, ds.render(ds.gbuffer(OBJECTS[0], CAMERA), SCENE, GLASS), atol=10 * tolerance
    )
    nothing = ds.InterpolatedTransparency(0.0), ds.FilteredTransparency(0.0, (1, 1, 1))
    for kinds in (None, [None, None], [nothing[0], None], nothing):
        image = render_layers(LAYERS, SCENE, [GLASS, WALL], kinds)
        np.testing.assert_allclose(image, plain, atol=10 * tolerance)


def test_where_all_is_transparent_the_background_is_seen(tolerance: float) -> None:
    image = render_layers(
        LAYERS, SCENE, [GLASS, WALL], [ds.InterpolatedTransparency(1.0)] * 2, BACKGROUND
    )
    np.testing.assert_allclose(image, BACKGROUND, atol=10 * tolerance)


def program(layers: object, *arguments: object) -> Counter[str]:
    """How often each primitive computes more than a few numbers."""
    traced = jax.make_jaxpr(render_layers)(layers, SCENE, *arguments).jaxpr
    return Counter(e.primitive.name for e in equations(traced) if e.outvars[0].aval.size > 20)


def test_what_is_behind_the_opaque_is_not_in_the_program() -> None:
    (near, _), *_ = LAYERS
    plain = jax.make_jaxpr(ds.render)(near, SCENE, GLASS).jaxpr
    as_plain = Counter(e.primitive.name for e in equations(plain) if e.outvars[0].aval.size > 20)
    ball = [layer[:1] for layer in LAYERS]
    assert program(ball, GLASS) == program(ball[:1], GLASS, [None]) == as_plain
    transparent = program(ball, GLASS, ds.InterpolatedTransparency(0.5))
    assert transparent["concatenate"] > as_plain["concatenate"]
    both = program(LAYERS, [GLASS, WALL])
    assert both == program(LAYERS[:1], [GLASS, WALL])
    assert (
        both["concatenate"]
        == program([layer[1:] for layer in LAYERS], WALL)["concatenate"] + (as_plain["concatenate"])
    )


def test_a_program_does_not_depend_on_what_is_nested(tolerance: float) -> None:
    kinds = [ds.InterpolatedTransparency(0.4), None]
    outermost = render_layers(LAYERS, SCENE, [GLASS, WALL], kinds, 0.3)
    nested = jax.jit(render_layers)(LAYERS, SCENE, [GLASS, WALL], kinds, 0.3)
    np.testing.assert_allclose(outermost, nested, atol=10 * tolerance)
    assert outermost.shape == (12, 16, 3)


@pytest.mark.slow
@pytest.mark.float64
def test_every_derivative() -> None:
    """By both transparencies, materials, lights and the background: forward, reverse, differences."""
    camera = ds.OrthographicCamera(3, 2, 1.5)
    layers = ds.layers([ds.Sphere(radius=0.9), sheet(0.1), sheet(-1.5)], camera)
    assert len(layers) == 4

    def image(case: dict[str, jax.Array]) -> jax.Array:
        kinds = [
            ds.InterpolatedTransparency(case["kt"]),
            ds.FilteredTransparency(case["kf"], case["colour"]),
            ds.InterpolatedTransparency(case["kw"]),
        ]
        glass = ds.Material(kd=case["kd"], specular=ds.Phong(case["ks"], case["shininess"]))
        matt = ds.Material(ka=case["ka"])
        scene = ds.Scene(case["ambient"], ds.PointLight(case["place"], case["intensity"]))
        return render_layers(layers, scene, [glass, matt, matt], kinds, case["background"])

    case = {
        "kt": 0.3,
        "kf": (0.6, 0.7),
        "kw": 0.8,
        "colour": (0.4, 0.9),
        "kd": (0.5, 0.6),
        "ks": 0.4,
        "shininess": 7.0,
        "ka": (0.1, 0.3),
        "ambient": 0.6,
        "place": (1.0, 2.0, 4.0),
        "intensity": (0.9, 1.1),
        "background": (0.2, 0.5),
    }
    (largest,) = check_gradients(image, [jax.tree.map(jnp.asarray, case, is_leaf=is_numbers)])
    assert dead_inputs(largest) == []


def is_numbers(x: object) -> bool:
    return isinstance(x, tuple)


@pytest.mark.slow
@pytest.mark.float64
def test_derivatives_by_the_geometry() -> None:
    """A sphere before a sheet, both moved, at fixed visibility."""
    camera = ds.PerspectiveCamera(4, 3, 0.3, position=(0.3, 0.2, 5.0))
    peeled = ds.peel([ds.Sphere(), sheet(-1.5)], camera)
    kinds = [ds.InterpolatedTransparency(0.6), None]
    scene = ds.Scene(lights=ds.PointLight((2.0, 1.0, 4.0), 20.0, ds.InverseSquare()))
    materials = [ds.Material(kd=0.5), ds.Material(kd=0.8)]

    @jax.jit
    def total(center: jax.Array, vertices: jax.Array) -> jax.Array:
        objects = [ds.Sphere(center), ds.Mesh(vertices, sheet(0).faces)]
        layers = ds.layers(objects, camera, visibility=peeled)
        return jnp.sum(render_layers(layers, scene, materials, kinds) ** 2)

    at = jnp.zeros(3), sheet(-1.5).vertices
    rng = np.random.default_rng(4)
    moves = tuple(jnp.asarray(rng.normal(size=x.shape)) for x in at)
    forward = jax.jvp(total, at, moves)[1]
    reverse = sum(
        jnp.vdot(x, m) for x, m in zip(jax.grad(total, argnums=(0, 1))(*at), moves, strict=True)
    )
    step = 1e-4
    lower, upper = (
        total(*(x + h * m for x, m in zip(at, moves, strict=True))) for h in (-step, step)
    )
    np.testing.assert_allclose(reverse, forward, rtol=1e-11)
    np.testing.assert_allclose((upper - lower) / (2 * step), forward, rtol=1e-5)


def test_nothing_to_be_seen_is_the_background() -> None:
    away = ds.layers(ds.Sphere((50, 0, 0)), CAMERA)
    image = render_layers(away, SCENE, GLASS, ds.InterpolatedTransparency(0.5), BACKGROUND)
    np.testing.assert_allclose(image, BACKGROUND, rtol=1e-6)
    assert not np.asarray(render_layers(away, SCENE, GLASS)).any()


both = partial(render_layers, LAYERS, SCENE)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: both(GLASS), "materials are given for 1 objects of 2"),
        (
            lambda: both([GLASS, WALL], ds.InterpolatedTransparency(0.5)),
            "transparencies are given for 1 objects of 2",
        ),
        (
            lambda: both([GLASS, WALL], [None, [None, ds.InterpolatedTransparency(0.5)]]),
            "2 transparencies for an object of 1 materials",
        ),
        (
            lambda: both([GLASS, WALL], [None, ds.InterpolatedTransparency((0.1, 0.2))]),
            "2 channels meet 3",
        ),
        (
            lambda: both([GLASS, WALL], None, np.ones((3, 3, 3))),
            r"give one number, one a channel, or",
        ),
        (lambda: both([GLASS, WALL], None, (0.1, 0.2)), "2 channels meet 3"),
        (lambda: render_layers([], SCENE, GLASS), "the layers have not one G-buffer an object"),
        (
            lambda: render_layers([LAYERS[0], LAYERS[1][:1]], SCENE, [GLASS, WALL]),
            "the layers have not one G-buffer an object",
        ),
        (
            lambda: render_layers(
                [
                    *ds.layers(ds.Sphere(), CAMERA),
                    *ds.layers(ds.Sphere(), ds.OrthographicCamera(4, 4, 3)),
                ],
                SCENE,
                GLASS,
            ),
            "the layers are of different sizes",
        ),
        (
            lambda: render_layers(
                [[ds.gbuffer(OBJECTS[1], CAMERA, shading=ds.FlatShading())]] * 2,
                SCENE,
                WALL,
                ds.InterpolatedTransparency(0.5),
            ),
            "shaded once a face or vertex",
        ),
        (
            lambda: render_layers(
                LAYERS,
                ds.Scene(lights=ds.shadowed(LIGHT, LAYERS[0][0], OBJECTS[1])),
                [GLASS, WALL],
            ),
            "a light has the shadows on one G-buffer",
        ),
        (lambda: ds.InterpolatedTransparency(1.5), "kt is 1.5: give a part of the light, 0 to 1"),
        (lambda: ds.FilteredTransparency(0.5, (0.5, -1)), r"colour is \[0.5, -1.0\]: give a part"),
        (lambda: ds.InterpolatedTransparency(np.ones((3, 4))), "kt has shape"),
        (lambda: ds.FilteredTransparency((0.1, 0.2), (0.1, 0.2, 0.3)), "2 channels meet 3"),
    ],
)
def test_what_is_refused(call, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ds.BadInput, match=message) as refusal:
        call()
    assert "\n" not in str(refusal.value)
