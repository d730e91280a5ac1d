"""The few lengths that programs are compiled for, and how many G-buffers of many sizes compile."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compilations import compilations
from mesh_cases import icosphere

import diffshade as ds
from diffshade.buckets import are_at_hand, bucket, cut, pad

SIZES = [(64 + 2 * k, 60 + k) for k in range(30)]
"""Of images; all have different numbers of pixels, of the foreground as well."""


def test_a_bucket_holds_its_count_and_little_more():
    counts = range(1, 70_000)
    lengths = [bucket(count) for count in counts]
    assert all(length >= count for length, count in zip(lengths, counts, strict=True))
    assert all(
        4 * length <= 5 * count + 4 for length, count in zip(lengths[64:], counts[64:], strict=True)
    )
    assert lengths == sorted(lengths)
    assert all(bucket(length) == length for length in set(lengths))
    assert len({bucket(round(1.01**k)) for k in range(695, 1852)}) <= 70  # from 1000 to 100 million


@pytest.mark.parametrize("count", [0, 1, 5])
def test_what_is_padded_is_cut_back(count):
    tree = {"index": np.arange(count, dtype=np.int32), "plane": np.linspace(1, 2, count)}
    padded = pad(tree)
    assert all(values.shape == (64,) for values in padded.values())
    assert all(values.ctypes.data % 64 == 0 for values in padded.values())
    assert (padded["plane"][count:] == (2 if count > 1 else count)).all()
    back = cut(padded, count)
    for name, values in tree.items():
        assert isinstance(back[name], jax.Array)
        np.testing.assert_array_equal(back[name], values)
    np.testing.assert_array_equal(cut(jnp.ones((3, 8)), count), np.ones((3, count)))


def test_what_was_cut_is_padded_without_a_copy():
    whole, number = jnp.arange(64.0), jnp.asarray(2.0)
    part, same = cut((whole, number), 60)
    assert pad(part) is whole
    assert pad(same) is same
    assert pad(whole) is whole
    assert pad(cut(whole, 20)[:5]).shape == (64,)
    assert pad(np.zeros((3, 70))).shape == (3, 80)


@pytest.mark.parametrize("what", ["jit", "tracer", "committed"])
def test_what_is_not_at_hand(what):
    array = jnp.ones(3)
    assert are_at_hand((array, np.ones(3), 1.0))
    found = []
    if what == "jit":
        jax.jit(lambda x: found.append(are_at_hand(array)) or x)(1.0)
    if what == "tracer":
        jax.grad(lambda x: found.append(are_at_hand((array, x))) or x)(1.0)
    if what == "committed":
        found.append(are_at_hand(jax.device_put(array, jax.devices()[0])))
    assert found == [False]


def cameras():
    for width, height in SIZES:
        yield ds.OrthographicCamera(width, height, 2.4)


def pixels(g: ds.GBuffer) -> int:
    return g.shape[0] * g.shape[1]


GEOMETRIES: dict[str, Callable[[], Any]] = {
    "sphere": ds.Sphere,
    "mesh": lambda: ds.Mesh(*icosphere(2)),
}


@pytest.mark.parametrize("shading", [ds.PhongShading(), ds.FlatShading(), ds.GouraudShading()])
@pytest.mark.parametrize("name", GEOMETRIES)
def test_images_of_many_sizes_share_their_programs(name, shading):
    if name == "sphere" and not isinstance(shading, ds.PhongShading):
        pytest.skip("a sphere has no faces")
    geometry = GEOMETRIES[name]()
    first = ds.gbuffer(geometry, ds.OrthographicCamera(8, 8, 2.4), shading=shading)
    assert first.pixel_count < 64
    with compilations() as compiled:
        seen = [ds.gbuffer(geometry, camera, shading=shading) for camera in cameras()]
    counts = {g.pixel_count for g in seen}
    assert len(counts) >= 28
    assert all(g.index.shape == (g.pixel_count,) for g in seen)
    # The foreground, all pixels, and, on a mesh, the rays that meet something.
    ladder = {bucket(count) for count in counts}
    everything = {bucket(pixels(g)) for g in seen}
    assert len(ladder) < 10
    hits = len(ladder) if name == "mesh" else 0
    assert len(compiled) <= len(ladder) + len(everything) + hits
    with compilations() as again:
        for camera in cameras():
            ds.gbuffer(GEOMETRIES[name](), camera, shading=shading)
    assert not again


@pytest.mark.parametrize("shading", [ds.PhongShading(), ds.FlatShading(), ds.GouraudShading()])
def test_a_g_buffer_is_padded_once_and_not_for_every_render(shading):
    camera = ds.OrthographicCamera(37, 23, 2.4)
    g = ds.gbuffer(ds.Mesh(*icosphere(2)), camera, shading=shading)
    first, again = (jax.tree.leaves(g.in_bucket()) for _ in range(2))
    assert all(a is b for a, b in zip(first, again, strict=True))


@pytest.mark.parametrize("name", GEOMETRIES)
def test_exact_shapes_and_values_whatever_the_bucket(name, tolerance):
    geometry = GEOMETRIES[name]()
    for width, height in ((8, 8), (9, 8), (37, 23)):
        camera = ds.PerspectiveCamera(width, height, 0.7, position=(0.3, 0.4, 3))
        seen = ds.visibility(geometry, camera)
        g = ds.gbuffer(geometry, camera)
        traced = jax.jit(ds.gbuffer)(geometry, camera, seen)
        assert jax.tree.structure(traced) == jax.tree.structure(g)
        for ours, theirs in zip(jax.tree.leaves(g), jax.tree.leaves(traced), strict=True):
            assert ours.shape == theirs.shape
            assert ours.dtype == theirs.dtype
            np.testing.assert_allclose(ours, theirs, atol=10 * tolerance)


def test_a_masked_capture_compiles_no_more():
    from diffshade.io.foreground import masked_gbuffer

    def masked(camera):
        mask = np.zeros((camera.height, camera.width), bool)
        mask[: camera.height // 2] = True
        return masked_gbuffer(ds.Sphere(), camera, mask)

    for camera in cameras():
        ds.gbuffer(ds.Sphere(), camera)
    with compilations() as compiled:
        seen = [masked(camera) for camera in cameras()]
    assert len(compiled) <= len({bucket(g.pixel_count) for g in seen})
