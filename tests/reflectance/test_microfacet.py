"""Laws of microfacet lobes: normalisation, reciprocity, energy, limits, and what is absent."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.reflectance import distribution, masking
from diffshade.reflectance.lobe import AbstractLobe
from diffshade.vector import Vec3

LOBES: dict[str, Callable[..., AbstractLobe]] = {
    "ggx": lambda a, f=None: ds.GGX(1, a, f),
    "ggx, separable": lambda a, f=None: ds.GGX(1, a, f, "separable"),
    "ggx, v-groove": lambda a, f=None: ds.GGX(1, a, f, "v-groove"),
    "beckmann": lambda a, f=None: ds.Beckmann(1, a, f),
    "beckmann, rational": lambda a, f=None: ds.Beckmann(1, a, f, "separable", rational=True),
    "torrance-sparrow": lambda a, f=None: ds.TorranceSparrow(1, a, f),
}
SMITH = ("ggx", "ggx, separable", "beckmann")
ROUGH = (0.1, 0.4, 0.9)


def vectors(cosine: np.ndarray, azimuth: np.ndarray) -> Vec3:
    """Unit vectors about z."""
    sine = np.sqrt(1 - cosine**2)
    planes = sine * np.cos(azimuth), sine * np.sin(azimuth), cosine
    return Vec3(*(jnp.asarray(x, float) for x in np.broadcast_arrays(*planes)))


def shape(lobe: AbstractLobe, l: Vec3, v: Vec3) -> np.ndarray:
    """s about the normal z."""
    up = Vec3(jnp.zeros_like(l.x), jnp.zeros_like(l.x), jnp.ones_like(l.x))
    (plane,) = lobe.shape(up, l, v, l.z)
    return np.asarray(plane, float)


def hemisphere(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cosines, azimuths and weights of solid angle, exact for smooth functions."""
    x, w = leggauss(count)
    azimuth = (np.arange(2 * count) + 0.5) * np.pi / count
    cosine = np.repeat(0.5 * (x + 1), 2 * count)
    return cosine, np.tile(azimuth, count), np.repeat(0.5 * w, 2 * count) * np.pi / count


@pytest.mark.parametrize("alpha", ROUGH)
@pytest.mark.parametrize("name", ["ggx", "beckmann", "gaussian"])
def test_facets_cover_the_surface(name: str, alpha: float) -> None:
    """The integral of D cos over the hemisphere is 1."""
    x, w = leggauss(400)
    theta = 0.25 * np.pi * (x + 1)
    versine = jnp.asarray(2 * np.sin(0.5 * theta) ** 2, float)
    density = np.asarray(getattr(distribution, name)(versine, jnp.asarray(alpha)), float)
    whole = 0.25 * np.pi * w @ (density * np.cos(theta) * 2 * np.pi * np.sin(theta))
    if name == "gaussian":
        assert abs(whole - (1 - 2 * alpha**2 / 3)) < 0.3 * alpha**4
    else:
        np.testing.assert_allclose(whole, 1, rtol=1e-5)


@pytest.mark.parametrize("alpha", ROUGH)
@pytest.mark.parametrize("shadow", [masking.ggx_shadow, masking.beckmann_shadow])
def test_the_facets_that_are_seen_cover_the_view(
    shadow: Callable[..., jax.Array], alpha: float
) -> None:
    """Smith's condition (Walter 2007, 21): the integral of D G_1(v) max(0, v.h) dh is n.v."""
    density = distribution.ggx if shadow is masking.ggx_shadow else distribution.beckmann
    cosine, azimuth, weight = hemisphere(300)
    d = np.asarray(density(jnp.asarray(1 - cosine, float), jnp.asarray(alpha)), float)
    for view in (0.15, 0.5, 0.95):
        across = np.sqrt(1 - cosine**2) * np.cos(azimuth) * np.sqrt(1 - view**2)
        seen = np.maximum(cosine * view + across, 0)
        a = float(shadow(jnp.asarray(view, float), jnp.asarray(alpha)))
        hidden = view / (view + a)
        np.testing.assert_allclose(weight @ (d * seen) * hidden, view, rtol=2e-3)


def test_the_rational_masking_is_near_the_exact_one() -> None:
    c, alpha = jnp.asarray(np.linspace(0.01, 1, 500), float), jnp.asarray(0.4)
    exact, near = (
        c / (c + f(c, alpha)) for f in (masking.beckmann_shadow, masking.rational_beckmann_shadow)
    )
    assert 1e-3 < float(jnp.abs(near - exact).max()) < 4e-3


@pytest.mark.parametrize("fresnel", [None, ds.Dielectric(1.5), ds.Schlick(0.3)])
@pytest.mark.parametrize("name", LOBES)
def test_light_goes_both_ways(
    name: str, fresnel: object, rng: np.random.Generator, tolerance: float
) -> None:
    """f(l, v) = f(v, l), s = f n.l."""
    cosine, azimuth = rng.uniform(0.05, 1, (2, 200)), rng.uniform(0, 2 * np.pi, (2, 200))
    l, v = (vectors(c, a) for c, a in zip(cosine, azimuth, strict=True))
    lobe = LOBES[name](0.5, fresnel)
    there, back = shape(lobe, l, v) / np.asarray(l.z), shape(lobe, v, l) / np.asarray(v.z)
    np.testing.assert_allclose(there, back, rtol=50 * tolerance)


@pytest.mark.parametrize("alpha", ROUGH)
@pytest.mark.parametrize("name", LOBES)
def test_no_more_is_reflected_than_arrives(name: str, alpha: float) -> None:
    """The albedo of mirrors, from above to grazing; Smith's is near 1 for smooth surfaces."""
    cosine, azimuth, weight = hemisphere(200)
    for view in (0.05, 0.3, 0.7, 1.0):
        v = vectors(np.full_like(cosine, view), np.zeros_like(cosine))
        # By reciprocity what a viewer sees of a white sky is what goes out of light from v.
        albedo = weight @ shape(LOBES[name](alpha), vectors(cosine, azimuth), v)
        assert albedo < 1 + 1e-3, f"from {view}: {albedo}"
        if name in SMITH and alpha == 0.1 and view == 1.0:
            assert albedo > 0.98


@pytest.mark.parametrize("name", LOBES)
def test_it_is_dark_behind_the_surface(name: str) -> None:
    lobe = LOBES[name](0.3)
    above, below = (
        vectors(np.array([0.5]), np.zeros(1)),
        Vec3(*map(jnp.asarray, ([0.8], [0.0], [-0.6]))),
    )
    grazing = Vec3(*map(jnp.asarray, ([0.995], [0.0], [-0.1])))  # h is above the surface
    pairs = (below, above), (above, below), (below, below), (above, -above), (above, grazing)
    for l, v in pairs:
        assert shape(lobe, l, v)[0] == 0


def test_no_facet_stands_upright() -> None:
    for versine in (1.0, 1 - 1e-7):
        found = distribution.beckmann(jnp.asarray(versine, float), jnp.asarray(0.05))
        assert float(found) == 0


def test_steep_facets_in_single_precision() -> None:
    """Derivatives of an exponent of 1e20 leave its range."""
    for versine in (1.0, 1 - 1e-7, 1 - 1e-6, 1 - 1e-4):
        at = jnp.asarray(np.float32(versine)), jnp.asarray(np.float32(1e-3))
        for slope in jax.tree.leaves(jax.hessian(distribution.beckmann, argnums=(0, 1))(*at)):
            assert jnp.isfinite(slope), versine


def test_the_slope_of_a_gaussian_at_its_peak(tolerance: float) -> None:
    """theta^2 is 2 (1 - cos) near 0, so that d log D is -2 / alpha^2, and its second 2 / 3 of that."""

    def log(versine: jax.Array) -> jax.Array:
        return jnp.log(distribution.gaussian(versine, jnp.asarray(0.3)))

    zero = jnp.zeros(())
    np.testing.assert_allclose(jax.grad(log)(zero), -2 / 0.09, rtol=10 * tolerance)
    np.testing.assert_allclose(jax.grad(jax.grad(log))(zero), -2 / 3 / 0.09, rtol=100 * tolerance)


def test_no_facet_hides_another_from_above() -> None:
    for shadow in (masking.beckmann_shadow, masking.rational_beckmann_shadow, masking.ggx_shadow):
        assert abs(float(shadow(jnp.ones(()), jnp.asarray(0.4)))) < 1e-12
    for cosine in (0.7, 0.9, 0.999):  # 1 / (alpha tan) is 2.4 and more
        rational = masking.rational_beckmann_shadow(jnp.asarray(cosine), jnp.asarray(0.4))
        assert float(rational) == 0


def test_conventions_of_the_lobe() -> None:
    """At the mirror direction of a head-on light s = D F / 4, D = 1 / (pi alpha^2)."""
    up = vectors(np.ones(1), np.zeros(1))
    found = shape(ds.GGX(1, 0.2, ds.Dielectric(1.5)), up, up)
    np.testing.assert_allclose(found, 0.04 / (4 * np.pi * 0.2**2), rtol=1e-5)


def test_a_boundary_that_is_absent_is_not_computed() -> None:
    """Without Fresnel and body there is not one operation more, and without G there are fewer."""
    gbuffer = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.4))
    scene = ds.Scene(lights=ds.ParallelLight((0, 0, 1)))

    def operations(material: ds.Material) -> int:
        text = jax.jit(lambda m: ds.render(gbuffer, scene, m)).lower(material).as_text()
        return len(text.splitlines())

    plain = operations(ds.Material(kd=0.5, specular=ds.GGX(0.5, 0.2)))
    assert operations(ds.Material(kd=0.5, specular=ds.GGX(0.5, 0.2, ds.Dielectric()))) > plain + 10
    coated = ds.Material(kd=0.5, specular=ds.GGX(0.5, 0.2), body=ds.FresnelBody())
    assert operations(coated) > plain + 20
    assert operations(ds.Material(specular=ds.GGX(0.5, 0.2))) < plain


def test_what_is_refused() -> None:
    with pytest.raises(BadInput, match=r"masking is 'smith': give one of 'height-correlated'"):
        ds.GGX(0.5, 0.2, masking="smith")  # type: ignore[arg-type]
    with pytest.raises(BadInput, match="facets in grooves have 'v-groove'"):
        ds.TorranceSparrow(0.5, 0.2, masking="separable")
    with pytest.raises(BadInput, match=r"alpha is -0\.2: it cannot be negative"):
        ds.GGX(0.5, -0.2)
    with pytest.raises(BadInput, match="a body is given without kd"):
        ds.Material(body=ds.FresnelBody())
