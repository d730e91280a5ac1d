"""Small least squares under bounds, exactly: the linear coefficients of one channel."""

from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

__all__ = ["bounded_least_squares", "solve_positive"]

FREE, AT_LOWER, AT_UPPER = 0, 1, 2


def bounded_least_squares(
    gram: Float[Array, "p p"],
    moment: Float[Array, "p"],
    lower: Float[Array, "p"],
    upper: Float[Array, "p"],
) -> tuple[Float[Array, "p"], Bool[Array, "p"]]:
    """The k that minimises k'Gk/2 - g'k within lower <= k <= upper, and which of its entries are free.

    G = A'A and g = A'y are the Gram matrix and the moment of least squares. p is small (one
    coefficient a term), so each of the 3^p ways to hold entries at a bound is solved and the best
    feasible one taken: exact, with no iteration and no start. An entry whose column is zero is held
    at its lower bound, or at 0; equal bounds hold an entry at their value.
    """
    p = gram.shape[0]
    dtype = gram.dtype
    scale_squared = jnp.diagonal(gram)
    seen = scale_squared > 0
    scale = jnp.sqrt(jnp.where(seen, scale_squared, 1))
    g_scaled = gram / jnp.outer(scale, scale)
    m_scaled = moment / scale
    # In units where every column has norm 1
    low, high = lower * scale, upper * scale
    rest = jnp.clip(jnp.zeros(p, dtype), low, high)
    at_lower = jnp.where(jnp.isfinite(low), low, rest)
    at_upper = jnp.where(jnp.isfinite(high), high, rest)
    slack = 8 * jnp.finfo(dtype).eps

    def candidate(state: Array) -> tuple[Array, Array, Array]:
        held = (state != FREE) | ~seen
        value = jnp.where(state == AT_UPPER, at_upper, at_lower)
        value = jnp.where(held, jnp.where(seen, value, rest), 0)
        free = (~held).astype(dtype)
        matrix = g_scaled * jnp.outer(free, free) + jnp.diag(1 - free)
        k = value + solve_positive(matrix, free * (m_scaled - g_scaled @ value)) * free
        tolerance = slack * (1 + jnp.abs(k))
        inside = jnp.all(held | ((k >= low - tolerance) & (k <= high + tolerance)))
        missing = jnp.any((state == AT_LOWER) & ~jnp.isfinite(low) & seen)
        missing = missing | jnp.any((state == AT_UPPER) & ~jnp.isfinite(high) & seen)
        k = jnp.clip(k, low, high)  # takes away no more than the slack
        cost = 0.5 * k @ g_scaled @ k - m_scaled @ k
        return k, held, jnp.where(inside & ~missing & jnp.isfinite(cost), cost, jnp.inf)

    states = jnp.asarray(np.array(list(product((FREE, AT_LOWER, AT_UPPER), repeat=p))))
    ks, helds, costs = jax.vmap(candidate)(states)
    best = jnp.argmin(costs)
    return ks[best] / scale, ~helds[best]


def solve_positive(
    matrix: Float[Array, "n n"], right: Float[Array, "n *m"]
) -> Float[Array, "n *m"]:
    """Solve a symmetric positive definite system; NaN where it is not one.

    Gauss and Jordan's elimination, which needs no pivoting here: under `vmap` over many systems of
    a handful of unknowns a library call for each would cost a hundred times as much.
    """
    n = len(matrix)
    table = jnp.concatenate([matrix, right.reshape(n, -1)], axis=1)

    def eliminate(j: Array, table: Array) -> Array:
        at_j = jnp.arange(n) == j
        pivot = table[j, j]
        row = table[j] / jnp.where(pivot > 0, pivot, jnp.nan)
        rest = table - jnp.outer(jnp.where(at_j, 0, table[:, j]), row)
        return jnp.where(at_j[:, None], row[None], rest)

    return lax.fori_loop(0, n, eliminate, table)[:, n:].reshape(right.shape)
