"""How the facets of a rough surface are inclined: densities D of their normals h about n.

D integrates to 1 over projected solid angles, D (n.h) dh. All are functions of 1 - n.h, which keeps what
is lost of n.h where the facet lies almost flat, and of the roughness alpha.
"""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from diffshade import guard

__all__ = ["beckmann", "gaussian", "ggx"]

Plane = Float[Array, "..."]


def ggx(versine: Plane, alpha: Plane) -> Plane:
    """D = alpha^2 / (pi (alpha^2 cos^2 + sin^2)^2), of Trowbridge and Reitz (1975), Walter (2007)."""
    cosine = 1 - versine
    width = alpha * cosine
    across = guard.ratio(alpha, width * width + _squared_sine(versine))
    return across * across / math.pi


def beckmann(versine: Plane, alpha: Plane) -> Plane:
    """D = exp(-tan^2 / alpha^2) / (pi alpha^2 cos^4) (Beckmann 1963, Cook and Torrance 1982).

    0, with derivative 0, for facets that stand upright.
    """
    cosine2 = (1 - versine) * (1 - versine)
    scale = guard.ratio(jnp.ones_like(versine), alpha * cosine2)
    exponent = _squared_sine(versine) * cosine2 * scale * scale
    return jnp.exp(-exponent) * scale * scale / math.pi


def gaussian(versine: Plane, alpha: Plane) -> Plane:
    """D = exp(-(theta / alpha)^2) / (pi alpha^2), theta the angle between h and n.

    The distribution of Torrance and Sparrow (1967), whose constant is free: with this one the integral
    is 1 for small alpha, 1 - 2 alpha^2 / 3 to the next order.
    """
    scale = guard.ratio(jnp.ones_like(versine), alpha * jnp.ones_like(versine))
    exponent = _squared_angle(versine) * scale * scale
    return jnp.exp(-exponent) * scale * scale / math.pi


def _squared_sine(versine: Plane) -> Plane:
    return versine * (2 - versine)


def _squared_angle(versine: Plane) -> Plane:
    """theta^2 from 1 - cos theta: arcsin's own derivatives are infinite at both ends."""
    near = float(jnp.finfo(versine.dtype).eps) ** (1 / 3)
    series = versine * (2 + versine * (1 / 3 + versine * (4 / 45)))
    half = jnp.sqrt(jnp.clip(0.5 * versine, 0.5 * near, 0.5))  # n.h >= 0: theta <= pi / 2
    angle = 2 * jnp.arcsin(half)
    return jnp.where(versine < near, series, angle * angle)
