"""The profile of the residual over the shininess, against dense least squares."""

import jax
import numpy as np
from certified import GBUFFER, Case, case, dense_residual

import diffshade as ds
from fitting.profile import profile


def test_it_is_the_residual_of_dense_least_squares(rng: np.random.Generator) -> None:
    drawn = case(rng, light_count=3, noise=1e-3)
    curve = profile(drawn.observed, drawn.minimum, drawn.limit.box)
    assert curve.names == ("specular.0.shininess",)
    exact = [dense_residual(drawn, n) for n in curve.values]
    # float32 sums are good to 1e-6 of |y|^2 far from the minimum.
    allowed = 1e-9 if jax.config.jax_enable_x64 else 2e-4
    np.testing.assert_allclose(curve.relative_residual, exact, atol=allowed, rtol=allowed)


def test_the_minimum_is_a_node_and_the_lowest(rng: np.random.Generator) -> None:
    drawn = case(rng, light_count=1, noise=1e-3)
    curve = profile(drawn.observed, drawn.minimum, drawn.limit.box)
    low, high = (np.exp(float(edge[0])) for edge in drawn.limit.box)
    np.testing.assert_allclose(curve.values[[0, -1]], (low, high), rtol=1e-5)
    assert (np.diff(curve.values) > 0).all()
    best = np.exp(float(drawn.minimum.u[0]))
    at = np.argmin(curve.relative_residual)
    # rounding may prefer a neighbour in float32
    np.testing.assert_allclose(
        curve.values[at], best, rtol=1e-5 if jax.config.jax_enable_x64 else 5e-3
    )


def test_each_of_two_lobes_has_its_own(rng: np.random.Generator) -> None:
    lights = tuple(ds.ParallelLight(direction) for direction in ((0, 0.4, 1), (0.7, -0.3, 1)))
    scene = ds.Scene(ambient=0.4, lights=lights)
    lobes = ds.Phong(ks=0.3, shininess=120.0), ds.Phong(ks=0.2, shininess=8.0)
    image = ds.render(GBUFFER, scene, ds.Material(ka=0.1, kd=0.5, specular=lobes))
    start = ds.Material(ka=0.5, kd=0.5, specular=lobes)
    drawn = Case.of(np.asarray(image), scene, start)
    for which, n in enumerate((120, 8)):
        curve = profile(drawn.observed, drawn.minimum, drawn.limit.box, which=which)
        assert curve.names == (f"specular.{which}.shininess",)
        at = np.argmin(curve.relative_residual)
        np.testing.assert_allclose(curve.values[at], n, rtol=1e-2)
        assert curve.relative_residual[[0, -1]].min() > 1e-3 > curve.relative_residual[at]
