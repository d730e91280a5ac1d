"""Microfacet lobes: mirrors too small to see, each of which reflects as its boundary does.

    s = D(h) F(h.l) G(l, v) / (4 n.v),     the radiance I_p k_s s of light of irradiance I_p n.l

(Torrance and Sparrow 1967; Cook and Torrance 1982; Walter et al. 2007, 20): the BRDF D F G / (4 n.l n.v)
times n.l, so that k_s = 1 is what optics has. The parts are small functions: `distribution`, `masking`,
`fresnel`; a model is a composition of them.
"""

from abc import abstractmethod
from typing import Any, ClassVar, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.arrays import coefficients, positive
from diffshade.channels import Channels, channels, times
from diffshade.errors import BadInput
from diffshade.reflectance import distribution, masking
from diffshade.reflectance.fresnel import AbstractFresnel
from diffshade.reflectance.lobe import AbstractLobe
from diffshade.vector import Vec3, dot, halfway, versine

__all__ = ["GGX", "MASKINGS", "AbstractMicrofacet", "Beckmann", "Facets", "TorranceSparrow"]

Plane = Float[Array, "..."]

Masking = Literal["height-correlated", "separable", "v-groove"]
MASKINGS: tuple[Masking, ...] = ("height-correlated", "separable", "v-groove")


class Facets(NamedTuple):
    """Under what angles the facets that mirror l to v are seen: 1 - n.h, n.l, n.v and h.l = h.v.

    Where there are none, with light or viewer behind the surface, n.l is 0, and the others are harmless.
    """

    versine: Plane
    n_dot_l: Plane
    n_dot_v: Plane
    h_dot_l: Plane


def _masking(value: Any) -> Any:
    if value not in MASKINGS:
        raise BadInput(f"masking is {value!r}: give one of {', '.join(map(repr, MASKINGS))}")
    return value


def _grooved(value: Any) -> Any:
    if value != "v-groove":
        raise BadInput(
            f"masking is {value!r}: facets in grooves have 'v-groove'; use Beckmann or GGX"
        )
    return value


class AbstractMicrofacet(AbstractLobe):
    """A lobe k_s D F G / (4 n.v): a distribution D, and Smith's A of it, are what a model adds.

    `fresnel` None is a mirror, F = 1, and is not computed. Reciprocal but for the factor n.l, and with
    F <= 1 and k_s <= 1 no more is reflected than arrives (`v-groove` apart, which loses none of it at
    grazing angles either, and may gain a few percent with wide distributions). Not smooth where the
    lobe is cut off, at n.l = 0 and n.v = 0; derivatives there are those of the dark side, 0.
    """

    ks: Float[Array, "..."] = eqx.field(converter=coefficients("ks"))
    alpha: Float[Array, "..."] = eqx.field(converter=positive("alpha"))
    fresnel: AbstractFresnel | None = None
    masking: Masking = eqx.field(static=True, converter=_masking, default="height-correlated")
    convex: ClassVar[bool] = False

    @abstractmethod
    def density(self, versine: Plane, alpha: Plane) -> Plane:
        """D, from 1 - n.h."""

    @abstractmethod
    def shadow(self, cosine: Plane, alpha: Plane) -> Plane:
        """A(c) of Smith's masking."""

    def angles(self, n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane) -> Any:
        """`Facets`."""
        h, n_dot_v = halfway(l, v), dot(n, v)
        dark = (n_dot_l <= 0) | (n_dot_v <= 0) | (dot(h, h) == 0)
        return Facets(
            jnp.minimum(versine(n, h), 1),
            jnp.where(dark, 0, n_dot_l),
            jnp.where(dark, 1, n_dot_v),
            guard.positive(dot(h, l)),
        )

    def at(self, angles: Any) -> Channels:
        rough = tuple(
            self.density(angles.versine, alpha) * self._attenuation(angles, alpha)
            for alpha in channels(self.alpha)
        )
        if self.fresnel is None:
            return rough
        return times(rough, self.fresnel.reflected(angles.h_dot_l))

    def _attenuation(self, seen: Facets, alpha: Plane) -> Plane:
        """G / (4 n.v)."""
        if self.masking == "v-groove":
            return masking.v_groove(seen.n_dot_l, seen.n_dot_v, 1 - seen.versine, seen.h_dot_l)
        smith = masking.separable if self.masking == "separable" else masking.height_correlated
        of_l, of_v = (self.shadow(c, alpha) for c in (seen.n_dot_l, seen.n_dot_v))
        return smith(seen.n_dot_l, seen.n_dot_v, of_l, of_v)


class GGX(AbstractMicrofacet):
    """Facets after Trowbridge and Reitz (1975), GGX of Walter et al. (2007): wide tails.

    `ks` in [0, 1], `alpha` the roughness, 1e-3 and more, mostly below 1: each one number, one a
    channel [C], or a map over a G-buffer's pixels [C or 1, P]. `fresnel` is what a facet reflects;
    None for all. `masking` is Smith's, "height-correlated" or "separable", or "v-groove".

    >>> from diffshade.reflectance.fresnel import Dielectric
    >>> GGX(ks=1, alpha=0.1, fresnel=Dielectric(1.5)).masking
    'height-correlated'
    """

    kind: ClassVar[str] = "ggx"

    def density(self, versine: Plane, alpha: Plane) -> Plane:
        return distribution.ggx(versine, alpha)

    def shadow(self, cosine: Plane, alpha: Plane) -> Plane:
        return masking.ggx_shadow(cosine, alpha)


class Beckmann(AbstractMicrofacet):
    """Facets after Beckmann (1963), as Cook and Torrance (1982) have them: Gaussian in the slope.

    As `GGX`; with `rational` Smith's masking is Walter's rational approximation, which other renderers
    use, and which is 0.4 % off at the most.

    >>> Beckmann(ks=1, alpha=0.1).kind
    'beckmann'
    """

    rational: bool = eqx.field(static=True, default=False)
    kind: ClassVar[str] = "beckmann"

    def density(self, versine: Plane, alpha: Plane) -> Plane:
        return distribution.beckmann(versine, alpha)

    def shadow(self, cosine: Plane, alpha: Plane) -> Plane:
        shadow = masking.rational_beckmann_shadow if self.rational else masking.beckmann_shadow
        return shadow(cosine, alpha)


class TorranceSparrow(AbstractMicrofacet):
    """Facets inclined after a Gaussian of their angle, in V-shaped grooves (Torrance, Sparrow 1967).

    `alpha` is the angle at which the density has fallen to 1/e, in radians; all else as for `GGX`.

    >>> TorranceSparrow(ks=1, alpha=0.1).masking
    'v-groove'
    """

    masking: Masking = eqx.field(static=True, converter=_grooved, default="v-groove")
    kind: ClassVar[str] = "torrance_sparrow"

    def density(self, versine: Plane, alpha: Plane) -> Plane:
        return distribution.gaussian(versine, alpha)

    def shadow(self, cosine: Plane, alpha: Plane) -> Plane:
        raise AssertionError("facets in grooves have no masking of Smith's")
