"""How the intensity of a light falls with the distance d >= 0 between source and surface.

Each is one formula f(d). A light without attenuation holds None, and its distance is never computed.
"""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.arrays import positive

__all__ = [
    "AbstractAttenuation",
    "ExponentialAttenuation",
    "InverseSquare",
    "LinearAttenuation",
    "QuadraticAttenuation",
    "Windowed",
]

Plane = Float[Array, "..."]


class AbstractAttenuation(eqx.Module):
    """A factor f(d) on the intensity of a light, which does not rise with d > 0.

    What tiles of an image may leave out of many lights relies on that. d is 0 or of the range that
    `guard` names, as a `PointLight` gives it.
    """

    @abstractmethod
    def __call__(self, d: Plane) -> Plane:
        """f at the distances d."""


class QuadraticAttenuation(AbstractAttenuation):
    """f(d) = min(1 / (c0 + c1 d + c2 d^2), 1) (LIGHT-12), with c0, c1, c2 >= 0.

    Where the denominator is below 1 the clamp holds f at 1 and every derivative is 0. On the edge
    itself, where c = (1, 0, 0) lies, the derivative is that of the unclamped side.

    >>> float(QuadraticAttenuation(1.0, 0.1, 0.01)(jnp.array(10.0)))  # 1 / (1 + 1 + 1)
    0.3333...
    """

    c0: Float[Array, "..."] = eqx.field(converter=positive("c0"))
    c1: Float[Array, "..."] = eqx.field(converter=positive("c1"), default=0.0)
    c2: Float[Array, "..."] = eqx.field(converter=positive("c2"), default=0.0)

    def __call__(self, d: Plane) -> Plane:
        q = self.c0 + d * (self.c1 + d * self.c2)
        return guard.reciprocal(jnp.where(q < 1, 1, q))


class LinearAttenuation(AbstractAttenuation):
    """f(d) = 1 / (c0 + c1 d), with c0, c1 >= 0; not clamped; 0 where the denominator is.

    A denominator below 4e-29 (in float64 2e-231) counts as 0; from 1e-6 (1e-40) on second derivatives
    are finite.

    >>> float(LinearAttenuation(1.0, 0.5)(jnp.array(2.0)))
    0.5
    """

    c0: Float[Array, "..."] = eqx.field(converter=positive("c0"))
    c1: Float[Array, "..."] = eqx.field(converter=positive("c1"))

    def __call__(self, d: Plane) -> Plane:
        return guard.reciprocal(self.c0 + self.c1 * d)


class InverseSquare(AbstractAttenuation):
    """f(d) = 1 / d^2, not clamped; 0, with derivative 0, at d = 0.

    >>> float(InverseSquare()(jnp.array(2.0)))
    0.25
    """

    def __call__(self, d: Plane) -> Plane:
        inverse = guard.reciprocal(d)
        return inverse * inverse


class ExponentialAttenuation(AbstractAttenuation):
    """f(d) = exp(-a d): absorption in the medium, Lambert's third law; a >= 0 per unit of length.

    >>> float(ExponentialAttenuation(0.0)(jnp.array(2.0)))
    1.0
    """

    a: Float[Array, "..."] = eqx.field(converter=positive("a"))

    def __call__(self, d: Plane) -> Plane:
        return jnp.exp(-self.a * d)


class Windowed(AbstractAttenuation):
    """f(d) w(d) with the window w(d) = max(0, 1 - (d/R)^4)^2: a light of finite reach (Karis 2013).

    `law` is the attenuation within the reach R = `reach` > 0, in units of length. w is 1 with two
    derivatives of 0 at the light, and meets 0 smoothly at d = R. Farther away nothing arrives, so
    that tiles of an image which are out of reach leave the light out, without any error.

    >>> f = Windowed(InverseSquare(), reach=2.0)
    >>> float(f(jnp.array(1.0))), float(f(jnp.array(2.5)))  # (1 - 1/16)^2
    (0.878..., 0.0)
    """

    law: AbstractAttenuation
    reach: Float[Array, "..."] = eqx.field(converter=positive("reach"))

    def __call__(self, d: Plane) -> Plane:
        part = jnp.where(d < self.reach, d, self.reach) * guard.reciprocal(self.reach)
        square = part * part
        window = jnp.where(d < self.reach, 1 - square * square, 0)
        return self.law(d) * (window * window)
