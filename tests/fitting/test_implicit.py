"""Derivatives of the solution of a fit, held against finite differences of that solution."""

from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import diffshade as ds
import fitting
from diffshade.errors import BadInput
from fitting import implicit

GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(24, 24, 2.2))
POSITION = np.array([0.8, 0.5, 2.5])
ELSEWHERE = np.array([-1.0, 0.8, 2.0])
TRUTH = ds.Material(ka=0.1, kd=(0.6, 0.4), specular=ds.Phong(ks=0.3, shininess=12.0))


def scene_at(position: jax.Array, strength: jax.Array | float = 1.0) -> ds.Scene:
    law = ds.QuadraticAttenuation(1.0, 0.1, 0.05)
    first = ds.PointLight(position, strength * jnp.array([1.0, 0.9]), law)
    return ds.Scene(ambient=0.5, lights=(first, ds.PointLight(ELSEWHERE, 0.7)))


SCENE = scene_at(jnp.asarray(POSITION))
NOISE = np.random.default_rng(3).normal(0, 0.02, (24, 24, 2))
IMAGE = np.asarray(ds.render(GBUFFER, SCENE, TRUTH))
# What the material does not explain: there Gauss and Newton's Hessian is not the true one.
NOISY = (IMAGE + NOISE).astype(IMAGE.dtype)


def numbers(material: ds.Material) -> jax.Array:
    return jnp.concatenate([jnp.atleast_1d(leaf) for leaf in jax.tree.leaves(material)])


def moved(t: jax.Array, image: np.ndarray = NOISY) -> tuple[jax.Array, ds.GBuffer, ds.Scene]:
    """A capture that moves with t: its image, a light's strength and position, the normals."""
    rng = np.random.default_rng(5)
    images = image + t[0] * rng.normal(0, 1, image.shape)
    normal = GBUFFER.normal
    bent = type(normal)(
        *(
            plane + t[3] * rng.normal(0, 0.1, plane.shape)
            for plane in (normal.x, normal.y, normal.z)
        )
    )
    length = jnp.sqrt(bent.x**2 + bent.y**2 + bent.z**2)
    unit = type(normal)(bent.x / length, bent.y / length, bent.z / length)
    scene = scene_at(POSITION + t[2] * jnp.array([0.5, -0.4, 0.3]), 1.0 + t[1])
    return images, replace(GBUFFER, normal=unit), scene


def check(f: Callable[[jax.Array], jax.Array], size: int) -> np.ndarray:
    """Assert that forward mode, reverse mode and the central difference agree at 0; the Jacobian."""
    zero = jnp.zeros(size)
    forward = np.asarray(jax.jit(jax.jacfwd(f))(zero))
    reverse = np.asarray(jax.jit(jax.jacrev(f))(zero))
    value, step = jax.jit(f), 1e-5
    finite = np.stack(
        [(value(step * e) - value(-step * e)) / (2 * step) for e in np.eye(size)], axis=1
    )
    scale = np.max(np.abs(forward), axis=1, keepdims=True, initial=1e-9)
    np.testing.assert_allclose(forward / scale, reverse / scale, rtol=0, atol=1e-10)
    # The search stops within 1e-8 of the minimum.
    np.testing.assert_allclose(forward / scale, finite / scale, rtol=0, atol=3e-6)
    return forward


@pytest.mark.slow
@pytest.mark.float64
def test_derivatives_are_those_of_finite_differences() -> None:
    """With respect to the image, a light's strength and position, and the normals."""
    found = check(lambda t: numbers(fitting.solve(*moved(t))), 4)
    assert np.all(np.abs(found) > 1e-6)


@pytest.mark.slow
@pytest.mark.float64
def test_what_is_held_moves_and_what_is_on_a_bound_does_not() -> None:
    """k_d of one channel is pressed against 1, k_s is held at a value that moves."""
    bright = ds.Material(ka=0.1, kd=(1.3, 0.4), specular=ds.Phong(ks=0.3, shininess=12.0))
    image = np.asarray(ds.render(GBUFFER, SCENE, bright)) + NOISE

    def f(t: jax.Array) -> jax.Array:
        start = ds.Material(ka=0.0, kd=0.5, specular=ds.Phong(ks=0.3 + t[4], shininess=20.0))
        captured = moved(t, image)
        return numbers(fitting.solve(*captured, material=start, hold=["specular.ks"]))

    ka, kd, ks, shininess = np.split(check(f, 5), (2, 4, 6))
    np.testing.assert_array_equal(kd[0], 0)
    np.testing.assert_array_equal(ks, [[0, 0, 0, 0, 1]] * 2)
    assert np.all(np.abs(np.concatenate([ka, kd[1:], shininess])) > 1e-6)


@pytest.mark.slow
@pytest.mark.float64
def test_a_bound_that_is_only_touched_counts_as_active() -> None:
    white = ds.Material(ka=0.1, kd=(1.0, 0.4), specular=ds.Phong(ks=0.3, shininess=12.0))
    image = ds.render(GBUFFER, SCENE, white)

    def kd(image: jax.Array) -> jax.Array:
        return fitting.solve(image, GBUFFER, SCENE).kd

    value, slope = jax.jvp(kd, (image,), (image,))
    np.testing.assert_allclose(value, (1.0, 0.4), rtol=1e-9)
    assert slope[0] == 0
    outside = (kd((1 + 1e-5) * image) - value) / 1e-5
    np.testing.assert_allclose(slope, outside, atol=1e-4)
    inside = (value - kd((1 - 1e-5) * image)) / 1e-5
    np.testing.assert_allclose(inside, (1.0, 0.4), atol=1e-4)


@pytest.mark.slow
@pytest.mark.float64
def test_derivatives_of_second_order() -> None:
    def shininess(position: jax.Array) -> jax.Array:
        return fitting.solve(NOISY, GBUFFER, scene_at(position)).specular[0].shininess

    slope, position, step = jax.jit(jax.jacrev(shininess)), jnp.asarray(POSITION), 1e-4
    hessian = jax.jit(jax.jacfwd(jax.jacrev(shininess)))(position)
    finite = [
        (slope(position + step * e) - slope(position - step * e)) / (2 * step) for e in np.eye(3)
    ]
    np.testing.assert_allclose(hessian, hessian.T, rtol=1e-9)
    np.testing.assert_allclose(
        hessian, finite, rtol=0, atol=1e-5 * float(jnp.max(jnp.abs(hessian)))
    )


@pytest.mark.slow
@pytest.mark.float64
def test_the_values_are_those_of_fit() -> None:
    def same(material: ds.Material, image: np.ndarray, **options: object) -> None:
        expected = fitting.fit(image, GBUFFER, SCENE, **options).material
        np.testing.assert_allclose(numbers(material), numbers(expected), rtol=1e-9)

    same(fitting.solve(NOISY, GBUFFER, SCENE), NOISY)
    same(jax.jit(fitting.solve)(jnp.asarray(NOISY), GBUFFER, SCENE), NOISY)
    bounds = {"specular.shininess": (15, 40), "kd": (0, 0.5)}
    same(fitting.solve(NOISY, GBUFFER, SCENE, bounds=bounds), NOISY, bounds=bounds)


@pytest.mark.slow
def test_captures_are_a_batch() -> None:
    """`vmap` over images, and over images with a scene each, equals a loop."""
    images = np.stack([IMAGE, NOISY, 0.5 * NOISY])
    positions = jnp.asarray(POSITION + np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.2, 0.1]]))
    positions = positions.astype(GBUFFER.normal.x.dtype)

    def recovered(image: jax.Array, position: jax.Array) -> jax.Array:
        return numbers(fitting.solve(image, GBUFFER, scene_at(position)))

    batch = jax.jit(jax.vmap(recovered))(jnp.asarray(images), positions)
    alone = [recovered(*each) for each in zip(images, positions, strict=True)]
    exact = jax.config.jax_enable_x64
    np.testing.assert_allclose(batch, np.stack(alone), rtol=1e-8 if exact else 2e-3)


@pytest.mark.slow
def test_several_images_and_their_masks(rng: np.random.Generator) -> None:
    """What lies outside a mask reaches neither value nor derivative, NaN included."""
    scenes = (SCENE, scene_at(jnp.asarray(ELSEWHERE)))
    pair = [np.array(ds.render(GBUFFER, scene, TRUTH)) for scene in scenes]
    valid = rng.uniform(size=(24, 24)) < 0.7
    pair[1][~valid] = np.nan

    @jax.jit
    def shininess(first: jax.Array, second: jax.Array, valid: jax.Array) -> jax.Array:
        material = fitting.solve([first, second], GBUFFER, scenes, valid=valid)
        return material.specular[0].shininess

    value, slopes = jax.value_and_grad(shininess, argnums=(0, 1))(*pair, valid)
    np.testing.assert_allclose(value, 12.0, rtol=1e-8 if jax.config.jax_enable_x64 else 1e-3)
    for slope in slopes:
        assert np.isfinite(slope).all()
        assert np.any(slope[valid] != 0)
        np.testing.assert_array_equal(slope[~valid], 0)


@pytest.mark.slow
def test_one_program_serves_all_images(monkeypatch: pytest.MonkeyPatch) -> None:
    traced = []
    search = implicit.search
    monkeypatch.setattr(implicit, "search", lambda *args: traced.append(1) or search(*args))
    half = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(13, 13, 2.2))  # of no other test
    for k in (1.0, 0.8, 0.6):
        scene = scene_at(k * jnp.asarray(POSITION))
        fitting.solve(ds.render(half, scene, TRUTH), half, scene)
    assert len(traced) == 1


@pytest.mark.slow
def test_what_images_do_not_tell_has_derivative_zero() -> None:
    """The shininess where k_s is held at 0; k_a and k_d on a plane, where both are one picture."""
    start = ds.Material(ka=0.1, kd=0.5, specular=ds.Phong(ks=0.0, shininess=20.0))

    def matte(image: jax.Array) -> ds.Material:
        return fitting.solve(image, GBUFFER, SCENE, material=start, hold=["specular.ks"])

    _, slope = jax.jvp(matte, (jnp.asarray(NOISY),), (jnp.asarray(NOISY),))
    assert slope.specular[0].shininess == 0
    assert np.all(slope.kd > 0.1)
    wall = ds.GBuffer.from_arrays(None, np.broadcast_to((0.0, 0.0, 1.0), (8, 8, 3)))
    light = ds.Scene(ambient=1.0, lights=ds.ParallelLight((0.0, 0.6, 0.8)))

    def told(image: jax.Array) -> jax.Array:
        found = fitting.solve(image, wall, light, material=ds.Material(ka=0.1, kd=0.5))
        assert found.ka is not None
        assert found.kd is not None
        return found.ka + 0.8 * found.kd

    image = ds.render(wall, light, ds.Material(ka=0.1, kd=0.5))
    value, slope = jax.jvp(told, (image,), (image,))
    np.testing.assert_allclose((value, slope), 0.5, rtol=1e-5)


@pytest.mark.float64
def test_singular_directions_do_not_move() -> None:
    """Of H x = y the least x, in units of curvature, that solves what is told; its edge kept."""
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(5, 3)) * np.array([1e3, 1.0, 1e-3])
    rows = np.concatenate([rows, rows[:, :1] * 2, rng.normal(size=(5, 1))], axis=1)
    matrix = rows.T @ rows
    matrix[4] = np.eye(5)[4]  # on its edge, which moves by 2
    right = np.append(matrix[:4, :4] @ rng.normal(size=4), 2.0)
    step = implicit._step(
        jnp.asarray(matrix), jnp.asarray(right), jnp.asarray([True] * 4 + [False]), jnp.zeros(())
    )
    np.testing.assert_allclose(matrix @ step, right, rtol=1e-7)
    np.testing.assert_allclose(step[0], 2 * step[3], rtol=1e-7)  # one picture, shared
    assert step[4] == 2


@pytest.mark.slow
@pytest.mark.float64
def test_single_precision() -> None:
    """The derivative by the light's position, against that in double precision."""

    def slope(dtype: np.dtype) -> np.ndarray:
        cast = jax.tree.map(lambda x: x.astype(dtype) if x.dtype == np.float64 else x, GBUFFER)

        def f(position: jax.Array) -> jax.Array:
            light = ds.PointLight(position, jnp.asarray(1.0, dtype))
            scene = ds.Scene(jnp.asarray(0.5, dtype), light)
            return numbers(fitting.solve(NOISY.astype(dtype), cast, scene))

        return np.asarray(jax.jit(jax.jacfwd(f))(jnp.asarray(POSITION, dtype)))

    with jax.numpy_dtype_promotion("standard"):  # constants of 64 bits meet numbers of 32
        single = slope(np.dtype(np.float32))
    double = slope(np.dtype(np.float64))
    scale = np.max(np.abs(double), axis=1, keepdims=True)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single / scale, double / scale, rtol=0, atol=2e-3)


def test_refusals() -> None:
    with pytest.raises(BadInput, match="hold names kd and no material"):
        fitting.solve(IMAGE, GBUFFER, SCENE, hold=["kd"])
    with pytest.raises(BadInput, match="sizes must match"):
        jax.eval_shape(lambda y: fitting.solve(y, GBUFFER, SCENE), jnp.zeros((8, 8, 3)))
    with pytest.raises(BadInput, match=r"\[1, 3\] channels"):
        jax.eval_shape(
            lambda y: fitting.solve([y, y[..., 0]], GBUFFER, SCENE), jnp.zeros((24, 24, 3))
        )
    with pytest.raises(BadInput, match="valid mask of image 0"):
        jax.eval_shape(
            lambda y: fitting.solve(y, GBUFFER, SCENE, valid=np.ones((3, 3))),
            jnp.zeros((24, 24, 3)),
        )
