"""The spot light: how it falls off with the angle, and where it ends."""

import jax.numpy as jnp
import numpy as np
import pytest

import diffshade as ds
from diffshade.errors import BadInput

X = np.linspace(-2, 2, 41)
FLOOR = ds.GBuffer.from_arrays(
    np.stack([np.broadcast_to(X, (1, 41)), np.zeros((1, 41)), np.zeros((1, 41))], axis=-1),
    np.tile([0.0, 0.0, 1.0], (1, 41, 1)),
)
ABOVE = (0.0, 0.0, 1.5)


def lit(light: object) -> np.ndarray:
    return np.asarray(ds.render(FLOOR, ds.Scene(lights=light), ds.Material(kd=1.0)))[0, :, 0]


@pytest.mark.parametrize("exponent", [0.0, 1.0, 2.5, 40.0])
def test_a_power_of_the_cosine(exponent: float, tolerance: float) -> None:
    """Straight down from above: cos of the ray is n.l."""
    cosine = 1.5 / np.sqrt(1.5**2 + X**2)
    found = lit(ds.SpotLight(ABOVE, (0, 0, -2), 0.8, exponent))
    np.testing.assert_allclose(found, 0.8 * cosine ** (1 + exponent), atol=10 * tolerance)


def test_it_ends_at_the_cutoff() -> None:
    angle = np.arctan(np.abs(X) / 1.5)
    found = lit(ds.SpotLight(ABOVE, (0, 0, -1), cutoff=0.5, exponent=0))
    assert (found[angle > 0.501] == 0).all()
    assert (found[angle < 0.499] > 0).all()


def test_it_does_not_shine_back(tolerance: float) -> None:
    assert (lit(ds.SpotLight(ABOVE, (0, 0, 1))) == 0).all()
    assert (lit(ds.SpotLight(ABOVE, (0, 0, 0))) == 0).all()
    sideways = lit(ds.SpotLight(ABOVE, (1, 0, 0)))
    assert (sideways[X < -1e-9] == 0).all()
    assert (sideways[X > 0.1] > 0).all()


def test_an_even_one_is_a_point_light(tolerance: float) -> None:
    """Exponent 0 shines alike to the whole half space."""
    law = ds.QuadraticAttenuation(0.5, 0.1, 0.2)
    spot = ds.SpotLight(ABOVE, (0, 0, -1), (0.2, 0.4, 0.9), 0.0, attenuation=law)
    point = ds.PointLight(ABOVE, (0.2, 0.4, 0.9), law)
    np.testing.assert_allclose(lit(spot), lit(point), atol=tolerance)


def test_many_and_a_tolerance(tolerance: float) -> None:
    """Lights are gathered by kind, and left out within a tolerance, spots too."""
    rng = np.random.default_rng(6)
    spots = [
        ds.SpotLight(p, d, 0.1, 3.0, attenuation=ds.Windowed(ds.InverseSquare(), 3.0))
        for p, d in zip(
            rng.uniform(-2, 2, (70, 3)) + np.array([0, 0, 2.1]),
            rng.normal(size=(70, 3)),
            strict=True,
        )
    ]
    one_by_one = sum(lit(spot) for spot in spots)
    np.testing.assert_allclose(lit(spots), one_by_one, atol=100 * tolerance)
    material = ds.Material(kd=1.0)
    near = ds.render(FLOOR, ds.Scene(lights=spots), material, tolerance=0.01)
    assert np.abs(np.asarray(near)[0, :, 0] - one_by_one).max() <= 0.01


def test_what_is_refused() -> None:
    with pytest.raises(BadInput, match=r"the light's exponent is -1\.: it cannot be negative"):
        ds.SpotLight(ABOVE, (0, 0, -1), exponent=-1)
    with pytest.raises(BadInput, match="cutoff is 30: give an angle in radians, up to pi/2"):
        ds.SpotLight(ABOVE, (0, 0, -1), cutoff=30)
    flat = ds.GBuffer.from_arrays(None, np.tile([0.0, 0.0, 1.0], (2, 2, 1)))
    with pytest.raises(BadInput, match="needs positions"):
        ds.render(flat, ds.Scene(lights=ds.SpotLight(ABOVE, (0, 0, -1))), ds.Material(kd=1.0))


def test_kept_geometry_knows_where_it_shines(tolerance: float) -> None:
    scene = ds.Scene(lights=ds.SpotLight(ABOVE, (0.3, 0, -1), 0.7, 5.0))
    material = ds.Material(kd=0.5, specular=ds.Phong(0.2, 9.0))
    kept = ds.keep_geometry(FLOOR, scene, material)
    np.testing.assert_allclose(
        ds.render(kept, scene, material), ds.render(FLOOR, scene, material), atol=tolerance
    )
    assert jnp.isfinite(ds.render(kept, scene, material)).all()
