"""What holds for all points of a tile at once: where they are, and where their vectors point.

A ball holds points, a cone unit vectors; what light can reach a tile at the most follows from these
without a look at its pixels. Bounds are never too small, rounding included.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.vector import Vec3, dot, length, reflect, unit

__all__ = ["Ball", "Cone", "largest_cosine", "reflected", "smallest_cosine"]

Number = Float[Array, "..."]


class Ball(NamedTuple):
    """Points no farther than `radius` from `centre`."""

    centre: Vec3
    radius: Number

    @staticmethod
    def around(points: Vec3) -> "Ball":
        """One that holds planes [P] of points."""
        centre = jax.tree.map(lambda x: (x.min(-1) + x.max(-1)) / 2, points)
        return Ball(centre, _wider(length(points - centre).max(-1)))

    def nearest(self, point: Vec3) -> Number:
        """The least distance to a point; 0 inside."""
        return jnp.maximum(length(point - self.centre) - self.radius, 0)

    def towards(self, point: Vec3) -> "Cone":
        """The directions from the ball to a point."""
        s = point - self.centre
        distance = length(s)
        inside = distance <= self.radius
        sine = jnp.where(inside, 0, self.radius / jnp.where(inside, 1, distance))
        return Cone(unit(s), jnp.where(inside, -1, _other(sine)), sine)


class Cone(NamedTuple):
    """Unit vectors within an angle of an axis; cosine and sine of the angle, from 0 to pi."""

    axis: Vec3
    cosine: Number
    sine: Number

    @staticmethod
    def around(vectors: Vec3) -> "Cone":
        """One that holds planes [P] of unit vectors."""
        axis = unit(jax.tree.map(lambda x: x.mean(-1), vectors))
        least = dot(vectors, axis).min(-1)
        cosine = jnp.clip(least - 4 * float(jnp.finfo(least.dtype).eps), -1, 1)
        return Cone(axis, cosine, _other(cosine))

    @staticmethod
    def ray(direction: Vec3) -> "Cone":
        """One unit vector alone."""
        return Cone(direction, jnp.ones_like(direction.x), jnp.zeros_like(direction.x))

    def wider_by(self, other: "Cone") -> "Cone":
        """The cone whose angle is the sum of both, or pi."""
        everything = self.cosine + other.cosine <= 0  # the angles add up to pi or more
        cosine = self.cosine * other.cosine - self.sine * other.sine
        sine = self.sine * other.cosine + self.cosine * other.sine
        return Cone(self.axis, jnp.where(everything, -1, cosine), jnp.where(everything, 0, sine))


def largest_cosine(a: Cone, b: Cone) -> Number:
    """The largest a.b."""
    apart = dot(a.axis, b.axis)
    both = a.wider_by(b)
    nearest = apart * both.cosine + _other(apart) * both.sine
    return jnp.minimum(jnp.where(apart >= both.cosine, 1, nearest) + _slack(apart), 1)


def smallest_cosine(a: Cone, b: Cone) -> Number:
    """The smallest a.b."""
    apart = dot(a.axis, b.axis)
    farthest = Cone(a.axis, apart, _other(apart)).wider_by(a.wider_by(b))
    return jnp.maximum(farthest.cosine - _slack(apart), -1)


def reflected(l: Cone, n: Cone) -> Cone:
    """The directions 2 (n.l) n - l: a normal that turns takes them with it by twice its angle."""
    return Cone(reflect(l.axis, n.axis), l.cosine, l.sine).wider_by(n).wider_by(n)


def _other(cosine: Number) -> Number:
    """The sine of an angle from its cosine, and the reverse."""
    return guard.sqrt(1 - cosine * cosine)


def _slack(cosine: Number) -> float:
    """What rounding may take from a cosine that came through a sine."""
    return 2 * float(jnp.finfo(cosine.dtype).eps) ** 0.5


def _wider(length: Number) -> Number:
    return length * (1 + 8 * float(jnp.finfo(length.dtype).eps))
