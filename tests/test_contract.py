"""Every public function has finite values and derivatives, and at every kink a stated derivative."""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from contract import CONTRACT, NO_FLOATS, exported, failure, finite
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from strategies import LONGEST, Deck, decks, scenes

import diffshade as ds
from diffshade import guard
from diffshade.colour.device import rgb_to_hls, rgb_to_hsv
from diffshade.geometry.normals import angle_weights, plane_normals
from diffshade.reflectance.blinn_phong import blinn_phong
from diffshade.reflectance.lambert import lambert
from diffshade.reflectance.phong import phong
from diffshade.vector import Vec3, direction, halfway, length, unit

COUNT = 250
"""Cases that one program computes at once."""


def test_every_public_name_is_covered_once() -> None:
    covered = [name for names in CONTRACT for name in names] + list(NO_FLOATS)
    assert sorted(covered) == sorted(set(exported()))


@cache
def program(names: tuple[str, ...]) -> Callable[[Any], jax.Array]:
    return finite(CONTRACT[names])


@pytest.mark.slow
@pytest.mark.parametrize("names", CONTRACT, ids="-".join)
@given(data=st.data())
@settings(
    max_examples=4,
    deadline=None,
    derandomize=True,
    phases=(Phase.explicit, Phase.generate, Phase.shrink),
    suppress_health_check=list(HealthCheck),
)
def test_values_and_derivatives_are_finite(names: tuple[str, ...], data: Any) -> None:
    deck: Deck = data.draw(decks(COUNT, jax.dtypes.canonicalize_dtype(float)))
    cases = CONTRACT[names].cases(deck)
    found = failure(cases, np.asarray(program(names)(cases)))
    assert found is None, f"{'/'.join(names)}: {found}"


@pytest.mark.slow
def test_a_page_is_finite_as_one_pixel_is() -> None:
    """Large images take the way of `fusion`, where the nodes of a derivative are stored."""
    deck = Deck([0.3, 1e-7], seed=1, count=2**14, dtype=jax.dtypes.canonicalize_dtype(float))
    case = scenes(deck)
    place, eye = np.array([0.5, 0.25, 1.0]), np.array([0.0, 0.25, 1.0])
    position = deck.tied(0.2, [place + 0 * case["place"], eye + 0 * case["eye"]], case["position"])
    some = case["normal"].any(axis=1, keepdims=True)  # zero normals of values are refused
    normal = np.where(some, case["normal"], np.array([0.0, 0.0, 1.0]))
    rows = (x.reshape(128, 128, 3) for x in (position, normal))
    laws = (ds.QuadraticAttenuation(1.0, 0.0, 0.0), ds.InverseSquare(), None)
    scene = ds.Scene(0.1, [ds.PointLight(place, (0.5, 0.6, 0.7), law) for law in laws])
    lobes = (ds.Phong(0.4, 0.5), ds.BlinnPhong(0.4, 1e4))
    everything = (*rows, eye, scene, ds.Material(0.1, 0.2, lobes))
    observed = jnp.ones((128, 128, 3))

    def pixels(position: Any, normal: Any, eye: Any) -> ds.GBuffer:
        return ds.GBuffer.from_arrays(position, normal, np.ones((128, 128), bool), eye=eye)

    def radiance(position: Any, normal: Any, eye: Any, scene: Any, material: Any) -> jax.Array:
        return ds.render(pixels(position, normal, eye), scene, material)

    def light(*inputs: Any) -> jax.Array:
        return radiance(*inputs).sum()

    def error(*inputs: Any) -> jax.Array:
        position, normal, eye, scene, material = inputs
        return ds.mean_squared_error(pixels(position, normal, eye), scene, material, observed)

    inputs = jax.tree.map(jnp.asarray, everything)
    tangents = jax.tree.map(jnp.ones_like, inputs)
    assert np.isfinite(radiance(*inputs)).all()
    assert np.isfinite(jax.jvp(radiance, inputs, tangents)[1]).all()
    for f in (light, error):
        slopes = jax.jit(jax.grad(f, argnums=range(5)))(*inputs)
        assert all(np.isfinite(x).all() for x in jax.tree.leaves(slopes)), f.__name__


class Kink(NamedTuple):
    """A function, where it is not smooth, and the derivative by each argument that is taken there."""

    f: Callable[..., Any]
    at: tuple[Any, ...]
    slope: Any


X, Y, Z, ZERO = np.eye(3)[0], np.eye(3)[1], np.eye(3)[2], np.zeros(3)


def of_arrays(f: Callable[..., Any]) -> Callable[..., Any]:
    """A function of vectors as one of arrays."""

    def g(*arrays: Any) -> Any:
        found = f(*map(Vec3.from_array, arrays))
        return found.to_array() if isinstance(found, Vec3) else found

    return g


def lobe(formula: Callable[..., Any], shininess: float) -> Callable[..., Any]:
    def f(n: Any, l: Any, v: Any) -> jax.Array:
        a, b, c = map(Vec3.from_array, (n, l, v))
        return formula(a, b, c, n @ l, jnp.asarray(shininess, n.dtype))

    return f


def quadratic(c: jax.Array, d: jax.Array) -> jax.Array:
    return ds.QuadraticAttenuation(*c)(d)


def lit(place: jax.Array, position: jax.Array, normal: jax.Array) -> jax.Array:
    g = ds.GBuffer.from_arrays(position[None, None], normal[None, None], np.ones((1, 1), bool))
    material = ds.Material(kd=0.5, specular=ds.Phong(0.5, 2.0))
    light = ds.PointLight(place, 1.0, ds.InverseSquare())
    return ds.render(g, ds.Scene(lights=light), material)[0, 0, 0]


def outline(center: jax.Array, radius: jax.Array) -> jax.Array:
    camera = ds.OrthographicCamera(4, 1, 4.0)  # the first pixel's centre is at x = -1.5
    seen = ds.visibility(ds.Sphere(radius=1.5), camera)
    return ds.gbuffer(ds.Sphere(center, radius), camera, seen).position.to_array()[0]


FAR = LONGEST[jnp.zeros(()).dtype.name]

KINKS = {
    "n.l = 0, diffuse": Kink(lambert, (0.0,), 0),
    **{
        f"r.v = 0, n = {n}": Kink(lobe(phong, n), (Z, Z, X), (0, 0, 0))
        for n in (0.0, 0.5, 1.0, 9.0)
    },
    **{
        f"l = -v, n = {n}": Kink(
            lobe(blinn_phong, n), (Z, 0.6 * X + 0.8 * Z, -0.6 * X - 0.8 * Z), (0, 0, 0)
        )
        for n in (0.0, 0.5)
    },
    "n.l = 0, Phong": Kink(lobe(phong, 5.0), (Z, X, -X), (0, 0, 0)),
    "n.l = 0, Blinn-Phong": Kink(lobe(blinn_phong, 5.0), (Z, X, Z), (0, 0, 0)),
    "n = 0 in the light": Kink(guard.power, (0.5, 0.0), (0, np.log(0.5))),
    "n = 0 in the dark": Kink(guard.power, (-0.5, 0.0), (0, 0)),
    "the edge of the clamp": Kink(quadratic, (X, 2.0), ([-1, -2, -4], 0)),
    "within the clamp": Kink(quadratic, (0.5 * X, 2.0), ([0, 0, 0], 0)),
    "no distance": Kink(ds.InverseSquare(), (0.0,), 0),
    "no denominator": Kink(lambda c, d: ds.LinearAttenuation(*c)(d), (X[:2] * 0, 2.0), (0, 0)),
    "the end of the reach": Kink(
        lambda reach, d: ds.Windowed(ds.InverseSquare(), reach)(d), (2.0, 2.0), (0, 0)
    ),
    "far beyond the reach": Kink(
        lambda reach, d: ds.Windowed(ds.InverseSquare(), reach)(d), (1 / FAR, FAR), (0, 0)
    ),
    "the silhouette": Kink(outline, (ZERO, 1.5), (np.diag(Z), 0)),
    "the light at the surface": Kink(lit, (X, X, Z), (0, 0, 0)),
    "the light in the tangent plane": Kink(lit, (X, ZERO, Z), (0, 0, 0)),
    "|a| at zero": Kink(of_arrays(length), (ZERO,), 0),
    "a / |a| at zero": Kink(of_arrays(unit), (ZERO,), 0),
    "no way": Kink(of_arrays(direction), (ZERO,), 0),
    "opposite vectors": Kink(of_arrays(halfway), (X, -X), (0, 0)),
    "all but opposite vectors": Kink(of_arrays(halfway), (X, 1e-9 * Y - X), (0, 0)),
    "an angle of a face without extent": Kink(
        of_arrays(lambda *corners: angle_weights(*corners)[0]),
        (X[None], X[None], Y[None]),
        (0, 0, 0),
    ),
    # Value and lightness are shared among equals
    "grey in HSV": Kink(
        lambda rgb: rgb_to_hsv(rgb)[::2], (0.25 * (X + Y + Z),), [[0] * 3, [1 / 3] * 3]
    ),
    "black in HSV": Kink(rgb_to_hsv, (ZERO,), [[0] * 3, [0] * 3, [1 / 3] * 3]),
    "grey in HLS": Kink(
        lambda rgb: rgb_to_hls(rgb)[:2], (0.25 * (X + Y + Z),), [[0] * 3, [1 / 3] * 3]
    ),
    "white in HLS": Kink(rgb_to_hls, (X + Y + Z,), [[0] * 3, [1 / 3] * 3, [0] * 3]),
    "a face without area": Kink(of_arrays(plane_normals), (X, X, Y), (0, 0, 0)),
}


@pytest.mark.parametrize("name", KINKS)
def test_the_derivative_at_a_kink_is_the_stated_one(name: str, tolerance: float) -> None:
    kink = KINKS[name]
    at = tuple(jnp.asarray(x, float) for x in kink.at)
    slopes = kink.slope if isinstance(kink.slope, tuple) else (kink.slope,)
    for mode in (jax.jacfwd, jax.jacrev):
        found = jax.jit(mode(kink.f, argnums=tuple(range(len(at)))))(*at)
        for slope, expected in zip(found, slopes, strict=True):
            assert np.isfinite(slope).all()
            np.testing.assert_allclose(
                slope, np.broadcast_to(expected, slope.shape), rtol=tolerance, atol=tolerance
            )
