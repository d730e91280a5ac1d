"""Lights with extent: rectangle, disc, sphere and line, by quadrature (text B, distributed sources).

Every element of a surface that glows with the radiance L sends the irradiance

    dE = L cos(theta) dA / d^2 n.l,     theta the angle between its own normal and the ray,

which is that of a spot light of exponent 1. A light with extent is a sum of such elements,

    E = integral of dE  =  sum over j of w_j L cos(theta_j) / d_j^2 n.l_j,

at the nodes of a Gauss rule. `ds.Scene` takes it among its lights, and holds the elements. How many are
needed depends on how near the light is: `shading.quadrature` finds as few as a tolerance takes.
"""

from abc import abstractmethod
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.arrays import floats, is_concrete, positive, vector
from diffshade.errors import BadInput
from diffshade.light.attenuation import AbstractAttenuation, InverseSquare
from diffshade.light.base import AbstractLight, Incidence, share
from diffshade.light.point import AbstractPointLight
from diffshade.vector import Vec3, cross, dot, length, unit

__all__ = ["AbstractEmitter", "DiscLight", "LineLight", "RectangleLight", "SphereLight"]


def _samples(value: Any) -> int:
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or value < 1:
        raise BadInput(f"samples is {value!r}: give a whole number of at least 1")
    return int(value)


def _shines(across: Float[Array, "3"], what: str) -> None:
    """Refuse a light without area or direction, as far as its values are known."""
    if is_concrete(across) and not np.any(np.asarray(across)):
        raise BadInput(what)


class AbstractEmitter(eqx.Module):
    """A light with extent, of radiance L: one number, or one a channel.

    `samples` are those along one side; a surface has about their square.
    """

    radiance: eqx.AbstractVar[Float[Array, "..."]]
    samples: eqx.AbstractVar[int]

    @abstractmethod
    def elements(self) -> tuple[AbstractLight, ...]:
        """The lights that it is the sum of."""

    def with_samples(self, samples: int) -> "AbstractEmitter":
        """The same light by another rule."""
        return replace(self, samples=samples)


class RectangleLight(AbstractEmitter):
    """A parallelogram that glows to one side: `center`, and `u`, `v` from one edge to the opposite one.

    It shines towards u x v. The rule is Gauss's, `samples` by `samples` nodes.

    >>> len(RectangleLight((0, 0, 3), (1, 0, 0), (0, -1, 0), samples=3).elements())
    9
    """

    center: Float[Array, "3"] = eqx.field(converter=vector("the light's center"))  # type: ignore[misc]
    u: Float[Array, "3"] = eqx.field(converter=vector("the light's side u"))  # type: ignore[misc]
    v: Float[Array, "3"] = eqx.field(converter=vector("the light's side v"))  # type: ignore[misc]
    radiance: Float[Array, "..."] = eqx.field(converter=floats("the light's radiance"), default=1.0)
    samples: int = eqx.field(static=True, converter=_samples, default=4)

    def elements(self) -> tuple[AbstractLight, ...]:
        nodes = list(zip(*(rule.tolist() for rule in _gauss(self.samples)), strict=True))
        across = cross(Vec3.from_array(self.u), Vec3.from_array(self.v))
        power, towards = self.radiance * length(across), across.to_array()
        _shines(towards, "a rectangle's u and v are parallel, or zero: give two sides of it")
        return tuple(
            _element(self.center + a * self.u + b * self.v, towards, power * (p * q))
            for a, p in nodes
            for b, q in nodes
        )


class DiscLight(AbstractEmitter):
    """A disc that glows to one side, that of its `normal`: Gauss's rule in r^2, evenly around.

    >>> len(DiscLight((0, 0, 3), (0, 0, -1), radius=0.5, samples=3).elements())
    18
    """

    center: Float[Array, "3"] = eqx.field(converter=vector("the light's center"))  # type: ignore[misc]
    normal: Float[Array, "3"] = eqx.field(converter=vector("the light's normal"))  # type: ignore[misc]
    radius: Float[Array, ""] = eqx.field(converter=positive("the light's radius"))  # type: ignore[misc]
    radiance: Float[Array, "..."] = eqx.field(converter=floats("the light's radiance"), default=1.0)
    samples: int = eqx.field(static=True, converter=_samples, default=4)

    def elements(self) -> tuple[AbstractLight, ...]:
        _shines(self.normal, "a disc's normal is zero: give the direction in which it shines")
        a, b = _across(self.normal)
        power, count = self.radiance * (np.pi * self.radius**2), 2 * self.samples
        found = []
        for number, (x, w) in enumerate(zip(*_gauss(self.samples), strict=True)):
            for t in _turned(number, count):
                ring = float(np.sqrt(x + 0.5))
                out = ring * float(np.cos(t)) * a + ring * float(np.sin(t)) * b
                found.append(
                    _element(self.center + self.radius * out, self.normal, power * float(w / count))
                )
        return tuple(found)


class SphereLight(AbstractEmitter):
    """A sphere that glows evenly: seen from outside, Gauss's rule along an axis, evenly around it.

    Every element shines outwards, and the far side of the sphere adds nothing. To a surface that sees
    all of it a sphere is a point light of intensity pi L R^2 at its centre, by the inverse square.

    >>> len(SphereLight((0, 0, 3), radius=0.5, samples=3).elements())
    18
    """

    center: Float[Array, "3"] = eqx.field(converter=vector("the light's center"))  # type: ignore[misc]
    radius: Float[Array, ""] = eqx.field(converter=positive("the light's radius"))  # type: ignore[misc]
    radiance: Float[Array, "..."] = eqx.field(converter=floats("the light's radiance"), default=1.0)
    samples: int = eqx.field(static=True, converter=_samples, default=8)

    def elements(self) -> tuple[AbstractLight, ...]:
        power, count = self.radiance * (4 * np.pi * self.radius**2), 2 * self.samples
        found = []
        for number, (x, w) in enumerate(zip(*_gauss(self.samples), strict=True)):
            ring = np.sqrt(1 - 4 * x * x)
            for t in _turned(number, count):
                out = jnp.asarray([ring * np.cos(t), ring * np.sin(t), 2 * x], self.center.dtype)
                found.append(
                    _element(self.center + self.radius * out, out, power * float(w / count))
                )
        return tuple(found)


class LineLight(AbstractEmitter):
    """A thin tube from `start` to `end` that glows evenly: Gauss's rule along it.

    `radiance` is L times the width of the tube. Seen under the angle theta to its axis an element sends
    L sin(theta) of its length, to all sides.

    >>> len(LineLight((-1, 0, 3), (1, 0, 3), samples=5).elements())
    5
    """

    start: Float[Array, "3"] = eqx.field(converter=vector("the light's start"))  # type: ignore[misc]
    end: Float[Array, "3"] = eqx.field(converter=vector("the light's end"))  # type: ignore[misc]
    radiance: Float[Array, "..."] = eqx.field(converter=floats("the light's radiance"), default=1.0)
    samples: int = eqx.field(static=True, converter=_samples, default=8)

    def elements(self) -> tuple[AbstractLight, ...]:
        x, w = _gauss(self.samples)
        along = self.end - self.start
        _shines(along, "a line's start and end are one point: give two")
        middle, size = 0.5 * (self.start + self.end), length(Vec3.from_array(along))
        return tuple(
            TubeElement(
                intensity=self.radiance * size * p,
                position=middle + s * along,
                axis=along,
                attenuation=InverseSquare(),
            )
            for s, p in zip(x.tolist(), w.tolist(), strict=True)
        )


class AbstractElement(AbstractPointLight):
    """A piece of a light with extent: I_p / d^2 times what it sends at an angle to its `axis`."""

    position: Float[Array, "3"]
    axis: Float[Array, "3"]
    intensity: Float[Array, "..."]
    attenuation: AbstractAttenuation | None
    visible: Float[Array, "..."] | None = eqx.field(converter=share, default=None, kw_only=True)

    @abstractmethod
    def emitted(self, cosine: Float[Array, "..."]) -> Float[Array, "..."]:
        """The share that goes out at an angle to the axis, by its cosine."""

    def incidence(self, position: Vec3 | None) -> Incidence:
        arriving = super().incidence(position)
        cosine = -dot(arriving.l, unit(Vec3.from_array(self.axis)))
        return arriving._replace(emission=self.emitted(cosine))


class SurfaceElement(AbstractElement):
    """Of a surface that glows to the side of its normal, the axis: cos(theta)."""

    def emitted(self, cosine: Float[Array, "..."]) -> Float[Array, "..."]:
        return guard.positive(cosine)


class TubeElement(AbstractElement):
    """Of a tube along the axis: sin(theta), to all sides."""

    def emitted(self, cosine: Float[Array, "..."]) -> Float[Array, "..."]:
        return guard.sqrt(1 - cosine * cosine)


def _element(
    place: Float[Array, "3"], normal: Float[Array, "3"], intensity: Float[Array, "..."]
) -> SurfaceElement:
    return SurfaceElement(
        intensity=intensity, position=place, axis=normal, attenuation=InverseSquare()
    )


def _gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes in [-1/2, 1/2], and weights that add up to 1."""
    x, w = np.polynomial.legendre.leggauss(count)
    return 0.5 * x, 0.5 * w


def _turned(number: int, count: int) -> np.ndarray:
    """`count` angles around, every second ring of them turned by half a step."""
    return (np.arange(count) + 0.5 * (number % 2)) * 2 * np.pi / count


def _across(axis: Float[Array, "3"]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Two unit vectors at right angles to an axis and to each other."""
    n = unit(Vec3.from_array(axis))
    flat = jnp.abs(n.z) > 0.9
    other = Vec3(jnp.where(flat, 1.0, 0.0), jnp.zeros_like(n.x), jnp.where(flat, 0.0, 1.0))
    a = unit(cross(n, other))
    return a.to_array(), cross(n, a).to_array()
