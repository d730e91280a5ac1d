"""Attenuation by distance in a gauge where its constants mean something.

c0, c1, c2 share one scale with k_d and k_s: doubling all five leaves the image unchanged. At a
reference distance d0, the geometric mean distance between lights and surface, the scale is fixed by

    1/f(d) = l0 + l1 t + l2 t^2,   t = d / d0,   l >= 0,   l0 + l1 + l2 = 1,   so that f(d0) = 1.

The triangle of (l0, l1, l2) holds no attenuation (1, 0, 0), pure inverse square (0, 0, 1) and all
between. The search moves two of the three, each bounded by 0; the third, the largest, makes up the sum,
so that no edge or corner of the triangle is special. A linear law is the edge l2 = 0.

The scale is known where k_d, a k_s or one of c0, c1, c2 is held, and where LIGHT-12's clamp
min(f, 1) is seen to act at some points and not at others (`fitting.clamp`). Then the sum of l is
f(d0)^-1, all of them move, and the clamp is part of the law.
"""

from abc import abstractmethod
from functools import cache
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from diffshade import guard
from diffshade.light.attenuation import (
    AbstractAttenuation,
    ExponentialAttenuation,
    InverseSquare,
    LinearAttenuation,
    QuadraticAttenuation,
)
from diffshade.light.base import AbstractLight
from diffshade.light.point import PointLight
from diffshade.scene import Scene
from fitting.arrays import Array

__all__ = [
    "CONSTANTS",
    "AbstractGauge",
    "ExponentialGauge",
    "PolynomialGauge",
    "ReferenceAttenuation",
    "gauge_of",
    "lengths",
    "lit_by",
    "with_attenuation",
]

Number = Float[Array, ""]
Numbers = Float[Array, "..."]
Node = tuple[tuple[int, ...], tuple[float, ...]]
"""Where on the axes of a grid, and the unknowns there: neighbours differ by one at the most."""

CONSTANTS: dict[type[AbstractAttenuation], tuple[str, ...]] = {
    QuadraticAttenuation: ("c0", "c1", "c2"),
    LinearAttenuation: ("c0", "c1"),
    ExponentialAttenuation: ("a",),
    InverseSquare: (),
}
"""The laws that can be asked for, and what is unknown of each."""

THIRDS = 3
"""Steps along an edge of the triangle: its corners, its edges, its middle."""
CEILING_NODES = 16
"""Of the clamp, between f at the farthest and at the nearest point."""
ABSORPTION_NODES = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
"""Of a d0."""


class AbstractGauge(eqx.Module):
    """A law of attenuation whose constants are searched, as numbers without a unit: v.

    `distance` is d0, by which lengths are measured. `held` has the values of v that are known.
    """

    distance: eqx.AbstractVar[Number]
    held: eqx.AbstractVar[tuple[float | None, ...]]

    @property
    def size(self) -> int:
        """How many constants the law has."""
        return len(self.held)

    @property
    @abstractmethod
    def floating(self) -> bool:
        """Whether v has no scale of its own, so that one of its free entries makes up a sum of 1."""

    @property
    @abstractmethod
    def nodes(self) -> tuple[Node, ...]:
        """A coarse grid over v."""

    @abstractmethod
    def law(self, v: Float[Array, "s"]) -> AbstractAttenuation:
        """The law that is fitted."""

    @property
    @abstractmethod
    def kind(self) -> type[AbstractAttenuation]:
        """The law as the texts write it."""

    @abstractmethod
    def constants(self, v: Numbers, scale: Numbers) -> tuple[Numbers, ...]:
        """Those of the law, 1/f times the `scale` by which k_d and k_s are multiplied."""

    @property
    @abstractmethod
    def has_shares(self) -> bool:
        """Whether the law has l0, l1, ... at the reference distance."""

    @abstractmethod
    def shares(self, v: Numbers) -> tuple[Numbers, ...]:
        """l0, l1, ... as parts of their sum, of a law that has them."""

    @abstractmethod
    def named(self, v: Float[np.ndarray, "s"]) -> dict[str, float]:
        """What is searched, by name."""


class PolynomialGauge(AbstractGauge):
    """1/f(d) = l0 + l1 t, or l0 + l1 t + l2 t^2; the latter clamped where its scale is known."""

    distance: Number
    held: tuple[float | None, ...] = eqx.field(static=True)
    scale_known: bool = eqx.field(static=True, default=False)

    @property
    def floating(self) -> bool:
        return not self.scale_known

    @property
    def clamped(self) -> bool:
        """Whether LIGHT-12's clamp is part of the law: a linear one has none."""
        return self.scale_known and self.size == len(CONSTANTS[QuadraticAttenuation])

    @property
    def nodes(self) -> tuple[Node, ...]:
        return _polynomial_nodes(self.size)

    def law(self, v: Float[Array, "s"]) -> "ReferenceAttenuation":
        return ReferenceAttenuation(v, self.distance, self.clamped)

    @property
    def kind(self) -> type[AbstractAttenuation]:
        return QuadraticAttenuation if self.size == 3 else LinearAttenuation

    def constants(self, v: Numbers, scale: Numbers) -> tuple[Numbers, ...]:
        d0 = float(self.distance)
        return tuple(scale * v[..., k] / d0**k for k in range(self.size))

    @property
    def has_shares(self) -> bool:
        return True

    def shares(self, v: Numbers) -> tuple[Numbers, ...]:
        total = v.sum(axis=-1)
        return tuple(_over(v[..., k], total) for k in range(self.size))

    def at_reference(self, v: Numbers) -> Numbers:
        """f(d0)."""
        inverse = v.sum(axis=-1)
        return 1 / np.maximum(inverse, 1) if self.clamped else _over(np.ones_like(inverse), inverse)

    def natural_scale(self, v: Numbers, nearest: float, largest: Numbers) -> Numbers:
        """The common scale of the constants, k_d and k_s, which no image can tell: a convention.

        It makes c0 = 1 where that can be: where there is an l0, and where no coefficient is pushed
        past its upper bound (`largest` is the largest, over its bound, before scaling). Otherwise
        the coefficients grow as far as their bounds; and never so little that LIGHT-12's clamp, which
        was not part of what was fitted, would begin to act at the `nearest` point.
        """
        wanted = _over(np.ones_like(largest), v[..., 0], np.inf)
        scale = np.minimum(wanted, _over(np.ones_like(largest), largest, np.inf))
        scale = np.where(np.isfinite(scale), scale, self.at_reference(v))
        if self.kind is not QuadraticAttenuation:  # no other law has a clamp
            return scale
        inverse = _polynomial(tuple(np.moveaxis(v, -1, 0)), nearest / float(self.distance))
        return np.maximum(scale, _over(np.ones_like(inverse), inverse))

    def named(self, v: Float[np.ndarray, "s"]) -> dict[str, float]:
        return {f"reference.l{k}": float(l) for k, l in enumerate(v)}

    def ceiling_nodes(self, nearest: float, farthest: float) -> tuple[Node, ...]:
        """A grid over laws whose clamp acts at some of the distances: at each law, where it begins.

        The first is the flat one, which is 1 everywhere.
        """
        (number, flat), *others = _polynomial_nodes(self.size)
        nodes: list[Node] = [((*number, -1), flat)]
        for number, law in others:
            ends = [_polynomial(law, d / float(self.distance)) for d in (nearest, farthest)]
            # The law q p(t) is 1, where the clamp begins, between the nearest and the farthest point.
            for c in range(CEILING_NODES):
                part = (c + 0.5) / CEILING_NODES
                scale = 1 / (ends[0] ** (1 - part) * ends[1] ** part)
                nodes.append(((*number, c), tuple(scale * l for l in law)))
        return tuple(nodes)


class ExponentialGauge(AbstractGauge):
    """f(d) = exp(-b t), b = a d0: its scale is known."""

    distance: Number
    held: tuple[float | None, ...] = eqx.field(static=True)

    @property
    def floating(self) -> bool:
        return False

    @property
    def nodes(self) -> tuple[Node, ...]:
        return tuple(((number,), (b,)) for number, b in enumerate(ABSORPTION_NODES))

    def law(self, v: Float[Array, "s"]) -> ExponentialAttenuation:
        return ExponentialAttenuation(v[0] / self.distance)

    @property
    def kind(self) -> type[AbstractAttenuation]:
        return ExponentialAttenuation

    def constants(self, v: Numbers, scale: Numbers) -> tuple[Numbers, ...]:
        del scale  # is 1
        return (v[..., 0] / float(self.distance),)

    @property
    def has_shares(self) -> bool:
        return False

    def shares(self, v: Numbers) -> tuple[Numbers, ...]:
        del v
        return ()

    def named(self, v: Float[np.ndarray, "s"]) -> dict[str, float]:
        return {"attenuation.a": float(v[0]) / float(self.distance)}


def gauge_of(
    law: type[AbstractAttenuation],
    distance: Number,
    held: tuple[float | None, ...],
    *,
    scale_known: bool,
) -> AbstractGauge:
    """The gauge of a law that has something unknown."""
    if law is ExponentialAttenuation:
        return ExponentialGauge(distance, held)
    return PolynomialGauge(distance, held, scale_known)


def lengths(constant: str) -> int:
    """How often the unit of length divides a constant: v is the constant times d0 to this power."""
    return {"c0": 0, "c1": 1, "c2": 2, "a": 1}[constant]


class ReferenceAttenuation(AbstractAttenuation):
    """f(d) = 1 / (l0 + l1 t + l2 t^2 ...), t = d / distance, with l >= 0; `clamped` at 1 or not."""

    l: Float[Array, "s"]
    distance: Number
    clamped: bool = eqx.field(static=True, default=False)

    def __call__(self, d: Float[Array, "..."]) -> Float[Array, "..."]:
        inverse = _polynomial(tuple(self.l), d / self.distance)
        return 1 / jnp.where(inverse < 1, 1, inverse) if self.clamped else guard.reciprocal(inverse)


def with_attenuation(scene: Scene, attenuation: AbstractAttenuation) -> Scene:
    """The scene with one attenuation on all its point lights."""
    return Scene(scene.ambient, tuple(lit_by(light, attenuation) for light in scene.lights))


def lit_by(light: AbstractLight, attenuation: AbstractAttenuation) -> AbstractLight:
    """A light with an attenuation in place of its own, if it is one that has any.

    Of many lights, stacked, nothing is checked or converted.
    """
    if not isinstance(light, PointLight):
        return light
    return eqx.tree_at(lambda x: x.attenuation, light, attenuation, is_leaf=_is_absent)


def _is_absent(x: object) -> bool:
    return x is None


def _over(a: Numbers, b: Numbers, otherwise: float = 0.0) -> Numbers:
    """a / b, and something else where b is 0."""
    return np.where(b == 0, otherwise, a / np.where(b == 0, 1, b))


def _polynomial(l: tuple[Any, ...], t: Any) -> Any:
    """l0 + t (l1 + t (l2 + ...)), of numbers or arrays."""
    *lower, value = l
    for constant in reversed(lower):
        value = constant + t * value
    return value


@cache
def _polynomial_nodes(size: int) -> tuple[Node, ...]:
    """Thirds of the simplex of l; the flat law first."""
    steps = np.indices((THIRDS + 1,) * size).reshape(size, -1).T[::-1]
    steps = steps[steps.sum(axis=1) == THIRDS]
    return tuple((tuple(map(int, step)), tuple((step / THIRDS).tolist())) for step in steps)
