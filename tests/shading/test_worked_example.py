"""The worked example of text A (LIGHT-11), and the derivatives of its formulas by hand.

P = (16, 8, 11) on a sphere of radius 21 about the origin, source (5, 20, 30), observer (40, -10, 25).
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import diffshade as ds
from diffshade.geometry.viewer import Eye
from diffshade.reflectance.lambert import lambert
from diffshade.reflectance.phong import phong
from diffshade.vector import Vec3, dot, length, reflect, unit

P = Vec3(jnp.array(16.0), jnp.array(8.0), jnp.array(11.0))
N = P * (1 / 21)
LIGHT = ds.PointLight((5, 20, 30), 0.9)
L = LIGHT.incidence(P).l
V = Eye((40, -10, 25)).direction(P)
R = reflect(L, N)

# sqrt(626) and sqrt(1096) are the two lengths; everything else is a fraction of whole numbers.
EXACT = {
    "l": np.array([-11, 12, 19]) / np.sqrt(626),
    "n": np.array([16, 8, 11]) / 21,
    "n.l": 129 / (21 * np.sqrt(626)),
    "v": np.array([24, -18, 14]) / np.sqrt(1096),
    "r": (2 * 129 / 441 * np.array([16, 8, 11]) - np.array([-11, 12, 19])) / np.sqrt(626),
}
EXACT["r.v"] = EXACT["r"] @ EXACT["v"]
PRINTED = {
    "l": (-0.4396, 0.4796, 0.7594),
    "n": (0.7619, 0.3810, 0.5238),
    "n.l": 0.2455,
    "v": (0.7249, -0.5437, 0.4229),
    "r": (0.8138, -0.2926, -0.5022),
    "r.v": 0.5366,
}
COMPUTED = {
    "l": L.to_array(),
    "n": N.to_array(),
    "n.l": dot(N, L),
    "v": V.to_array(),
    "r": R.to_array(),
    "r.v": dot(R, V),
}


@pytest.mark.parametrize("name", PRINTED)
def test_every_printed_number(name: str) -> None:
    exact = 1e-12 if jax.config.jax_enable_x64 else 2e-6
    np.testing.assert_allclose(COMPUTED[name], EXACT[name], rtol=0, atol=exact)
    np.testing.assert_allclose(COMPUTED[name], PRINTED[name], rtol=0, atol=2e-4)


def test_distances() -> None:
    rounding = 1e-12 if jax.config.jax_enable_x64 else 1e-5
    s = Vec3(jnp.array(-11.0), jnp.array(12.0), jnp.array(19.0))
    np.testing.assert_allclose(length(s), np.sqrt(626), rtol=rounding)
    np.testing.assert_allclose(length(P), 21, rtol=rounding)


def test_the_whole_formula_by_render(tolerance: float) -> None:
    """I = I_a k_a + I_p f [k_d n.l + k_s (r.v)^n] at P, with f = min(1/(c0 + c1 d + c2 d^2), 1)."""
    gbuffer = ds.GBuffer.from_arrays(
        P.to_array()[None, None], N.to_array()[None, None], np.ones((1, 1), bool), eye=(40, -10, 25)
    )
    light = ds.PointLight((5, 20, 30), 0.9, ds.QuadraticAttenuation(0.5, 0.03, 0.001))
    material = ds.Material(ka=0.3, kd=0.6, specular=ds.Phong(ks=0.4, shininess=7.5))
    image = ds.render(gbuffer, ds.Scene(ambient=0.2, lights=light), material)
    d = np.sqrt(626)
    f = min(1 / (0.5 + 0.03 * d + 0.001 * d**2), 1)
    expected = 0.2 * 0.3 + 0.9 * f * (0.6 * EXACT["n.l"] + 0.4 * EXACT["r.v"] ** 7.5)
    np.testing.assert_allclose(image[0, 0, 0], expected, rtol=10 * tolerance)


@pytest.mark.float64
class TestDerivativesByHand:
    """d LIGHT-4, 5, 10, 12, 13 from the formulas, not from any program."""

    def test_light_4_lambert(self) -> None:
        """d max(0, n.l): 1 where n.l > 0, and 0 at and below the terminator."""
        slope = jax.vmap(jax.grad(lambert))(jnp.array([-0.5, 0.0, 1e-9, 0.2455]))
        np.testing.assert_array_equal(slope, [0, 0, 1, 1])

    def test_light_5_phong(self) -> None:
        """d c^n/dc = n c^(n-1) and d c^n/dn = c^n ln c, with c = r.v: along the unit sphere of v."""
        c = EXACT["r.v"]

        def lobe(v: Vec3, n: jax.Array) -> jax.Array:
            return phong(N, L, v, dot(N, L), n)

        by_v, by_n = jax.grad(lobe, argnums=(0, 1))(V, jnp.array(7.5))
        across = by_v - V * dot(by_v, V)
        np.testing.assert_allclose(
            across.to_array(), 7.5 * c**6.5 * (EXACT["r"] - c * V.to_array()), rtol=1e-13
        )
        np.testing.assert_allclose(by_n, c**7.5 * np.log(c), rtol=1e-13)

    def test_light_10_reflection(self) -> None:
        """d r/d l = 2 n n' - 1 and d r/d n = 2 (n l' + (n.l) 1)."""
        n, l = EXACT["n"], EXACT["l"]

        def r(n: jax.Array, l: jax.Array) -> jax.Array:
            return reflect(Vec3.from_array(l), Vec3.from_array(n)).to_array()

        by_n, by_l = jax.jacrev(r, argnums=(0, 1))(jnp.asarray(n), jnp.asarray(l))
        np.testing.assert_allclose(by_l, 2 * np.outer(n, n) - np.eye(3), atol=1e-14)
        np.testing.assert_allclose(by_n, 2 * (np.outer(n, l) + (n @ l) * np.eye(3)), atol=1e-14)

    @pytest.mark.parametrize(
        ("c", "alive"),
        [((0.5, 0.03, 0.001), True), ((0.1, 0.001, 0.0), False), ((1.0, 0.0, 0.0), True)],
    )
    def test_light_12_attenuation(self, c: tuple[float, float, float], alive: bool) -> None:
        """df/dc_k = -f^2 d^k and df/dd = -f^2 (c1 + 2 c2 d); 0 where clamped; unclamped on the edge."""
        d = np.sqrt(626)
        f = 1 / (c[0] + c[1] * d + c[2] * d**2)

        def value(c: jax.Array, d: jax.Array) -> jax.Array:
            return ds.QuadraticAttenuation(*c)(d)

        by_c, by_d = jax.grad(value, argnums=(0, 1))(jnp.array(c), jnp.array(d))
        np.testing.assert_allclose(by_c, -alive * f**2 * d ** np.arange(3), rtol=1e-13)
        np.testing.assert_allclose(by_d, -alive * f**2 * (c[1] + 2 * c[2] * d), rtol=1e-13)

    def test_light_13_everything_by_the_source(self) -> None:
        """dI/dS = I_p f [k_d n + k_s n_s c^(n_s-1) (2 (n.v) n - v)] (1 - l l')/d + I/f df/dd l."""
        c = (0.5, 0.03, 0.001)
        kd, ks, power, intensity = 0.6, 0.4, 7.5, 0.9
        n, l, v, d = EXACT["n"], EXACT["l"], EXACT["v"], np.sqrt(626)
        f = 1 / (c[0] + c[1] * d + c[2] * d**2)
        lobe, slope = EXACT["r.v"] ** power, power * EXACT["r.v"] ** (power - 1)
        by_l = kd * n + ks * slope * (2 * (n @ v) * n - v)
        by_s = f * by_l @ (np.eye(3) - np.outer(l, l)) / d
        by_s = by_s + (kd * (n @ l) + ks * lobe) * -(f**2) * (c[1] + 2 * c[2] * d) * l

        gbuffer = ds.GBuffer.from_arrays(
            P.to_array()[None, None],
            N.to_array()[None, None],
            np.ones((1, 1), bool),
            eye=(40, -10, 25),
        )
        material = ds.Material(kd=kd, specular=ds.Phong(ks=ks, shininess=power))

        def radiance(source: jax.Array) -> jax.Array:
            light = ds.PointLight(source, intensity, ds.QuadraticAttenuation(*c))
            return ds.render(gbuffer, ds.Scene(lights=light), material)[0, 0, 0]

        gradient = jax.grad(radiance)(jnp.array([5.0, 20.0, 30.0]))
        np.testing.assert_allclose(gradient, intensity * by_s, rtol=1e-12)
        assert np.all(np.abs(gradient) > 1e-4)


def test_mirror_limit() -> None:
    """n to infinity tends to a mirror: 1 along r, 0 beside it."""
    along = phong(N, L, unit(R), dot(N, L), jnp.array(1e5))
    beside = phong(N, L, unit(R + N * 0.05), dot(N, L), jnp.array(1e5))
    np.testing.assert_allclose(along, 1, atol=1e-9)
    assert beside < 1e-20
