"""LIGHT-13 for general solvers: one flat vector of unknowns in, the image and its Jacobian out.

Written apart from the package, as somebody would who fits with SciPy, lmfit or Optax: geometry is
computed once, outside the solver, and residual and Jacobian are compiled. The unknowns are

    (ka_1 .. ka_C, kd_1 .. kd_C, ks_1 .. ks_C, n, c1, c2)   with I_a = 1 and c0 = 1.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

__all__ = ["Terms", "jacobian", "predict", "terms"]


class Terms(NamedTuple):
    """What does not depend on the unknowns, for L lights, P points and C channels."""

    n_dot_l: Array  # [L, P], 0 where the light is behind the surface
    log_r_dot_v: Array  # [L, P], 0 where the lobe is dark
    bright: Array  # [L, P], where it is not
    d: Array  # [L, P]
    intensity: Array  # [C, L]


@jax.jit
def terms(position: Array, normal: Array, lights: Array, intensity: Array) -> Terms:
    """From points and unit normals [3, P], lights at [L, 3] of intensity [L, C]; seen along z."""
    to_light = lights[:, :, None] - position[None]
    d = jnp.sqrt((to_light**2).sum(1))
    l = to_light / d[:, None]
    n_dot_l = (l * normal).sum(1)
    r_dot_v = 2 * n_dot_l * normal[2] - l[:, 2]
    bright = (n_dot_l > 0) & (r_dot_v > 0)
    log_r_dot_v = jnp.log(jnp.where(bright, r_dot_v, 1))
    return Terms(jnp.maximum(n_dot_l, 0), log_r_dot_v, bright, d, intensity.T)


def predict(unknowns: Array, at: Terms) -> Array:
    """The image [C * P], channel after channel."""
    ka, kd, ks, n, c1, c2 = _parts(unknowns)
    f = 1 / (1 + at.d * (c1 + c2 * at.d))
    lobe = jnp.where(at.bright, jnp.exp(n * at.log_r_dot_v), 0)
    reflected = kd[:, None, None] * at.n_dot_l + ks[:, None, None] * lobe
    return (ka[:, None] + (at.intensity[:, :, None] * f * reflected).sum(1)).ravel()


def jacobian(unknowns: Array, at: Terms) -> Array:
    """The derivatives [C * P, 3 C + 3], by hand: faster than what `jax.jacfwd` of `predict` makes."""
    _, kd, ks, n, c1, c2 = _parts(unknowns)
    channel_count, pixel_count = kd.size, at.d.shape[1]
    q = 1 + at.d * (c1 + c2 * at.d)
    lobe = jnp.where(at.bright, jnp.exp(n * at.log_r_dot_v), 0)
    lit = at.intensity[:, :, None] / q

    def own(column: Array) -> list[Array]:
        """A column for each channel, which is zero in the others."""
        parts = jnp.zeros((channel_count, channel_count, pixel_count), column.dtype)
        channel = jnp.arange(channel_count)
        return list(parts.at[channel, channel].set(column).reshape(channel_count, -1))

    reflected = kd[:, None, None] * at.n_dot_l + ks[:, None, None] * lobe
    falling = -lit / q * reflected * at.d
    return jnp.stack(
        [
            *own(jnp.ones((channel_count, pixel_count), lobe.dtype)),
            *own((lit * at.n_dot_l).sum(1)),
            *own((lit * lobe).sum(1)),
            (ks[:, None] * (lit * lobe * at.log_r_dot_v).sum(1)).ravel(),
            falling.sum(1).ravel(),
            (falling * at.d).sum(1).ravel(),
        ],
        axis=-1,
    )


def _parts(unknowns: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
    ka, kd, ks = unknowns[:-3].reshape(3, -1)
    n, c1, c2 = unknowns[-3:]
    return ka, kd, ks, n, c1, c2
