"""How much of the light a smooth boundary reflects, by the angle of incidence (Fresnel 1823)."""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.arrays import coefficients, positive
from diffshade.channels import Channels, channels, pairs

__all__ = [
    "AbstractFresnel",
    "Conductor",
    "Dielectric",
    "Schlick",
    "conductor",
    "dielectric",
    "schlick",
]

Plane = Float[Array, "..."]


def dielectric(cosine: Plane, index: Plane) -> Plane:
    """The reflectance of a boundary between two clear media, for unpolarised light (C, Fresnel term).

        F = (g - c)^2 / (g + c)^2 / 2 [1 + (c (g + c) - 1)^2 / (c (g - c) + 1)^2]
        g^2 = index^2 - 1 + c^2

    (Cook and Torrance 1982) with c the cosine of the angle of incidence, in [0, 1], and the index of
    refraction beyond the boundary over that before it, above 0. Where g^2 <= 0 all is reflected: F = 1,
    with derivative 0. g - c is (index^2 - 1) / (g + c), which loses nothing where media are alike; of
    an index of 1 nothing is reflected, and where it is seen along the surface, which reflects all with
    the least change of the index, the derivative is 0.
    """
    beyond = (index - 1) * (index + 1)
    square = beyond + cosine * cosine
    g = guard.sqrt(square)
    total = (square <= 0) & (beyond < 0)
    across = g + cosine
    # So small it is where all is reflected, or of an index of 1; derivatives have its sixth power
    across = jnp.where(across < guard.shortest(across) ** 0.5, 0, across)
    thin = guard.ratio(beyond, across)
    s = guard.ratio(thin, across)
    p = guard.ratio(cosine * across - 1, cosine * thin + 1)
    return jnp.where(total, 1, 0.5 * s * s * (1 + p * p))


def conductor(cosine: Plane, index: Plane, extinction: Plane) -> Plane:
    """The reflectance of a metal of complex index of refraction `index` + i `extinction`.

        R_s = (a^2 + b^2 - 2 a c + c^2) / (a^2 + b^2 + 2 a c + c^2)
        R_p = R_s (c^2 (a^2 + b^2) - 2 a c s^2 + s^4) / (c^2 (a^2 + b^2) + 2 a c s^2 + s^4)
        F = (R_s + R_p) / 2,  s^2 = 1 - c^2,
        2 a^2 = |z| + x,  a^2 + b^2 = |z|,  z = x + 2 i index extinction
        x = index^2 - extinction^2 - s^2

    (Born and Wolf, Principles of Optics, 14.2), for unpolarised light. An extinction of 0 gives
    `dielectric`; not smooth where that is not.
    """
    c, s2 = cosine, 1 - cosine * cosine
    x = index * index - extinction * extinction - s2
    y = 2 * index * extinction
    size = guard.sqrt(x * x + y * y)
    # 2 a^2, without the difference of |z| and |x| where these are alike
    twice = jnp.where(x > 0, size + x, y * guard.ratio(y, size - x))
    a = guard.sqrt(0.5 * twice)
    crossed = 2 * a * c
    s = guard.ratio(size + c * c - crossed, size + c * c + crossed)
    parallel = c * c * size + s2 * s2
    p = guard.ratio(parallel - crossed * s2, parallel + crossed * s2)
    return 0.5 * s * (1 + p)


def schlick(cosine: Plane, f0: Plane) -> Plane:
    """F_0 + (1 - F_0) (1 - c)^5: Schlick's approximation (1994), F_0 what is reflected head-on."""
    rest = 1 - cosine
    square = rest * rest
    return f0 + (1 - f0) * (square * square * rest)


class AbstractFresnel(eqx.Module):
    """A boundary: what share of the light it reflects at each angle of incidence."""

    kind: eqx.AbstractClassVar[str]

    @abstractmethod
    def reflected(self, cosine: Plane) -> Channels:
        """F for cosines of the angle of incidence: one plane, or one a channel."""


class Dielectric(AbstractFresnel):
    """A clear medium, as glass, water, plastic or lacquer: F by `dielectric`.

    `index` of refraction, above 0: 1.33 of water, 1.5 of glass and of most plastics. One number, one a
    channel [C], or a map over a G-buffer's pixels [C or 1, P].

    >>> round(float(Dielectric(1.5).reflected(jnp.ones(()))[0]), 6)
    0.04
    """

    index: Float[Array, "..."] = eqx.field(converter=positive("index"), default=1.5)
    kind: ClassVar[str] = "dielectric"

    def reflected(self, cosine: Plane) -> Channels:
        return tuple(dielectric(cosine, index) for index in channels(self.index))


class Conductor(AbstractFresnel):
    """A metal of complex index `index` + i `extinction`: F by `conductor`. Both as for `Dielectric`.

    >>> copper = Conductor(index=(0.2, 0.92, 1.1), extinction=(3.9, 2.45, 2.14))
    >>> [round(float(f), 2) for f in copper.reflected(jnp.ones(()))]
    [0.95, 0.62, 0.51]
    """

    index: Float[Array, "..."] = eqx.field(converter=positive("index"))
    extinction: Float[Array, "..."] = eqx.field(converter=positive("extinction"))
    kind: ClassVar[str] = "conductor"

    def reflected(self, cosine: Plane) -> Channels:
        both = pairs(channels(self.index), channels(self.extinction))
        return tuple(conductor(cosine, index, extinction) for index, extinction in both)


class Schlick(AbstractFresnel):
    """Schlick's approximation of either, from the reflectance head-on `f0`, in [0, 1].

    >>> [round(float(f), 2) for f in Schlick(0.04).reflected(jnp.array([0.0, 1.0]))[0]]
    [1.0, 0.04]
    """

    f0: Float[Array, "..."] = eqx.field(converter=coefficients("f0"), default=0.04)
    kind: ClassVar[str] = "schlick"

    def reflected(self, cosine: Plane) -> Channels:
        return tuple(schlick(cosine, f0) for f0 in channels(self.f0))
