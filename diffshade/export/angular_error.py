"""How far two materials are apart, over the angles of light and viewer."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from diffshade.channels import pairs
from diffshade.errors import BadInput
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
        l, v, weight = _directions(np.radians(degrees), steps)
        both = [[np.asarray(x, np.float64) for x in p] for p in pairs(exact(l, v), other(l, v))]
        a, b = (np.stack(planes) for planes in zip(*both, strict=True))
        most = a.max(where=weight > 0, initial=0)
        if not np.isfinite(most):
            raise BadInput("the material's coefficients are too large to compare: scale them down")
        a, difference = a / (most or 1), np.abs(a - b) / (most or 1)
        whole = np.sum(weight * a**2)
        rms.append(float(np.sqrt(np.sum(weight * difference**2) / whole)) if whole else 0.0)
        largest.append(float(difference.max(where=weight > 0, initial=0)))
    return AngularError(tuple(incidence), tuple(rms), tuple(largest))


def _directions(incidence: float, steps: int) -> tuple[Vec3, Vec3, Float[np.ndarray, "P"]]:
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
    planes = [jnp.asarray(plane, dtype) for plane in (*l, *v)]
    return Vec3(*planes[:3]), Vec3(*planes[3:]), weight
