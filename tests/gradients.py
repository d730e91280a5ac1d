"""Forward mode, reverse mode and finite differences of one function, held against each other."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

STEP = 1e-3


def check_gradients(
    f: Callable[[Any], jax.Array],
    cases: Sequence[Any],
    *,
    steps: Sequence[float] | float = STEP,
) -> list[Any]:
    """Assert that all three derivatives of f agree at every case, and return |df/dinputs|.

    A case is a tree of float arrays; all have one structure, so that one program serves them. What
    comes back, a case each, is that tree with the largest derivative of any output by each number.
    The finite difference is the central one of sixth order, whose error at this step is that of
    rounding, about 1e-12 of the value over the step.
    """
    unravel = ravel_pytree(cases[0])[1]
    flat = np.stack([np.asarray(ravel_pytree(case)[0]) for case in cases])
    size = flat.shape[1]

    def g(x: jax.Array) -> jax.Array:
        return jnp.ravel(f(unravel(x)))

    forward = np.asarray(jax.jit(jax.vmap(jax.jacfwd(g)))(flat))
    reverse = np.asarray(jax.jit(jax.vmap(jax.jacrev(g)))(flat))
    assert np.isfinite(forward).all(), "forward mode is not finite"
    assert np.isfinite(reverse).all(), "reverse mode is not finite"

    values = jax.jit(jax.vmap(jax.vmap(g)))
    step = np.broadcast_to(steps, len(cases))[:, None, None]
    moves = np.concatenate([k * np.eye(size) for k in (-3, -2, -1, 1, 2, 3)])
    moved = np.asarray(values(flat[:, None] + step * moves))
    a, b, c, d, e, h = np.split(moved, 6, axis=1)
    finite = np.moveaxis(((h - a) - 9 * (e - b) + 45 * (d - c)) / (60 * step), 1, 2)

    for k in range(len(cases)):
        scale = np.max(np.abs(forward[k]), initial=1e-3)
        np.testing.assert_allclose(forward[k], reverse[k], rtol=0, atol=1e-11 * scale)
        np.testing.assert_allclose(forward[k], finite[k], rtol=0, atol=2e-7 * scale)
    return [unravel(jnp.asarray(np.abs(case).max(axis=0))) for case in forward]


def dead_inputs(largest: Any) -> list[str]:
    """Which inputs of a case nothing depends on, by path."""
    leaves = jax.tree_util.tree_leaves_with_path(largest)
    return [jax.tree_util.keystr(path) for path, leaf in leaves if not np.any(np.asarray(leaf) > 0)]
