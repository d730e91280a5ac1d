"""The basis of an image: everything of the illumination equation but k_a, k_d and k_s.

    I = I_a k_a O_d + sum_j I_j f_j(d_j) [ k_d O_d max(0, n.l_j) + sum_m k_s,m O_s s_m(n, l_j, v) ]
                                                                            (LIGHT-13, with text C)

is linear in the coefficients. The sums over lights j are computed here, once, for both readers:
rendering contracts them with a material, fitting solves for the material that contracts best.
"""

from typing import TypeVar

import equinox as eqx
import jax
from jaxtyping import Array, Float

from diffshade.channels import Channels, channels, plus, times
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.base import AbstractLight
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from diffshade.shading.lights import LightSums, sum_over_lights
from diffshade.shading.one_light import angles, reflected

__all__ = ["Basis", "basis", "contract", "of_light_sums"]


class Basis(eqx.Module):
    """The image that a coefficient of 1 would give, term by term; None or () where absent.

    Object colours, which are known, are in it: O_d in the ambient and diffuse terms, O_s in the
    specular ones. Every term is a tuple with one entry for all channels, or one a channel.
    `ambient` holds numbers, I_a; `diffuse` planes [P], sum_j I_j f_j n.l_j; `specular` the same for
    each lobe.
    """

    ambient: Channels | None
    diffuse: Channels | None
    specular: tuple[Channels, ...]


def basis(gbuffer: GBuffer, scene: Scene, material: Material) -> Basis:
    """The basis of an image for `material`'s terms, lobes and colours; ka, kd and ks are not read.

    What is absent is not computed: no ambient without I_a and k_a, no n.l or l without lights, no
    view without a lobe, no distance without attenuation.
    """
    lit = bool(scene.lights) and (material.kd is not None or bool(material.specular))
    sums = _light_sums(gbuffer, scene.lights, material) if lit else (None, ())
    return of_light_sums(sums, scene.ambient, material)


def of_light_sums(
    sums: LightSums, ambient: Float[Array, "..."] | None, material: Material
) -> Basis:
    """The basis from the sums over the lights, the ambient light and the object colours."""
    diffuse, specular = sums
    if material.ka is None:
        ambient = None
    return Basis(
        ambient=_coloured(None if ambient is None else channels(ambient), material.od),
        diffuse=_coloured(diffuse, material.od),
        specular=tuple(_coloured(shape, material.os) for shape in specular),
    )


def contract(basis: Basis, material: Material) -> Channels:
    """The image's planes: the basis times ka, kd and each ks, summed.

    Empty where nothing is lit; a term that is the same for all pixels is a number. The basis is of
    a material with the same terms and lobes.
    """
    coefficients = (material.ka, material.kd, *(lobe.ks for lobe in material.specular))
    # Without lights there is no specular basis.
    shapes = (basis.ambient, basis.diffuse, *(basis.specular or (None,) * len(material.specular)))
    image: Channels = ()
    for coefficient, shape in zip(coefficients, shapes, strict=True):
        if coefficient is not None and shape is not None:
            term = times(channels(coefficient), shape)
            image = plus(image, term) if image else term
    return image


T = TypeVar("T", Channels, Channels | None)


def _coloured(shape: T, colour: Float[Array, "..."] | None) -> T:
    """A term times its object colour; None is 1, and nothing is computed."""
    if shape is None or colour is None:
        return shape
    return times(channels(colour), shape)


def _light_sums(
    gbuffer: GBuffer, lights: tuple[AbstractLight, ...], material: Material
) -> LightSums:
    def term(light: AbstractLight) -> LightSums:
        return reflected(angles(gbuffer, light, material.specular), light, material)

    sums = sum_over_lights(term, lights)
    return sums if gbuffer.spread is None else jax.tree.map(gbuffer.spread, sums)
