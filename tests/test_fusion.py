"""What XLA makes of the led program, from its own analysis of what it compiled.

The counts hold for the versions of JAX that they were made with; on a newer one a difference is a
warning that the module needs another look, not a failure.
"""

import re
import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import diffshade as ds
from diffshade import fusion
from diffshade.fusion import Node, keeping, kept, packed, stored
from diffshade.shading import image
from diffshade.shading.kept_geometry import KeptGeometry

MADE_WITH = ((0, 10), (0, 11), (0, 12))
GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(200, 200, 2.2))
PIXELS = GBUFFER.pixel_count
MATERIAL = ds.Material(ka=0.1, kd=(0.5, 0.4, 0.3), specular=ds.Phong(ks=0.4, shininess=12.0))


def scene(lights: int, coloured: bool = True) -> ds.Scene:
    law = ds.QuadraticAttenuation(1.0, 0.1, 0.02)
    return ds.Scene(
        0.2,
        tuple(
            ds.PointLight((k - 1.5, 1.0, 2.5), (0.4, 0.3, 0.2) if coloured else 0.3, law)
            for k in range(lights)
        ),
    )


def compiled(f: Any, *arguments: Any) -> Any:
    jax.clear_caches()
    return jax.jit(f, compiler_options=ds.compiler_options()).lower(*arguments).compile()


def cost(program: Any) -> dict[str, float]:
    analysis = program.cost_analysis()
    return analysis[0] if isinstance(analysis, list) else analysis


def expect(holds: bool, what: str) -> None:
    """Fails with the versions that the counts were made with; warns on others."""
    version = tuple(int(part) for part in jax.__version__.split(".")[:2])
    if holds or version in MADE_WITH:
        assert holds, what
        return
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.warn(f"JAX {jax.__version__}: {what}", stacklevel=2)


def fast(plain: bool) -> Any:
    return lambda g, s, m: image.image_planes(KeptGeometry(g, None), s, m, plain)


def test_one_pass_computes_a_logarithm_and_a_power_once() -> None:
    """Per pixel and light: a root, a logarithm, an exponential; XLA alone does so in every channel."""
    if not fusion.is_led():
        pytest.skip("the program is led on CPUs")
    for coloured in (True, False):
        arguments = (GBUFFER, scene(3, coloured), MATERIAL)
        led, plain = (cost(compiled(fast(p), *arguments))["transcendentals"] for p in (False, True))
        expect(
            led <= 3.2 * 3 * PIXELS, f"{led / PIXELS:.1f} transcendentals a pixel of three lights"
        )
        assert plain > 0


def test_work_and_memory_in_proportion_to_lights(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond input, output and an output-sized buffer memory is that of a page."""
    monkeypatch.setattr(image, "page_size", lambda: 2048)
    temporary = []
    for lights in (4, 16):
        program = compiled(fast(False), GBUFFER, scene(lights), MATERIAL)
        temporary.append(program.memory_analysis().temp_size_in_bytes)
    page = 2048 * GBUFFER.normal.x.dtype.itemsize
    # a carry of the three planes, and some twenty planes of a page
    limit = 3 * PIXELS * GBUFFER.normal.x.dtype.itemsize + 40 * page
    assert max(temporary) <= limit, temporary


def test_absent_terms_save_the_flops_that_they_cost() -> None:
    """The compiler's own count of a term's flops, alone and in company, within 5 %."""

    def flops(material: ds.Material, law: Any = None) -> float:
        light = ds.PointLight((0.5, 1.0, 2.5), 0.3, law)
        return cost(compiled(fast(True), GBUFFER, ds.Scene(0.2, light), material))["flops"] / PIXELS

    specular = ds.Phong(ks=0.4, shininess=12.0)
    diffuse = flops(ds.Material(kd=0.5))
    both = flops(ds.Material(kd=0.5, specular=specular))
    with_ambient = flops(ds.Material(ka=0.1, kd=0.5, specular=specular))
    assert with_ambient - both == pytest.approx(1, abs=0.05 * both)
    assert both > 1.5 * diffuse
    law = ds.QuadraticAttenuation(1.0, 0.1, 0.02)
    # d = |s|^2 / |s|; c0 + d (c1 + d c2); the clamp's comparison and selection; the quotient with its
    # guard of three; f n.l
    added = flops(ds.Material(kd=0.5), law) - diffuse
    expect(abs(added - 12) <= 0.05 * 12, f"an attenuation costs {added:.1f} flops")


def test_stored_is_computed_once() -> None:
    x = jnp.linspace(0.1, 1, 4096)

    def readers(y: jax.Array) -> Any:
        return y.sum(), (y * x).sum(), (y * y).sum()

    once = compiled(lambda x: readers(stored(jnp.exp, x)), x)
    expect(cost(once)["transcendentals"] <= 4096, "an exponential is computed for each reader")
    np.testing.assert_allclose(once(x)[0], jnp.exp(x).sum(), rtol=1e-5)


def test_packed_is_a_tree_of_planes() -> None:
    x = jnp.linspace(0.1, 1, 32)
    tree = packed(lambda x: {"a": x, "b": (2 * x, None, x * x)}, x)
    np.testing.assert_array_equal(tree["b"][2], x * x)
    assert tree["b"][1] is None
    assert tree["a"].dtype == x.dtype


@Node
def cube(x: jax.Array) -> jax.Array:
    """x^3"""
    return x * x * x


@cube.derivative
def _(y: jax.Array, planes: Any, tangents: Any) -> jax.Array:
    return 3 * y / planes[0] * tangents[0]


def test_nodes_are_plain_functions_unless_they_are_kept(tolerance: float) -> None:
    x = jnp.linspace(0.5, 1.5, 16)

    def f(x: jax.Array) -> jax.Array:
        return kept(lambda x: jnp.sin(x) * cube(2 * x), x)

    assert "cond" not in str(jax.make_jaxpr(f)(x))
    assert "cond" in str(jax.make_jaxpr(keeping(f))(x))
    by_hand = jnp.cos(x) * 8 * x**3 + jnp.sin(x) * 24 * x**2
    first = jax.vmap(jax.grad(f))(x)
    np.testing.assert_allclose(first, by_hand, rtol=10 * tolerance)
    led = jax.grad(lambda x: keeping(f)(x).sum())(x)
    np.testing.assert_allclose(led, by_hand, rtol=10 * tolerance)
    second = jax.jvp(jax.grad(lambda x: keeping(f)(x).sum()), (x,), (jnp.ones_like(x),))[1]
    again = jnp.sin(x) * (48 * x - 8 * x**3) + jnp.cos(x) * 48 * x**2
    np.testing.assert_allclose(second, again, rtol=50 * tolerance)


def test_compile_time_does_not_grow_with_lights() -> None:
    sizes = [
        len(re.findall("\n", jax.jit(fast(False)).lower(GBUFFER, scene(n), MATERIAL).as_text()))
        for n in (8, 64)
    ]
    assert sizes[1] < 2 * sizes[0], sizes  # arguments alone grow
