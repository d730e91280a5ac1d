"""One light's share of the illumination equation, in two halves.

The first half is geometry: n.l, r.v and the distance, which no coefficient of a material and no constant
of an attenuation changes. The second is the rest. Rendering takes both at once; a search over
coefficients keeps the first.
"""

from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from diffshade.channels import Channels, channels, times
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.base import AbstractLight
from diffshade.reflectance.lambert import lambert
from diffshade.reflectance.lobe import AbstractLobe
from diffshade.reflectance.material import Material
from diffshade.shading.lights import LightSums
from diffshade.vector import dot

__all__ = ["Angles", "angles", "reflected"]

Plane = Float[Array, "..."]


class Angles(eqx.Module):
    """At points under one light: n.l, the distance where it matters, and what each lobe needs."""

    n_dot_l: Plane
    distance: Plane | None
    lobes: tuple[Any, ...]


def angles(gbuffer: GBuffer, light: AbstractLight, lobes: tuple[AbstractLobe, ...]) -> Angles:
    """The half that depends on positions, normals and directions."""
    n = gbuffer.normal
    l, distance = light.incidence(gbuffer.position)
    n_dot_l = dot(n, l)
    if not lobes:
        return Angles(n_dot_l, distance, ())
    v = gbuffer.viewer.direction(gbuffer.position)
    return Angles(n_dot_l, distance, tuple(lobe.angles(n, l, v, n_dot_l) for lobe in lobes))


def reflected(seen: Angles, light: AbstractLight, material: Material) -> LightSums:
    """I f(d) n.l, and I f(d) s for each lobe: the half that depends on coefficients."""
    f = light.falloff(seen.distance)
    intensity = channels(light.intensity)
    arriving = intensity if f is None else times(intensity, (f,))
    diffuse: Channels | None = None
    if material.kd is not None:
        diffuse = times(arriving, (lambert(seen.n_dot_l),))
    lobes = zip(material.specular, seen.lobes, strict=True)
    return diffuse, tuple(times(arriving, lobe.at(own)) for lobe, own in lobes)
