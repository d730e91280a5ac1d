"""The program that XLA is led to is the readable one: the same values and derivatives, to rounding.

Pages are made small, so that a small image has several, and the last one overlaps.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from registry import ATTENUATIONS, LOBES

import diffshade as ds
from diffshade.shading import image

CAMERA = ds.PerspectiveCamera(46, 44, 0.7, position=(0, 0.2, 4))
GBUFFER = ds.gbuffer(ds.Sphere(), CAMERA)
PLACES = ((0.5, 1.0, 2.5), (-1.5, 0.3, 2.0), (1.2, -0.8, 3.0))
MATERIAL = ds.Material(
    ka=(0.1, 0.2, 0.1), kd=(0.5, 0.4, 0.3), specular=ds.Phong(ks=0.4, shininess=12.0)
)
Planes = tuple[ds.Scene, ds.Material, Any, Any]


@pytest.fixture(autouse=True)
def small_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    jax.clear_caches()
    monkeypatch.setattr(image, "page_size", lambda *_: 400)
    monkeypatch.setattr(image, "FEW", 100)
    assert GBUFFER.pixel_count > 600


def scene(
    attenuation: Any = ATTENUATIONS["quadratic"], *, coloured: bool = True, lights: int = 3
) -> ds.Scene:
    colours: tuple[Any, ...] = ((0.9, 0.7, 0.5), (0.3, 0.6, 0.8), (0.5, 0.5, 0.4))
    return ds.Scene(
        ambient=0.2,
        lights=tuple(
            ds.PointLight(
                np.add(PLACES[k % 3], 0.1 * (k // 3)).tolist(),
                colours[k % 3] if coloured else 0.3 + 0.2 * (k % 3),
                attenuation,
            )
            for k in range(lights)
        ),
    )


def agree(led: Any, plain: Any, tolerance: float) -> None:
    """Every array of two trees, relative to the largest entry of each."""
    for a, b in zip(jax.tree.leaves(led), jax.tree.leaves(plain), strict=True):
        if a.dtype != jax.dtypes.float0:
            scale = np.abs(np.asarray(b)).max()
            np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * max(scale, 1e-3))


def rendered(plain: bool, material: ds.Material = MATERIAL) -> Callable[..., jax.Array]:
    def values(lit: ds.Scene, material: ds.Material, normal: Any, position: Any) -> jax.Array:
        g = ds.GBuffer(GBUFFER.shape, normal, GBUFFER.viewer, position, GBUFFER.index)
        return ds.render(g, lit, material, plain=plain)

    return values


def inputs(lit: ds.Scene, material: ds.Material = MATERIAL) -> Planes:
    return lit, material, GBUFFER.normal, GBUFFER.position


@pytest.mark.parametrize("coloured", [True, False])
@pytest.mark.parametrize("lights", [1, 3, 11])
def test_values(coloured: bool, lights: int, tolerance: float) -> None:
    lit = scene(coloured=coloured, lights=lights)
    led, plain = (ds.render(GBUFFER, lit, MATERIAL, plain=p) for p in (False, True))
    agree(led, plain, tolerance)
    kept = ds.keep_geometry(GBUFFER, lit, MATERIAL)
    agree(ds.render(kept, lit, MATERIAL), plain, tolerance)


@pytest.mark.slow
def test_many_lights_are_the_sum_of_each(tolerance: float) -> None:
    lit = ds.Scene(lights=scene(lights=40).lights)
    weights = jnp.asarray(np.random.default_rng(3).normal(size=(44, 46, 3)), float)

    @jax.jit
    def slope(lit: ds.Scene) -> Any:
        return jax.value_and_grad(lambda s: (weights * ds.render(GBUFFER, s, MATERIAL)).sum())(lit)

    value, gradient = slope(lit)
    each = [slope(ds.Scene(lights=light)) for light in lit.lights]
    agree(value, sum(v for v, _ in each), tolerance)
    agree(gradient.lights, tuple(g.lights[0] for _, g in each), 20 * tolerance)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "lobe"),  # each of both, though not each with each
    sorted({(law, "phong") for law in ATTENUATIONS} | {("quadratic", lobe) for lobe in LOBES}),
)
def test_reverse_mode_for_every_input(law: str, lobe: str, tolerance: float) -> None:
    material = ds.Material(ka=0.1, kd=0.5, specular=LOBES[lobe](ks=0.4, shininess=12.0))
    lit = scene(ATTENUATIONS[law], coloured=False, lights=2)
    weights = jnp.asarray(np.random.default_rng(1).normal(size=(44, 46, 1)), float)

    def total(plain: bool) -> Any:
        return jax.grad(lambda *a: (weights * rendered(plain)(*a)).sum(), argnums=(0, 1, 2, 3))(
            *inputs(lit, material)
        )

    agree(total(False), total(True), 20 * tolerance)


@pytest.mark.parametrize("moved", [(0,), (1,), (2,), (3,), (0, 1)])
def test_both_modes_for_what_is_perturbed(moved: tuple[int, ...], tolerance: float) -> None:
    at = inputs(scene())
    rng = np.random.default_rng(2)
    step = jax.tree.map(
        lambda x: jnp.asarray(rng.normal(size=x.shape), x.dtype), tuple(at[k] for k in moved)
    )

    def along(plain: bool) -> Any:
        def shade(*moving: Any) -> jax.Array:
            new = dict(zip(moved, moving, strict=True))
            return rendered(plain)(*(new.get(k, x) for k, x in enumerate(at)))

        value, tangent = jax.jvp(shade, tuple(at[k] for k in moved), step)
        return tangent, jax.vjp(shade, *(at[k] for k in moved))[1](value)

    agree(along(False), along(True), 20 * tolerance)


@pytest.mark.slow
def test_large_images_compute_again_what_small_ones_keep(
    monkeypatch: pytest.MonkeyPatch, tolerance: float
) -> None:
    from diffshade import pages

    lit = scene(lights=9)

    def slope(plain: bool) -> Any:
        return jax.grad(lambda m: (ds.render(GBUFFER, lit, m, plain=plain) ** 2).sum())(MATERIAL)

    plain = slope(True)
    agree(slope(False), plain, 20 * tolerance)
    monkeypatch.setattr(pages, "HELD", 0)
    jax.clear_caches()
    agree(slope(False), plain, 20 * tolerance)


def test_squared_error_and_its_derivatives(tolerance: float) -> None:
    lit = scene()
    observed = 0.8 * ds.render(GBUFFER, lit, MATERIAL) + 0.01
    kept = ds.keep_geometry(GBUFFER, lit, MATERIAL)

    def by_hand(material: ds.Material) -> jax.Array:
        difference = ds.render(GBUFFER, lit, material, plain=True) - observed
        return (GBUFFER.from_image(difference) ** 2).mean()

    value = jax.value_and_grad(by_hand)(MATERIAL)
    for surface in (GBUFFER, kept):
        for image_or_planes in (observed, GBUFFER.from_image(observed)):
            led = jax.value_and_grad(
                lambda m, s=surface, i=image_or_planes: ds.mean_squared_error(s, lit, m, i)
            )(MATERIAL)
            agree(led, value, 20 * tolerance)

    def everything(plain: bool) -> Any:
        def loss(*at: Any) -> jax.Array:
            lit, material, normal, position = at
            g = ds.GBuffer(GBUFFER.shape, normal, GBUFFER.viewer, position, GBUFFER.index)
            return ds.mean_squared_error(g, lit, material, observed, plain=plain)

        at = inputs(lit)
        step = jax.tree.map(jnp.ones_like, at)
        return jax.grad(loss, argnums=(0, 1, 2, 3))(*at), jax.jvp(loss, at, step)[1]

    agree(everything(False), everything(True), 20 * tolerance)


@pytest.mark.slow
def test_second_derivatives_and_batches(tolerance: float) -> None:
    lit = scene(coloured=False, lights=2)
    observed = 0.8 * ds.render(GBUFFER, lit, MATERIAL)

    def loss(x: jax.Array, plain: bool) -> jax.Array:
        material = ds.Material(kd=x[0], specular=ds.Phong(ks=x[1], shininess=x[2]))
        return ds.mean_squared_error(GBUFFER, lit, material, observed, plain=plain)

    def image_of(x: jax.Array, plain: bool) -> jax.Array:
        material = ds.Material(kd=x[0], specular=ds.Phong(ks=x[1], shininess=x[2]))
        return (ds.render(GBUFFER, lit, material, plain=plain) ** 2).sum()

    x = jnp.asarray([0.5, 0.4, 12.0])
    for f in (loss, image_of):
        for second in (jax.hessian(f), jax.jacrev(jax.jacrev(f))):
            agree(second(x, False), second(x, True), 50 * tolerance)
        many = jnp.stack([x, 1.1 * x])
        led, plain = (jax.vmap(jax.grad(f), (0, None))(many, p) for p in (False, True))
        agree(led, plain, 20 * tolerance)


def test_coefficients_that_are_maps(tolerance: float) -> None:
    ramp = jnp.linspace(0.1, 0.6, GBUFFER.pixel_count)[None]
    material = ds.Material(kd=ramp, specular=ds.Phong(ks=ramp, shininess=30 * ramp))

    def slope(plain: bool) -> Any:
        return jax.value_and_grad(
            lambda m: (ds.render(GBUFFER, scene(), m, plain=plain) ** 2).sum()
        )(material)

    agree(slope(False), slope(True), 20 * tolerance)


def test_kept_geometry_of_another_scene_is_refused() -> None:
    lit = scene()
    kept = ds.keep_geometry(GBUFFER, lit, MATERIAL)
    with pytest.raises(ds.BadInput, match=r"3 PointLight, 1 Phong, .* has 2 PointLight, 1 Phong:"):
        ds.render(kept, ds.Scene(lights=lit.lights[:2]), MATERIAL)
    for other in (ds.Material(kd=0.5), ds.Material(specular=ds.BlinnPhong(0.4, 12.0))):
        with pytest.raises(ds.BadInput, match="keep it for this scene and material"):
            ds.render(kept, lit, other)
    bare = ds.keep_geometry(GBUFFER, scene(None), MATERIAL)
    with pytest.raises(ds.BadInput, match="no distance to a light"):
        ds.render(bare, lit, MATERIAL)


def test_channels_that_differ_and_types_that_mix(tolerance: float) -> None:
    lit = scene()
    grey = jnp.full((44, 46, 1), 0.1)
    by_hand = (GBUFFER.from_image(ds.render(GBUFFER, lit, MATERIAL) - grey) ** 2).mean()
    for plain in (False, True):
        found = ds.mean_squared_error(GBUFFER, lit, MATERIAL, grey, plain=plain)
        assert float(found) == pytest.approx(float(by_hand), rel=20 * tolerance)
    half = jax.tree.map(
        lambda x: x.astype(jnp.float32) if jnp.issubdtype(x.dtype, jnp.floating) else x,
        (GBUFFER, lit, MATERIAL),
    )
    mixed = ds.Material(kd=0.5, specular=ds.Phong(ks=half[2].specular[0].ks, shininess=20.0))
    with jax.numpy_dtype_promotion("standard"):
        led, plain_ = (
            jax.value_and_grad(lambda m, p=p: ds.mean_squared_error(*half[:2], m, grey, plain=p))(
                mixed
            )
            for p in (False, True)
        )
    agree(led, plain_, 1e-4)


def test_an_array_as_long_as_the_foreground_is_no_plane(
    tolerance: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only what has the role of a plane is cut into pages: not a coefficient of P channels."""
    monkeypatch.setattr(image, "page_size", lambda *_: 32)
    monkeypatch.setattr(image, "FEW", 16)
    count = 40  # more than a page, and as many channels to compile
    many = ds.Material(kd=jnp.linspace(0.1, 0.9, count))
    lit = ds.Scene(lights=ds.ParallelLight((0, 0, 1)))
    part = ds.GBuffer.from_arrays(None, np.tile([0.0, 0.0, 1.0], (2, count // 2, 1)))
    led, plain = (ds.render(part, lit, many, plain=p) for p in (False, True))
    agree(led, plain, tolerance)


def test_an_image_of_another_size_is_refused() -> None:
    with pytest.raises(ds.BadInput, match=r"shape \(3, 4, 1\): give \[44, 46, C\]"):
        ds.mean_squared_error(GBUFFER, scene(), MATERIAL, jnp.zeros((3, 4, 1)))
