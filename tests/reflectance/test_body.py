"""A body under a boundary: its formula, its limits, and how a render has it."""

import jax.numpy as jnp
import numpy as np
from test_fresnel import amplitudes

import diffshade as ds


def test_light_passes_the_boundary_twice(tolerance: float) -> None:
    """I = k_d n.l T(n.l) T(n.v), with T by the amplitudes."""
    gbuffer = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(32, 32, 2.2))
    l = np.array([0.6, 0.0, 0.8])
    material = ds.Material(kd=(0.5, 0.3), body=ds.FresnelBody((1.5, 1.2)))
    image = ds.render(gbuffer, ds.Scene(lights=ds.ParallelLight(l)), material)
    n = np.asarray(gbuffer.normal.to_array(), float)
    lit, seen = np.maximum(n @ l, 0), n[:, 2]
    for channel, (kd, index) in enumerate(((0.5, 1.5), (0.3, 1.2))):
        passed = (1 - amplitudes(lit, index)) * (1 - amplitudes(seen, index))
        found = np.asarray(gbuffer.from_image(image))[channel]
        np.testing.assert_allclose(found, kd * lit * passed, atol=10 * tolerance)


def test_without_a_change_of_index_it_is_lambert(tolerance: float) -> None:
    gbuffer = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(16, 16, 2.2))
    scene = ds.Scene(lights=ds.PointLight((1, 2, 3), 0.8))
    plain = ds.render(gbuffer, scene, ds.Material(kd=0.5))
    coated = ds.render(gbuffer, scene, ds.Material(kd=0.5, body=ds.FresnelBody(1.0)))
    np.testing.assert_allclose(coated, plain, atol=tolerance)


def test_kept_geometry_and_basis_know_it(tolerance: float) -> None:
    gbuffer = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(16, 16, 2.2))
    scene = ds.Scene(ambient=0.1, lights=ds.PointLight((1, 2, 3), 0.8))
    material = ds.Material(0.2, 0.5, ds.GGX(0.4, 0.2, ds.Dielectric(1.4)), body=ds.FresnelBody(1.4))
    image = ds.render(gbuffer, scene, material)
    kept = ds.keep_geometry(gbuffer, scene, material)
    np.testing.assert_allclose(ds.render(kept, scene, material), image, atol=tolerance)
    planes = jnp.stack(ds.contract(ds.basis(gbuffer, scene, material), material))
    np.testing.assert_allclose(planes, gbuffer.from_image(image), atol=tolerance)
