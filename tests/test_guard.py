"""Every singularity: the value where it is finite, the stated one where it is not, both ways finite."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diffshade import guard
from diffshade.reflectance.blinn_phong import blinn_phong
from diffshade.reflectance.phong import phong
from diffshade.vector import Vec3, dot, length, unit

TINY = {
    "positive": (0.0, -1.0),
    "sqrt": (0.0, -1.0),
    "reciprocal_sqrt": (0.0, -1.0),
    "reciprocal": (0.0,),
}


@pytest.mark.parametrize(("name", "x"), [(n, x) for n, xs in TINY.items() for x in xs])
def test_zero_with_zero_derivatives_where_it_is_singular(name: str, x: float) -> None:
    f = getattr(guard, name)
    at = jnp.asarray(x, float)
    assert f(at) == 0
    assert jax.grad(f)(at) == 0
    assert jax.jacfwd(f)(at) == 0
    assert jax.hessian(f)(at) == 0


def test_the_textbook_function_elsewhere(tolerance: float) -> None:
    x = jnp.asarray([1e-12, 0.3, 1.0, 7.0, 1e9], float)
    host = np.asarray(x, float)
    for name, exact in (
        ("positive", host),
        ("sqrt", np.sqrt(host)),
        ("reciprocal_sqrt", 1 / np.sqrt(host)),
        ("reciprocal", 1 / host),
    ):
        np.testing.assert_allclose(getattr(guard, name)(x), exact, rtol=tolerance, err_msg=name)


@pytest.mark.parametrize("n", [0.0, 1e-3, 0.5, 1.0, 1.5, 2.0, 32.0, 400.0, 1e5])
@pytest.mark.parametrize("x", [-1.0, -1e-20, 0.0, 1e-30, 1e-12, 0.5, 0.999999, 1.0, 1.0000001])
def test_power_and_its_derivatives_are_finite(x: float, n: float) -> None:
    at = (jnp.asarray(x, float), jnp.asarray(n, float))
    values = [
        guard.power(*at),
        *jax.grad(guard.power, argnums=(0, 1))(*at),
        *jax.jacfwd(guard.power, argnums=(0, 1))(*at),
        *jax.tree.leaves(jax.hessian(guard.power, argnums=(0, 1))(*at)),
    ]
    assert all(np.isfinite(v) for v in values)
    if x <= 0:
        assert all(v == 0 for v in values)


def test_power_is_the_power(tolerance: float) -> None:
    x, n = np.meshgrid([1e-3, 0.2, 0.9, 1.0], [0.5, 1.0, 3.0, 40.0])
    found = guard.power(jnp.asarray(x, float), jnp.asarray(n, float))
    np.testing.assert_allclose(found, x**n, rtol=100 * tolerance, atol=1e-37)
    by_x, by_n = jax.vmap(jax.grad(guard.power, argnums=(0, 1)))(
        jnp.asarray(x.ravel(), float), jnp.asarray(n.ravel(), float)
    )
    np.testing.assert_allclose(by_x, (n * x ** (n - 1)).ravel(), rtol=100 * tolerance, atol=1e-37)
    np.testing.assert_allclose(by_n, (x**n * np.log(x)).ravel(), rtol=100 * tolerance, atol=1e-37)


def test_the_logarithm_of_what_is_left_of_one(tolerance: float) -> None:
    """To rounding however small q is; minus infinity with derivative 0 from q = 1 on."""
    q = jnp.asarray([0.0, 1e-30, 1e-9, 3e-8, 1e-4, 0.3, 0.9], float)
    host = np.asarray(q, float)
    np.testing.assert_allclose(guard.log_one_minus(q), np.log1p(-host), rtol=tolerance / 10)
    slopes = jax.vmap(jax.grad(guard.log_one_minus))(q)
    np.testing.assert_allclose(slopes, -1 / (1 - host), rtol=tolerance / 10)
    for dark in (1.0, 1.5):
        at = jnp.asarray(dark, float)
        assert guard.log_one_minus(at) == -jnp.inf
        assert jax.grad(guard.log_one_minus)(at) == 0
        assert jax.hessian(guard.log_one_minus)(at) == 0


@pytest.mark.parametrize(
    ("node", "at"),
    [
        (guard.reciprocal_sqrt, (0.0,)),
        (guard.reciprocal, (0.0,)),
        (guard.log_base, (0.3,)),
        (guard.log_one_minus, (1.0,)),
        (guard.log_one_minus, (0.3,)),
        (guard.power_of_log, (-np.inf, 2.0)),
        (guard.power_of_log, (-0.5, 2.0)),
    ],
)
def test_a_node_without_its_rule_has_the_same_derivatives(node: Any, at: Any) -> None:
    """JAX forgets the rule where a loop with a checkpoint is differentiated in reverse and again."""
    places = tuple(jnp.asarray(x, float) for x in at)
    every = tuple(range(len(at)))
    plain = node._f
    for derivative in (jax.grad, jax.hessian):
        ours, bare = derivative(node, every)(*places), derivative(plain, every)(*places)
        np.testing.assert_allclose(jax.tree.leaves(bare), jax.tree.leaves(ours), rtol=1e-5)


@pytest.mark.parametrize("lobe", [phong, blinn_phong])
@pytest.mark.parametrize("n", [0.0, 0.5, 1.0, 1e5])
def test_a_lobe_of_no_direction_is_dark(lobe: Any, n: float) -> None:
    """An eye at the surface, for Phong; light and view that cancel, for Blinn-Phong."""
    up, along = Vec3(*jnp.eye(3)[2]), Vec3(*jnp.asarray([0.6, 0.0, 0.8]))
    view = Vec3(*jnp.zeros(3)) if lobe is phong else -along

    def shade(l: Vec3, v: Vec3) -> jax.Array:
        return lobe(up, l, v, dot(up, l), jnp.asarray(n, float))

    assert shade(along, view) == 0
    for slope in jax.tree.leaves(jax.grad(shade, argnums=(0, 1))(along, view)):
        assert slope == 0


def test_a_unit_vector_of_any_length(tolerance: float) -> None:
    """Of lengths whose squares and fifth powers are out of range, too; what is shorter is zero."""
    least = guard.shortest(jnp.zeros(()))
    for size in (2 * least, least**0.5, 1.0, 1 / least):
        a = Vec3.from_array(jnp.asarray([0.6, 0, -0.8]) * size)
        np.testing.assert_allclose(unit(a).to_array(), [0.6, 0, -0.8], rtol=10 * tolerance)
        np.testing.assert_allclose(length(a), size, rtol=10 * tolerance)
    assert not np.any(unit(Vec3.from_array(jnp.asarray([0.6, 0, -0.8]) * least)).to_array())


def test_short_vectors_have_finite_derivatives() -> None:
    """The cube of 1/|s| overflows long before the derivative of s/|s| does."""
    for size in (1e-13, 1e-16, 2e-19):
        x = jnp.asarray([size, 0, 0], jnp.float32)
        for mode in (jax.jacfwd, jax.jacrev):
            slope = mode(lambda x: unit(Vec3.from_array(x)).to_array())(x)
            assert np.isfinite(slope).all(), (size, slope)


@pytest.mark.parametrize("name", ["sqrt", "reciprocal_sqrt", "log_base", "power_of_log"])
def test_arguments_are_harmless_whatever_a_selection_says(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """XLA may ask of one rounding of x, and compute with another: both ways round it is finite."""
    at = jnp.asarray([-jnp.inf, -1e-8, 0.0])
    arguments = (at, jnp.zeros_like(at)) if name == "power_of_log" else (at[1:],)
    monkeypatch.setattr(guard.jnp, "where", lambda asked, x, y: y)
    assert np.isfinite(getattr(guard, name)(*arguments)).all()


def test_a_reciprocal_leaves_room_for_products() -> None:
    """1/x of what is still a number is not: of the smallest ones it, or its product, is infinite."""
    at = jnp.asarray([2.0, 1e9]) * jnp.finfo(float).tiny
    assert np.all(guard.reciprocal(at) == 0)
    assert guard.reciprocal(jnp.asarray(-(2.0**-80))) == -(2.0**80)
