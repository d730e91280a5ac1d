"""What an environment makes of matt and shiny surfaces, against closed forms, mpmath and many lights."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from gradients import check_gradients

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.reflectance.phong import blurred
from diffshade.vector import Vec3

GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(14, 14, 2.2))
N = np.stack([GBUFFER.normal.x, GBUFFER.normal.y, GBUFFER.normal.z], axis=-1)
V = np.array([0.0, 0.0, 1.0])


def smooth(order: int = 4, channels: int = 3, seed: int = 0) -> ds.EnvironmentLight:
    """A positive one."""
    rng = np.random.default_rng(seed)
    c = 0.15 * rng.normal(size=((order + 1) ** 2, channels))
    c[0] = rng.uniform(1.5, 2.5, channels)
    return ds.EnvironmentLight(c)


def seen(light: object, material: ds.Material, gbuffer: ds.GBuffer = GBUFFER) -> np.ndarray:
    """The foreground [P, C]."""
    image = ds.render(gbuffer, ds.Scene(lights=light), material)
    return np.asarray(gbuffer.from_image(image), float).T


@pytest.mark.parametrize("n", [0.0, 0.5, 1.0, 7.0, 80.0])
def test_what_a_lobe_leaves_of_each_degree(n: float, tolerance: float) -> None:
    mpmath.mp.dps = 30
    order = 9
    expected = [
        2 * mpmath.pi * mpmath.quad(lambda t, l=l: t**n * mpmath.legendre(l, t), [0, 1])
        for l in range(order + 1)
    ]
    found = blurred(jnp.asarray(n, float), order)
    np.testing.assert_allclose(found, [float(x) for x in expected], atol=10 * tolerance, rtol=0)


def test_even_light(tolerance: float) -> None:
    """k_d pi L + k_s 2 pi L / (n + 1)."""
    even = ds.EnvironmentLight([0.7 * np.sqrt(4 * np.pi)])
    material = ds.Material(kd=0.3, specular=ds.Phong(0.2, 9.0))
    expected = 0.7 * np.pi * (0.3 + 0.2 * 2 / 10)
    np.testing.assert_allclose(seen(even, material), expected, rtol=100 * tolerance)


def test_one_lobe_of_one_degree(tolerance: float) -> None:
    """L = z, seen along z: r.z = 2 n_z^2 - 1, and of it a_1 = 2 pi / (n + 2) is left."""
    light = ds.EnvironmentLight([0, 0, np.sqrt(4 * np.pi / 3), 0])
    found = seen(light, ds.Material(kd=1.0))
    np.testing.assert_allclose(found[:, 0], 2 * np.pi / 3 * N[:, 2], atol=10 * tolerance)
    found = seen(light, ds.Material(specular=ds.Phong(0.5, 6.0)))
    np.testing.assert_allclose(found[:, 0], np.pi / 8 * (2 * N[:, 2] ** 2 - 1), atol=10 * tolerance)


def test_against_many_lights(tolerance: float) -> None:
    """The integrals, by a rule with the gate n.l > 0 and without."""
    light, exponent = smooth(), 12.0
    w, power = _lights(light, 40)
    matt = np.clip(N @ w.T, 0, None) @ power
    found = seen(light, ds.Material(kd=1.0))
    error = np.abs(found - matt) / matt
    assert error.mean() < 0.01
    assert 1e-3 < error.max() < 0.03  # of the fourth degree, which this light has as much of
    r = 2 * (N @ V)[:, None] * N - V
    lobes = np.clip(r @ w.T, 0, None) ** exponent
    found = seen(light, ds.Material(specular=ds.Phong(1.0, exponent)))
    np.testing.assert_allclose(found, lobes @ power, rtol=1e-5 + 10 * tolerance)
    # What the gate would take: at the rim half of a lobe, inside next to nothing
    gated = (lobes * (N @ w.T > 0)) @ power
    cost = (np.abs(found - gated) / found).max(axis=1)
    assert 0.1 < cost.max() < 0.6
    assert cost[N[:, 2] > 0.75].max() < 0.01
    lit = seen(light.as_lights(12), ds.Material(specular=ds.Phong(1.0, exponent)))
    np.testing.assert_allclose(lit[N[:, 2] > 0.75], gated[N[:, 2] > 0.75], rtol=0.01)


def _lights(light: ds.EnvironmentLight, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions and powers by a rule of NumPy's own."""
    z, weight = np.polynomial.legendre.leggauss(samples)
    turn = np.arange(2 * samples) * np.pi / samples
    ring = np.sqrt(1 - z * z)[:, None]
    w = np.stack(np.broadcast_arrays(ring * np.cos(turn), ring * np.sin(turn), z[:, None]), axis=-1)
    power = np.asarray(light.radiance(w), float) * (weight * np.pi / samples)[:, None, None]
    return w.reshape(-1, 3), power.reshape(-1, power.shape[-1])


def test_it_adds_to_other_lights_and_to_itself(tolerance: float) -> None:
    """One of several lights; with an intensity, colours, maps, kept geometry, devices, large images."""
    light, material = (
        smooth(2),
        ds.Material(kd=0.5, specular=ds.Phong(0.3, 8.0), os=(0.2, 0.5, 0.9)),
    )
    point = ds.PointLight((1, 2, 3), 0.4, ds.InverseSquare())
    alone = seen(light, material)
    together = seen((light, point), material)
    np.testing.assert_allclose(together, alone + seen(point, material), atol=30 * tolerance)
    dim = ds.EnvironmentLight(light.harmonics, (0.5, 0.25, 2.0))
    np.testing.assert_allclose(seen(dim, material), alone * [0.5, 0.25, 2], atol=30 * tolerance)
    scene = ds.Scene(lights=(light, point))
    for surface in (
        ds.keep_geometry(GBUFFER, scene, material),
        ds.shard(GBUFFER, jax.devices()[:1]),
    ):
        image = ds.render(surface, scene, material)
        np.testing.assert_allclose(GBUFFER.from_image(image).T, together, atol=30 * tolerance)
    maps = ds.Material(kd=0.5, specular=ds.Phong(0.3, np.full((1, len(N)), 8.0)), os=material.os)
    np.testing.assert_allclose(seen(light, maps), alone, atol=30 * tolerance)


@pytest.mark.slow
def test_a_large_image_is_the_small_ones(tolerance: float) -> None:
    """The way of `fusion`: pages, and planes two at a time; many environments as one."""
    large = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(160, 160, 2.2))
    lights = (smooth(3), ds.ParallelLight((0, 1, 1), (0.1, 0.2, 0.3)))
    material = ds.Material(kd=(0.5, 0.4, 0.3), specular=ds.Phong(0.3, 8.0))
    scene = ds.Scene(0.1, lights)
    fast = ds.render(large, scene, material)
    plain = ds.render(large, scene, material, plain=True)
    np.testing.assert_allclose(fast, plain, atol=30 * tolerance)

    def error(harmonics: jax.Array, shininess: jax.Array, plain: bool) -> jax.Array:
        lit = ds.Scene(lights=(ds.EnvironmentLight(harmonics), lights[1]))
        shiny = ds.Material(kd=0.5, specular=ds.Phong(0.3, shininess))
        return ds.mean_squared_error(large, lit, shiny, fast, plain=plain)

    at = lights[0].harmonics, jnp.asarray(9.0, lights[0].harmonics.dtype)
    slopes = [jax.grad(error, argnums=(0, 1))(*at, plain) for plain in (False, True)]
    for a, b in zip(*slopes, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-3 * float(np.abs(b).max()))


@pytest.mark.float64
def test_derivatives() -> None:
    """In normals, the view, the harmonics, the intensity, the coefficients and n."""
    rng = np.random.default_rng(5)

    def radiance(x: dict[str, jax.Array]) -> jax.Array:
        g = ds.GBuffer.from_arrays(x["position"], x["normal"], eye=x["eye"])
        light = ds.EnvironmentLight(x["harmonics"], x["intensity"])
        material = ds.Material(kd=x["kd"], specular=ds.Phong(x["ks"], x["n"]))
        return ds.render(g, ds.Scene(lights=light), material)

    cases = [
        {
            "position": rng.normal(size=(1, 1, 3)),
            "normal": rng.normal(size=(1, 1, 3)) + np.array([0, 0, 2]),
            "eye": rng.normal(size=3) + np.array([0, 0, 5]),
            "harmonics": rng.normal(size=(16, 1)),
            "intensity": np.array(0.7),
            "kd": np.array(0.4),
            "ks": np.array(0.6),
            "n": np.array(n),
        }
        for n in (0.3, 2.0, 31.0)
    ]
    check_gradients(radiance, cases)


def test_nothing_is_lit_that_has_no_normal_or_no_view() -> None:
    light = smooth(2, 1)

    def lit(normal: jax.Array, eye: jax.Array) -> jax.Array:
        g = ds.GBuffer.from_arrays(jnp.zeros((1, 1, 3)), normal[None, None], eye=eye)
        return ds.render(g, ds.Scene(lights=light), ds.Material(kd=0.5, specular=ds.Phong(0.5, 4)))

    up, none = jnp.array([0.0, 0.0, 1.0]), jnp.zeros(3)
    values = jax.jit(jax.vmap(lit))(jnp.stack([none, up, up]), jnp.stack([up, none, up]))[
        :, 0, 0, 0
    ]
    slopes = jax.jit(jax.vmap(jax.grad(lambda n, e: lit(n, e).sum())))(
        jnp.stack([none, up]), jnp.stack([up, up])
    )
    assert values[0] == 0
    matt = ds.render(
        ds.GBuffer.from_arrays(None, np.array([[[0.0, 0.0, 1.0]]])),
        ds.Scene(lights=light),
        ds.Material(kd=0.5),
    )
    np.testing.assert_allclose(values[1], matt[0, 0, 0], rtol=1e-6)
    assert values[2] > values[1] > 0
    assert (slopes[0] == 0).all()
    assert np.isfinite(slopes).all()


def test_as_few_degrees_as_a_tolerance_takes() -> None:
    """The bound holds, and is not far off: about sqrt(2 n log(1 / tolerance)) degrees."""
    light = smooth(16, 2)
    for n, tolerance, most in ((5.0, 0.01, 9), (20.0, 0.03, 14)):
        material = ds.Material(kd=0.5, specular=ds.Phong((0.2, 0.4), n))
        few = ds.resolved(light, GBUFFER, material, tolerance)
        error = np.abs(seen(few, material) - seen(light, material)).max()
        assert tolerance / 50 < error <= tolerance
        assert few.order <= most
    orders = [ds.resolved(light, GBUFFER, material, t).order for t in (0.1, 0.03, 0.001, 0.0)]
    assert orders == sorted(orders)
    assert orders[-1] == 16
    assert ds.resolved(light, GBUFFER, ds.Material(kd=0.5), 0.0).order == 2


@pytest.mark.parametrize(
    ("material", "part"),
    [
        (lambda: ds.Material(specular=ds.BlinnPhong(0.5, 8)), "a BlinnPhong"),
        (lambda: ds.Material(specular=ds.Phong(0.5, 8, ds.Schlick(0.1))), "a weighted Phong"),
        (lambda: ds.Material(specular=ds.GGX(0.5, 0.3)), "a GGX"),
        (lambda: ds.Material(kd=0.5, body=ds.FresnelBody(1.5)), "a FresnelBody"),
    ],
)
def test_what_asks_for_rays_is_refused(material: Callable[[], ds.Material], part: str) -> None:
    light = smooth(2, 1)
    with pytest.raises(BadInput) as refused:
        ds.render(GBUFFER, ds.Scene(lights=light), material())
    said = str(refused.value)
    assert f"the material has {part}, and an EnvironmentLight" in said
    assert "light it by environment.as_lights(samples)" in said
    assert np.isfinite(seen(light.as_lights(3), material())).all()
    if material().specular:
        with pytest.raises(BadInput, match="as_lights"):
            ds.resolved(light, GBUFFER, material(), 0.1)


def test_what_is_visible_is_a_factor(tolerance: float) -> None:
    light, material = smooth(2), ds.Material(kd=0.5, specular=ds.Phong(0.3, 8.0))
    share = np.linspace(0, 1, len(N)).astype(GBUFFER.normal.x.dtype)
    hidden = ds.EnvironmentLight(light.harmonics, visible=share)
    expected = share[:, None] * seen(light, material)
    np.testing.assert_allclose(seen(hidden, material), expected, atol=30 * tolerance)
    with pytest.raises(BadInput, match=r"no ray that a surface could hide: give .* as_lights"):
        ds.shadowed(light, GBUFFER, ds.Sphere())


def test_normals_are_enough(tolerance: float) -> None:
    flat = ds.GBuffer.from_arrays(None, np.tile(V, (2, 2, 1)))
    light = smooth(2)
    found = np.asarray(ds.render(flat, ds.Scene(lights=light), ds.Material(kd=1.0)))[0, 0]
    expected = [float(x) for x in light.irradiance(Vec3(*map(jnp.asarray, V.tolist())))]
    np.testing.assert_allclose(found, expected, rtol=10 * tolerance)
