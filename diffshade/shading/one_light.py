"""One light's share of the illumination equation, in two halves.

The first half is geometry: n.l, r.v and the distance, which no coefficient of a material and no constant
of an attenuation changes. The second is the rest. Rendering takes both at once; a search over
coefficients keeps the first.
"""

from typing import Any, TypeAlias

import equinox as eqx
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.channels import Channels, channels, times
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.base import AbstractLight, AbstractRayLight
from diffshade.light.environment import EnvironmentLight
from diffshade.reflectance.body import FresnelBody
from diffshade.reflectance.lambert import lambert
from diffshade.reflectance.lobe import AbstractLobe
from diffshade.reflectance.material import Material
from diffshade.shading.lights import LightSums
from diffshade.shading.prefiltered import Prefiltered, prefiltered, unlit_around
from diffshade.vector import Vec3, dot

__all__ = ["Angles", "Seen", "angles", "lit", "reflected", "strength", "unlit"]

Plane = Float[Array, "..."]


class Angles(eqx.Module):
    """At points under one light: n.l, what each lobe needs, and the distance where it matters.

    `n_dot_v` is max(0, n.v), where a body needs it; `emission` that of `Incidence`, times the share of
    the light that is visible.
    """

    n_dot_l: Plane
    lobes: tuple[Any, ...]
    distance: Plane | None
    n_dot_v: Plane | None = None
    emission: Plane | None = None


Seen: TypeAlias = Angles | Prefiltered
"""The geometry of a light: under what angles its ray is seen, or an environment's integrals."""


def angles(
    gbuffer: GBuffer,
    light: AbstractLight,
    lobes: tuple[AbstractLobe, ...],
    body: FresnelBody | None = None,
    view: Vec3 | None = None,
) -> Seen:
    """The half that depends on positions, normals and directions.

    `view` is the G-buffer's view direction, where several lights share it.
    """
    n = gbuffer.normal
    if isinstance(light, EnvironmentLight):
        v = gbuffer.viewer.direction(gbuffer.position) if lobes and view is None else view
        return prefiltered(light, n, v if lobes else None)
    assert isinstance(light, AbstractRayLight)
    l, distance, emission = light.incidence(gbuffer.position)
    if light.visible is not None:
        emission = light.visible if emission is None else emission * light.visible
    n_dot_l = dot(n, l)
    if not lobes and body is None:
        return Angles(n_dot_l, (), distance, emission=emission)
    v = gbuffer.viewer.direction(gbuffer.position) if view is None else view
    seen = tuple(lobe.angles(n, l, v, n_dot_l) for lobe in lobes)
    n_dot_v = None if body is None else guard.positive(dot(n, v))
    return Angles(n_dot_l, seen, distance, n_dot_v, emission)


def reflected(seen: Seen, light: AbstractLight, material: Material) -> LightSums:
    """I f(d) n.l, and I f(d) s for each lobe: the half that depends on coefficients."""
    return lit(light, unlit(seen, light, material))


def unlit(seen: Seen, light: AbstractLight, material: Material) -> LightSums:
    """f(d) n.l and f(d) s: what a light of intensity 1 reflects."""
    if isinstance(seen, Prefiltered):
        return unlit_around(seen, material)
    assert isinstance(light, AbstractRayLight)
    f = strength(light, seen.distance, seen.emission)
    diffuse: Channels | None = None
    if material.kd is not None:
        diffuse = _times(f, _diffuse(seen, material.body))
    lobes = zip(material.specular, seen.lobes, strict=True)
    return diffuse, tuple(_times(f, lobe.at(own)) for lobe, own in lobes)


def strength(
    light: AbstractRayLight, distance: Plane | None, emission: Plane | None
) -> Plane | None:
    """The factor on a light's intensity: its falloff times its emission; None where it is 1."""
    f = light.falloff(distance)
    if emission is None:
        return f
    return emission if f is None else emission * f


def _diffuse(seen: Angles, body: FresnelBody | None) -> Channels:
    """n.l, and the share of it that passes into a body and out again."""
    cosine = lambert(seen.n_dot_l)
    if body is None:
        return (cosine,)
    assert seen.n_dot_v is not None
    return times((cosine,), body.passed(cosine, seen.n_dot_v))


def lit(light: AbstractLight, terms: LightSums) -> LightSums:
    """The terms times the light's intensity."""
    intensity = channels(light.intensity)
    diffuse, specular = terms
    return (
        None if diffuse is None else times(intensity, diffuse),
        tuple(times(intensity, shape) for shape in specular),
    )


def _times(f: Plane | None, planes: Channels) -> Channels:
    return planes if f is None else tuple(f * plane for plane in planes)
