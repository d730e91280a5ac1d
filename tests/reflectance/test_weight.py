"""The weight W(theta) of a lobe, by the angle of incidence (text C)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import diffshade as ds
from diffshade.channels import Channels
from diffshade.reflectance.fresnel import AbstractFresnel

GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(24, 24, 2.2))
SCENE = ds.Scene(lights=ds.ParallelLight((0.7, 0.2, 0.5), (0.9, 0.8, 0.7)))


class Squared(AbstractFresnel):
    """Any function will do."""

    kind = "squared"

    def reflected(self, cosine: jax.Array) -> Channels:
        return (cosine * cosine,)


@pytest.mark.parametrize("lobe", [ds.Phong, ds.BlinnPhong])
@pytest.mark.parametrize("weight", [ds.Schlick((0.04, 0.2, 0.9)), ds.Dielectric(1.5), Squared()])
def test_it_multiplies_the_lobe(lobe: type, weight: AbstractFresnel, tolerance: float) -> None:
    plain = ds.render(GBUFFER, SCENE, ds.Material(specular=lobe(0.5, 12.0)))
    weighted = ds.render(GBUFFER, SCENE, ds.Material(specular=lobe(0.5, 12.0, weight)))
    l = np.array([0.7, 0.2, 0.5]) / np.sqrt(0.78)
    cosine = jnp.maximum(GBUFFER.normal.to_array() @ jnp.asarray(l, plain.dtype), 0)
    factor = [np.asarray(w) for w in weight.reflected(cosine)]
    expected = np.asarray(GBUFFER.from_image(plain)) * np.stack(factor)
    np.testing.assert_allclose(GBUFFER.from_image(weighted), expected, atol=tolerance)
    assert weighted.max() > 0.01


def test_kept_geometry_is_kept_for_it() -> None:
    plain, weighted = (
        ds.Material(specular=ds.Phong(0.5, 12.0, w)) for w in (None, ds.Schlick(0.04))
    )
    for a, b in ((plain, weighted), (weighted, plain)):
        kept = ds.keep_geometry(GBUFFER, SCENE, a)
        with pytest.raises(ds.BadInput, match="keep it for this scene and material"):
            ds.render(kept, SCENE, b)


def test_none_is_not_computed() -> None:
    def lines(lobe: ds.Phong) -> int:
        program = jax.jit(lambda m: ds.render(GBUFFER, SCENE, m))
        return len(program.lower(ds.Material(specular=lobe)).as_text().splitlines())

    assert lines(ds.Phong(0.5, 12.0, ds.Schlick())) > lines(ds.Phong(0.5, 12.0)) + 4


def test_a_tolerance_leaves_no_weighted_light_out(tolerance: float) -> None:
    """What a weight does at the most is not known."""
    rng = np.random.default_rng(2)
    places = rng.uniform(-3, 3, (40, 3)) + np.array([0.0, 0.0, 4.0])
    scene = ds.Scene(lights=[ds.PointLight(p, 0.1, ds.InverseSquare()) for p in places])
    material = ds.Material(kd=0.5, specular=ds.Phong(0.5, 12.0, ds.Schlick(0.04)))
    exact = ds.render(GBUFFER, scene, material)
    near = ds.render(GBUFFER, scene, material, tolerance=0.1)
    np.testing.assert_allclose(near, exact, atol=tolerance)
