"""Shading over several devices: the numbers of one, each device its own pixels, and nothing gathered."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from forced_devices import printed

import diffshade as ds

FOUR = """
import json, re
import jax, jax.numpy as jnp, numpy as np
import diffshade as ds
from diffshade.shading import image

jax.config.update("jax_enable_x64", True)
image.page_size, image.FEW = lambda *_: 200, 100  # several pages each, the last one overlapping
devices = jax.devices()
assert len(devices) == 4
COLLECTIVE = "(all-gather|all-reduce|collective-permute|all-to-all|reduce-scatter)[(-]"
law = ds.QuadraticAttenuation(1.0, 0.1, 0.02)
places = ((0.5, 1.0, 2.5), (-1.5, 0.3, 2.0))
scene = ds.Scene(0.2, tuple(ds.PointLight(p, (0.9, 0.7, 0.5), law) for p in places))
normals = np.random.default_rng(0).normal(size=(40, 40, 3)) * 0.2 + (0, 0, 1)
ball = ds.gbuffer(ds.Sphere(), ds.PerspectiveCamera(46, 45, 0.72, position=(0, 0.2, 4)))
full = ds.GBuffer.from_arrays(np.zeros((40, 40, 3)), normals)


def material(kd):
    return ds.Material(0.1, kd, ds.Phong(ks=0.4, shininess=12.0))


def off(found, known):
    pairs = zip(jax.tree.leaves(found), jax.tree.leaves(known), strict=True)
    return max(
        float(np.abs(np.asarray(a)[..., : b.shape[-1]] - b).max() / np.abs(b).max())
        if b.ndim else float(abs(a - b) / abs(b))
        for a, b in pairs
    )


def shares(plane):
    return sorted({shard.data.shape[-1] for shard in plane.addressable_shards})


def collectives(f, *arguments):
    compiled = jax.jit(f, compiler_options=ds.compiler_options()).lower(*arguments).compile()
    return sorted(set(re.findall(COLLECTIVE, compiled.as_text())))


everything = jax.jit(
    jax.value_and_grad(ds.mean_squared_error, argnums=(0, 1, 2), allow_int=True)
)


@jax.jit
def coefficients(surface, material, target):
    def image(material):
        return ds.render(surface, scene, material)

    def slope(material):
        return jax.grad(lambda m: ds.mean_squared_error(surface, scene, m, target))(material)

    step = jax.tree.map(jnp.ones_like, material)
    value, forward = jax.jvp(image, (material,), (step,))
    back = jax.vjp(image, material)[1](value)
    return value, forward, back, jax.jvp(slope, (material,), (step,))


rows = {}
for name, g, map_, make in (
    ("a ball", ball, False, lambda g, m: g),
    ("maps", ball, True, lambda g, m: g),
    ("kept, no background", full, False, lambda g, m: ds.keep_geometry(g, scene, m)),
):
    ramp = jnp.linspace(0.1, 0.6, g.pixel_count)[None]
    m = material(ramp if map_ else (0.5, 0.4, 0.3))
    alone = make(g, m)
    shared = ds.shard(alone, devices)
    dealt = material(shared.from_image(g.to_image((ramp[0],)))) if map_ else m
    observed = 0.8 * ds.render(g, scene, m) + 0.01
    target = shared.from_image(observed)
    value, found = everything(shared, scene, dealt, target)
    value_alone, known = everything(alone, scene, m, observed)
    inner, outer = found[0].surface, known[0]
    planes = (inner.angles, outer.angles) if inner.angles else (inner.gbuffer.normal, outer.normal)
    rows[name] = {
        "pixels": g.pixel_count,
        "off": {
            "value": off(value, value_alone),
            "plain": off(ds.mean_squared_error(shared, scene, dealt, observed, plain=True), value_alone),
            "planes": off(*planes),
            "scene": off(found[1], known[1]) if map_ or not inner.angles else 0.0,
            "material": off(found[2], known[2]),
            "outermost": off(ds.render(shared, scene, dealt), ds.render(alone, scene, m)),
            "coefficients": off(coefficients(shared, dealt, target), coefficients(alone, m, observed)),
        },
        "each": shared.pixel_count // 4,
        "shares": [
            shares(x) for x in (shared.gbuffer.normal.x, target, jax.tree.leaves(planes[0])[0])
        ],
        "planes": collectives(lambda s, m: image.image_planes(s, scene, m, False), shared, dealt),
        "loss": collectives(
            lambda s, m, o: jax.value_and_grad(ds.mean_squared_error, (1, 2))(s, scene, m, o),
            shared, dealt, target,
        ),
    }
print(json.dumps(rows))
"""


@pytest.mark.slow
def test_four_devices_are_one() -> None:
    rows = printed(FOUR, devices=4)
    assert rows["a ball"]["pixels"] % 4  # some device has pixels that are repeated
    for row in rows.values():
        for what, difference in row["off"].items():
            assert difference < 1e-11, (what, row)
        assert row["shares"] == [[row["each"]]] * 3
        assert row["planes"] == []
        assert row["loss"] == ["all-reduce"]


def test_one_device_is_the_same(tolerance: float) -> None:
    g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(12, 10, 2.2))
    scene, material = ds.Scene(0.1, ds.PointLight((1, 1, 2))), ds.Material(0.5, 0.5)
    shared = ds.shard(g, jax.devices()[:1])
    image = ds.render(g, scene, material)
    np.testing.assert_allclose(ds.render(shared, scene, material), image, rtol=tolerance)
    half = 0.5 * image
    alone = ds.mean_squared_error(g, scene, material, half)
    for target in (half, shared.from_image(half)):
        error = ds.mean_squared_error(shared, scene, material, target)
        assert float(error) == pytest.approx(float(alone), rel=10 * tolerance)


def test_what_cannot_be_dealt_out() -> None:
    g = ds.GBuffer.from_arrays(None, np.ones((2, 3, 3)))
    with pytest.raises(ds.BadInput, match="devices is"):
        ds.shard(g, [])
    shared = ds.shard(g, jax.devices()[:1])
    with pytest.raises(ds.BadInput, match="outside of jit"):
        jax.jit(lambda g: ds.shard(g, jax.devices()[:1]).gbuffer.normal.x)(g)
    with pytest.raises(ds.BadInput, match=r"give \[2, 3, C\]"):
        shared.from_image(jnp.zeros((3, 2, 1)))
    mesh = ds.Mesh(np.float64([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    flat = ds.gbuffer(mesh, ds.OrthographicCamera(8, 8, 2.2), shading=ds.FlatShading())
    with pytest.raises(ds.BadInput, match="once a face or a vertex"):
        ds.shard(flat, jax.devices())
