"""How much of a rough surface's facets the light reaches and the viewer sees: geometric attenuation G.

Everything here is G / (4 n.v), which is finite where n.v and n.l vanish and G alone over them is not.
Smith's (1967) is built of one function of a direction, A(c) = c Lambda(c) for its cosine c with n:

    G_1(c) = 1 / (1 + Lambda(c)) = c / (c + A(c))
"""

import math

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from diffshade import guard

__all__ = [
    "beckmann_shadow",
    "ggx_shadow",
    "height_correlated",
    "rational_beckmann_shadow",
    "separable",
    "v_groove",
]

Plane = Float[Array, "..."]

STEEP = 12.0
"""1 / (alpha tan theta) beyond which no facet hides another, to any precision."""


def ggx_shadow(cosine: Plane, alpha: Plane) -> Plane:
    """A = (sqrt(c^2 + alpha^2 (1 - c^2)) - c) / 2 of GGX's facets (Walter et al. 2007, 34)."""
    width = alpha * alpha * (1 - cosine * cosine)
    return 0.5 * guard.ratio(width, guard.sqrt(cosine * cosine + width) + cosine)


def beckmann_shadow(cosine: Plane, alpha: Plane) -> Plane:
    """A = c (erf(t) - 1) / 2 + alpha s exp(-t^2) / (2 sqrt(pi)), t = c / (alpha s), s^2 = 1 - c^2.

    Of Beckmann's facets (Walter et al. 2007, 26).
    """
    t, width = _steepness(cosine, alpha)
    return 0.5 * (width * jnp.exp(-t * t) / math.sqrt(math.pi) - cosine * lax.erfc(t))


def rational_beckmann_shadow(cosine: Plane, alpha: Plane) -> Plane:
    """The same by a rational function, to 0.4 % of G_1 (Walter et al. 2007, 27).

    A = alpha s (1 - 1.259 t + 0.396 t^2) / (3.535 + 2.181 t), and 0 from t = 1.6 on, where it jumps by
    6e-5 of c: the derivative is that of either side.
    """
    t, width = _steepness(cosine, alpha)
    t = jnp.minimum(t, 1.6)
    near = width * (1 + t * (0.396 * t - 1.259)) / (3.535 + 2.181 * t)
    return jnp.where(t >= 1.6, 0, near)


def separable(n_dot_l: Plane, n_dot_v: Plane, of_l: Plane, of_v: Plane) -> Plane:
    """G = G_1(n.l) G_1(n.v): light and viewer are hidden independently (Walter et al. 2007, 23)."""
    return 0.25 * guard.ratio(n_dot_l, n_dot_l + of_l) * guard.reciprocal(n_dot_v + of_v)


def height_correlated(n_dot_l: Plane, n_dot_v: Plane, of_l: Plane, of_v: Plane) -> Plane:
    """G = 1 / (1 + Lambda(n.l) + Lambda(n.v)): high facets are lit and seen together (Heitz 2014, 99)."""
    return 0.25 * guard.ratio(n_dot_l, n_dot_l * (n_dot_v + of_v) + n_dot_v * of_l)


def v_groove(n_dot_l: Plane, n_dot_v: Plane, n_dot_h: Plane, v_dot_h: Plane) -> Plane:
    """G = min(1, 2 (n.h)(n.v) / v.h, 2 (n.h)(n.l) / v.h), of symmetric V-shaped grooves.

    (Torrance and Sparrow 1967, Cook and Torrance 1982.) Not smooth where two of the three are equal;
    there the derivative is that of the side on which the viewer is not hidden.
    """
    slope = guard.ratio(2 * n_dot_h, v_dot_h)
    lit = jnp.where(slope * n_dot_l < 1, slope * n_dot_l, 1)
    hidden = slope * n_dot_v < lit
    return 0.25 * jnp.where(hidden, slope, guard.ratio(lit, n_dot_v))


def _steepness(cosine: Plane, alpha: Plane) -> tuple[Plane, Plane]:
    """t = c / (alpha s), up to `STEEP`, and alpha s."""
    width = alpha * guard.sqrt(1 - cosine * cosine)
    return cosine * guard.reciprocal(jnp.maximum(width, cosine / STEEP)), width
