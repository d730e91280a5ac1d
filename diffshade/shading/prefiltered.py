"""An environment's share of the illumination equation: integrals over all directions at once.

As of one light (`one_light`) the first half is geometry, which no coefficient of a material changes: the
irradiance E(n), and what the light is, degree by degree, in the direction r where the viewer is mirrored
to. The second is what a material makes of them.
"""

from typing import NoReturn, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from diffshade.channels import Channels, times
from diffshade.errors import BadInput
from diffshade.light.environment import EnvironmentLight
from diffshade.reflectance.body import FresnelBody
from diffshade.reflectance.lobe import AbstractLobe
from diffshade.reflectance.material import Material
from diffshade.shading.lights import LightSums
from diffshade.vector import Vec3, dot, reflect

__all__ = ["Prefiltered", "filtered", "prefiltered", "refuse", "unlit_around"]


T = TypeVar("T", Channels, tuple[Channels, ...])


class Prefiltered(eqx.Module):
    """At points in an environment: E(n), and L in the direction r, degree by degree; () without lobes."""

    irradiance: Channels
    bands: tuple[Channels, ...]


def prefiltered(light: EnvironmentLight, n: Vec3, v: Vec3 | None) -> Prefiltered:
    """What arrives at the normals n, seen from v; dark where there is no normal, or no v."""
    nowhere = dot(n, n) == 0
    irradiance = _dark(nowhere, light.irradiance(n))
    bands: tuple[Channels, ...] = ()
    if v is not None:
        bands = _dark(nowhere | (dot(v, v) == 0), light.seen_in(reflect(v, n)))
    if light.visible is None:
        return Prefiltered(irradiance, bands)
    share = (light.visible,)
    return Prefiltered(times(share, irradiance), tuple(times(share, band) for band in bands))


def unlit_around(seen: Prefiltered, material: Material) -> LightSums:
    """E(n), and what each lobe makes of the light around r."""
    if material.body is not None:
        refuse(material.body)
    diffuse = None if material.kd is None else seen.irradiance
    return diffuse, tuple(filtered(lobe, seen.bands) for lobe in material.specular)


def filtered(lobe: AbstractLobe, bands: tuple[Channels, ...]) -> Channels:
    """`AbstractLobe.filtered`; raises `BadInput` where a lobe has no such form."""
    planes = lobe.filtered(bands)
    if planes is None:
        refuse(lobe)
    return planes


def refuse(part: AbstractLobe | FresnelBody) -> NoReturn:
    """Raise `BadInput` for a part of a material that asks for rays."""
    weighted = "weighted " * (getattr(part, "weight", None) is not None)
    raise BadInput(
        f"the material has a {weighted}{type(part).__name__}, and an EnvironmentLight is integrated for"
        " diffuse and plain Phong terms: light it by environment.as_lights(samples); in a scene.toml or"
        " a capture.toml give the environment samples = 16"
    )


def _dark(nowhere: Bool[Array, "..."], planes: T) -> T:
    return jax.tree.map(lambda plane: jnp.where(nowhere, 0, plane), planes)
