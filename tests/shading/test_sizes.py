"""Images of a hundred sizes share the programs of a few buckets, and none of them tells."""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from compilations import compilations

import diffshade as ds
from diffshade.buckets import bucket
from diffshade.shading import image

SIZES = [(60 + k % 10, 60 + k // 10) for k in range(100)]
SCENE = ds.Scene(
    ambient=0.2,
    lights=(
        ds.PointLight((1.0, 2.0, 3.0), (0.9, 0.7, 0.5), ds.QuadraticAttenuation(0.7, 0.1, 0.05)),
        ds.ParallelLight((0.2, 0.1, 1.0), 0.4),
    ),
)
MATERIAL = ds.Material(ka=0.1, kd=(0.5, 0.4, 0.3), specular=ds.Phong(ks=0.4, shininess=12.0))
TWO = (MATERIAL, ds.Material(ka=0.3, kd=0.6, specular=ds.Phong(0.1, 40.0)))
BALL = trimesh.creation.icosphere(subdivisions=2)
MESH = ds.Mesh(BALL.vertices, BALL.faces)
SLOTS = ds.Mesh(MESH.vertices, MESH.faces, slot=np.arange(len(MESH.faces)) % 2)
MESHES = {
    "mesh": (MESH, ds.PhongShading()),
    "flat": (MESH, ds.FlatShading()),
    "gouraud": (MESH, ds.GouraudShading()),
    "slots": (SLOTS, ds.PhongShading()),
}


@cache
def surfaces(kind: str) -> list[ds.GBuffer]:
    """One of each size."""
    return [surface(kind, width, height) for width, height in SIZES]


def surface(kind: str, width: int, height: int) -> ds.GBuffer:
    """What a camera of a size sees."""
    camera = ds.PerspectiveCamera(width, height, 0.4 + 0.005 * width, position=(0.0, 0.2, 4.0))
    if kind in MESHES:
        mesh, shading = MESHES[kind]
        return ds.gbuffer(mesh, camera, shading=shading)
    if kind == "sphere":
        return ds.gbuffer(ds.Sphere(), camera)
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    position = np.stack([x, y, 0.2 * x * y], axis=-1)
    return ds.GBuffer.from_arrays(position, position + np.array([0.0, 0.0, 2.0]), eye=(0, 0, 4))


def picture(g: ds.GBuffer) -> jax.Array:
    rows = np.linspace(0, 1, 3 * g.shape[0] * g.shape[1]).reshape(*g.shape, 3)
    return jnp.asarray(rows, g.normal.x.dtype)


def maps(g: ds.GBuffer) -> ds.Material:
    ramp = np.linspace(0.1, 0.6, g.pixel_count, dtype=g.normal.x.dtype)[None]
    return ds.Material(kd=ramp, specular=ds.Phong(ks=2 * ramp, shininess=30 * ramp))


Call = tuple[Callable[..., Any], tuple[Any, ...]]


def terms(g: ds.GBuffer) -> Call:
    material = ds.Material(kd=np.asarray(g.from_image(picture(g))))
    return ds.contract, (ds.basis(g, SCENE, material), material)


def of_kept(g: ds.GBuffer) -> Call:
    return ds.render, (ds.keep_geometry(g, SCENE, MATERIAL), SCENE, MATERIAL)


def error_of_kept(g: ds.GBuffer) -> Call:
    kept = ds.keep_geometry(g, SCENE, MATERIAL)
    return ds.mean_squared_error, (kept, SCENE, MATERIAL, g.from_image(picture(g)))


def plainly(g: ds.GBuffer, image: jax.Array) -> Any:
    error = ds.mean_squared_error(g, SCENE, MATERIAL, image, plain=True)
    return ds.render(g, SCENE, MATERIAL, plain=True), error


CALLS: dict[str, Callable[[ds.GBuffer], Call]] = {
    "render": lambda g: (ds.render, (g, SCENE, MATERIAL)),
    "render, kept": of_kept,
    "render, maps": lambda g: (ds.render, (g, SCENE, maps(g))),
    "render, slots": lambda g: (ds.render, (g, SCENE, TWO)),
    "plain": lambda g: (plainly, (g, picture(g))),
    "error": lambda g: (ds.mean_squared_error, (g, SCENE, MATERIAL, picture(g))),
    "error, kept": error_of_kept,
    "error, maps": lambda g: (ds.mean_squared_error, (g, SCENE, maps(g), picture(g))),
    "keep_geometry": lambda g: (ds.keep_geometry, (g, SCENE, MATERIAL)),
    "basis": lambda g: (ds.basis, (g, SCENE, MATERIAL)),
    "contract": terms,
    "to_image": lambda g: (lambda g, x: g.to_image((x, x)), (g, g.from_image(picture(g))[0])),
    "from_image": lambda g: (lambda g, x: g.from_image(x), (g, picture(g))),
}
PROGRAMS = {"plain": 2, "to_image": 0, "from_image": 0}
CASES = [
    *(("sphere", name) for name in CALLS if "slots" not in name),
    *(("whole", name) for name in ("render, maps", "error", "basis", "to_image", "from_image")),
    *(("mesh", name) for name in ("render", "error, kept")),
    *(("flat", name) for name in ("render", "render, kept", "error", "basis")),
    *(("gouraud", name) for name in ("render", "render, kept", "error", "basis")),
    ("slots", "render, slots"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "name"), CASES)
def test_a_hundred_sizes_compile_a_program_a_bucket(kind: str, name: str) -> None:
    calls = [CALLS[name](g) for g in surfaces(kind)]
    calls[0][0](*CALLS[name](surface(kind, 8, 8))[1])  # what every size needs
    with compilations() as compiled:
        for call, arguments in calls:
            call(*arguments)
    ladder = {bucket(g.pixel_count) for g in surfaces(kind)}
    assert len({g.pixel_count for g in surfaces(kind)}) > 50
    assert len(ladder) <= 5
    assert len(compiled) <= PROGRAMS.get(name, 1) * len(ladder)


@pytest.mark.parametrize("paged", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("kind", "name"), CASES)
def test_the_same_inside_a_program(
    kind: str, name: str, paged: bool, tolerance: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    if paged:
        jax.clear_caches()
        monkeypatch.setattr(image, "page_size", lambda *_: 96)
        monkeypatch.setattr(image, "FEW", 64)
    call, arguments = CALLS[name](surface(kind, 23, 19))
    ours, theirs = call(*arguments), jax.jit(call)(*arguments)
    assert jax.tree.structure(ours) == jax.tree.structure(theirs)
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        assert isinstance(a, jax.Array)
        assert (a.shape, a.dtype, a.weak_type) == (b.shape, b.dtype, b.weak_type)
        np.testing.assert_allclose(a, b, rtol=20 * tolerance, atol=20 * tolerance)


@pytest.mark.slow
def test_arrays_of_a_hundred_sizes_compile_a_program_a_bucket(tolerance: float) -> None:
    images = []
    for g in surfaces("sphere"):
        position, normal = (
            np.asarray(g.to_image((v.x, v.y, v.z))) for v in (g.position, 2.0 * g.normal)
        )
        images.append((position, normal, g.mask))
    with compilations() as compiled:
        made = [ds.GBuffer.from_arrays(*each, eye=(0.0, 0.2, 4.0)) for each in images]
    assert len(compiled) <= len({bucket(g.pixel_count) for g in made})
    for ours, theirs in zip(made, surfaces("sphere"), strict=True):
        np.testing.assert_array_equal(ours.index, theirs.index)
        np.testing.assert_array_equal(ours.position.y, theirs.position.y)
        np.testing.assert_allclose(ours.normal.z, theirs.normal.z, atol=tolerance)


def test_images_of_a_few_sizes_share_a_program() -> None:
    some = [surface("sphere", width, 60) for width in (57, 58, 59, 60)]
    assert {bucket(g.pixel_count) for g in some[1:]} == {bucket(some[0].pixel_count)}
    ds.mean_squared_error(some[0], SCENE, MATERIAL, ds.render(some[0], SCENE, MATERIAL))
    with compilations() as compiled:
        for g in some:
            ds.mean_squared_error(g, SCENE, MATERIAL, ds.render(g, SCENE, MATERIAL))
    assert not compiled


def test_a_foreground_of_no_pixel_is_black() -> None:
    nothing = ds.gbuffer(ds.Sphere((9.0, 0.0, 0.0)), ds.OrthographicCamera(8, 8, 2.4))
    assert nothing.pixel_count == 0
    image = ds.render(nothing, SCENE, MATERIAL)
    assert image.shape == (8, 8, 3)
    assert not np.any(image)


def test_errors_name_the_sizes_that_were_given() -> None:
    g = surface("sphere", 23, 19)
    more = ds.Material(kd=np.ones((1, g.pixel_count + 1)))
    for call in (ds.render, ds.basis):
        with pytest.raises(ds.BadInput, match=f"P = {g.pixel_count} foreground"):
            call(g, SCENE, more)
    with pytest.raises(ds.BadInput, match=f"planes of .{g.pixel_count}, {g.pixel_count + 1}. pix"):
        ds.contract(ds.basis(g, SCENE, MATERIAL), more)
    with pytest.raises(ds.BadInput, match=f"planes .C, {g.pixel_count}.$"):
        ds.mean_squared_error(g, SCENE, MATERIAL, jnp.zeros((3, g.pixel_count + 1)))
    with pytest.raises(ds.BadInput, match=r"give \[19, 23, C\]$"):
        g.from_image(jnp.zeros((23, 19, 3)))
    half = ds.GBuffer(g.shape, g.normal, g.viewer, g.position, g.index[:-1])
    for call in (ds.render, jax.jit(ds.render), partial(ds.render, tolerance=0.1)):
        with pytest.raises(ds.BadInput, match=f".{g.pixel_count}. points for {g.pixel_count - 1} "):
            call(half, SCENE, MATERIAL)
    for wrong in ([[1, 2], [3]], "a"):
        with pytest.raises(ds.BadInput, match="is no array"):
            ds.mean_squared_error(g, SCENE, MATERIAL, wrong)  # type: ignore[arg-type]


def test_arrays_stay_on_the_device_that_they_were_put_on() -> None:
    device = jax.devices()[0]
    g, scene, material = jax.device_put((surface("sphere", 23, 19), SCENE, MATERIAL), device)
    assert ds.render(g, scene, material).committed


def test_a_program_keeps_no_padded_planes_of_what_is_gone() -> None:
    from diffshade import buckets

    before = len(buckets._whole)
    g = surface("sphere", 23, 19)
    assert len(buckets._whole) > before
    del g
    assert len(buckets._whole) == before
