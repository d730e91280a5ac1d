"""How much memory shading needs, from the compiler's own plan: that of a page, whatever the image.

Sixteen coloured lights on a ball of 2,048 x 2,048, in float32. Nothing is run.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import pytest

import diffshade as ds
from diffshade.shading import image
from diffshade.shading.image import image_planes
from diffshade.shading.kept_geometry import KeptGeometry

pytestmark = pytest.mark.slow

SIZE = 2048
PIXELS = int(3.1416 * (SIZE / 2.2) ** 2)
MIB = 2**20
IMAGE = 12 * SIZE**2
"""Bytes of an image of three channels."""


def arguments() -> tuple[ds.GBuffer, ds.Scene, ds.Material]:
    """The shapes of a G-buffer, a scene and a material."""
    small = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(16, 16, 2.2))
    law = ds.QuadraticAttenuation(1.0, 0.1, 0.02)
    lights = (ds.PointLight((k / 4 - 2, 1, 2.5), (0.1, 0.2, 0.1), law) for k in range(16))
    scene = ds.Scene(0.2, tuple(lights))
    material = ds.Material(0.1, (0.5, 0.4, 0.3), ds.Phong(ks=0.4, shininess=12.0))

    def large(x: jax.Array) -> jax.ShapeDtypeStruct:
        single = jnp.float32 if jnp.issubdtype(x.dtype, jnp.floating) else x.dtype
        planes = x.shape == (small.pixel_count,)
        return jax.ShapeDtypeStruct((PIXELS,) if planes else x.shape, single)

    g = ds.GBuffer((SIZE, SIZE), small.normal, small.viewer, small.position, small.index)
    return jax.tree.map(large, (g, scene, material))


def temporary(f: Callable[..., Any], *inputs: Any) -> int:
    """Bytes beyond input and output."""
    program = jax.jit(f, compiler_options=ds.compiler_options()).lower(*inputs).compile()
    return program.memory_analysis().temp_size_in_bytes


@pytest.fixture(params=["one processor", "several"], autouse=True)
def page(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    from diffshade import fusion

    jax.clear_caches()
    monkeypatch.setattr(fusion, "processors", lambda: 1 if request.param == "one processor" else 2)
    assert image.page_size(4) == (2**14 if request.param == "one processor" else 2**15)


def test_an_image() -> None:
    """Rendered outermost, by two programs: the planes, and their places in the image."""
    g, scene, material = arguments()
    planes = (jax.ShapeDtypeStruct((PIXELS,), jnp.float32),) * 3
    shading = temporary(
        lambda g, s, m: image_planes(KeptGeometry(g, None), s, m, False), *arguments()
    )
    placing = 3 * 4 * PIXELS + temporary(ds.GBuffer.to_image, g, planes)
    assert shading <= 32 * MIB
    assert placing <= IMAGE + 32 * MIB
    assert temporary(ds.render, g, scene, material) <= IMAGE + 32 * MIB


def test_a_loss_and_its_gradient() -> None:
    """In coefficients and lights; beside planes, and beside an image, of which planes are made."""

    def step(g: Any, scene: Any, material: Any, observed: Any) -> Any:
        return jax.value_and_grad(ds.mean_squared_error, (1, 2))(g, scene, material, observed)

    planes, whole = ((3, PIXELS), (SIZE, SIZE, 3))
    observed = jax.ShapeDtypeStruct(planes, jnp.float32)
    assert temporary(step, *arguments(), observed) <= 32 * MIB
    observed = jax.ShapeDtypeStruct(whole, jnp.float32)
    assert temporary(step, *arguments(), observed) <= IMAGE + 32 * MIB


def test_a_gradient_in_every_plane() -> None:
    def step(g: Any, scene: Any, material: Any, observed: Any) -> Any:
        every = jax.value_and_grad(ds.mean_squared_error, (0, 1, 2), allow_int=True)
        return every(g, scene, material, observed)

    observed = jax.ShapeDtypeStruct((3, PIXELS), jnp.float32)
    gradient = 6 * 4 * PIXELS  # of positions and normals
    assert temporary(step, *arguments(), observed) <= gradient + 32 * MIB
