"""How far two materials are apart, over the angles of light and viewer."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diffshade.channels import pairs
from diffshade.export.response import AbstractResponse
from diffshade.vector import Vec3

__all__ = ["INCIDENCE", "AngularError", "angular_error"]

INCIDENCE = (0.0, 30.0, 60.0, 80.0)
"""Degrees from the normal to the light."""


class AngularError(NamedTuple):
    """For light from each angle of incidence, over all directions to a viewer above the surface."""

    incidence: tuple[float, ...]
    """In degrees."""
    relative_rms: tuple[float, ...]
    """The norm of the difference over that of the exact radiance, by solid angle, over all channels."""
    largest: tuple[float, ...]
    """The largest difference in parts of the largest radiance."""

    def lines(self) -> tuple[str, ...]:
        """The same in words, for a comment."""

        def row(values: tuple[float, ...]) -> str:
            return ", ".join(f"{value:.2g}" for value in values)

        return (
            f"light at {row(self.incidence)} degrees from the normal, over all directions to the viewer:",
            f"error, root mean square, relative: {row(self.relative_rms)}",
            f"error, largest, in parts of the brightest: {row(self.largest)}",
        )


def angular_error(
    exact: AbstractResponse,
    other: AbstractResponse,
    incidence: tuple[float, ...] = INCIDENCE,
    *,
    steps: int = 192,
) -> AngularError:
    """How far `other` is from `exact`.

        sqrt(integral |a - b|^2 dv / integral |a|^2 dv)   and   max |a - b| / max |a|

    over v above the surface, by `steps` angles from the mirrored light, close together near it, and a
    quarter as many around. With 192 both are right to 1 % for exponents up to 10,000.
    """
    rms, largest = [], []
    for degrees in incidence:
        found = _norms(exact, other, *_directions(np.radians(degrees), steps))
        difference, whole, far, most = (float(x) for x in found)
        rms.append(float(np.sqrt(difference / whole)) if whole else 0.0)
        largest.append(far / most if most else 0.0)
    return AngularError(tuple(incidence), tuple(rms), tuple(largest))


def _norms(
    exact: AbstractResponse,
    other: AbstractResponse,
    l: Vec3,
    v: Vec3,
    weight: Float[Array, "P"],
) -> tuple[Array, ...]:
    both = pairs(exact(l, v), other(l, v))
    seen = weight > 0
    return (
        sum((jnp.sum(weight * (a - b) ** 2) for a, b in both), start=jnp.zeros(())),
        sum((jnp.sum(weight * a * a) for a, _ in both), start=jnp.zeros(())),
        jnp.stack([jnp.max(jnp.abs(a - b), where=seen, initial=0) for a, b in both]).max(),
        jnp.stack([jnp.max(a, where=seen, initial=0) for a, _ in both]).max(),
    )


def _directions(incidence: float, steps: int) -> tuple[Vec3, Vec3, Float[Array, "P"]]:
    """l, and v with its solid angle, in polar angles theta = pi u^3, phi about the mirrored light.

    Half a turn around: the other half is alike. Solid angles below the surface are 0.
    """
    around = steps // 4
    u, phi = np.meshgrid(
        (np.arange(steps) + 0.5) / steps, np.pi * (np.arange(around) + 0.5) / around
    )
    theta, slope = np.pi * u**3, 3 * np.pi * u * u
    x, y, z = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
    sine, cosine = np.sin(incidence), np.cos(incidence)
    v = np.stack([x * cosine + z * sine, y, z * cosine - x * sine]).reshape(3, -1)
    weight = (np.sin(theta) * slope).ravel() * (v[2] > 0)
    l = np.stack([np.full_like(v[0], value) for value in (-sine, 0.0, cosine)])
    dtype = jnp.zeros(()).dtype
    planes = [jnp.asarray(plane, dtype) for plane in (*l, *v, weight)]
    return Vec3(*planes[:3]), Vec3(*planes[3:6]), planes[6]
