"""The basis of an image: everything of the illumination equation but k_a, k_d and k_s.

    I = I_a k_a O_d + sum_j I_j f_j(d_j) [ k_d O_d max(0, n.l_j) + sum_m k_s,m O_s s_m(n, l_j, v) ]
                                                                            (LIGHT-13, with text C)

is linear in the coefficients. The sums over lights j are computed here, once, for both readers:
rendering contracts them with a material, fitting solves for the material that contracts best.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias, TypeVar

import equinox as eqx
import jax
from jax import lax
from jaxtyping import Array, Float

from diffshade.buckets import are_at_hand, cut, pad
from diffshade.channels import Channels, channels, plus, times
from diffshade.errors import BadInput
from diffshade.fusion import Led, kept, packed
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.base import AbstractLight
from diffshade.light.visible import check_visible
from diffshade.reflectance.material import Material, with_padded_maps
from diffshade.scene import Scene
from diffshade.shading.cull import at_most, tile_of
from diffshade.shading.lights import Dimmest, LightSums, Many, add, gathered, sum_over_lights
from diffshade.shading.one_light import Seen, angles, lit, reflected, unlit
from diffshade.vector import Vec3

__all__ = [
    "Basis",
    "Few",
    "Lit",
    "basis",
    "check_maps",
    "contract",
    "contracted",
    "in_one_pass",
    "lights_of",
    "of_light_sums",
    "terms",
    "written_out",
]


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


Lit: TypeAlias = tuple[AbstractLight, Seen | None]
"""A light, and under what angles it is seen where that is known already."""

Few: TypeAlias = Callable[[GBuffer, Sequence[Lit], Material, Vec3 | None], LightSums]
"""How the terms of a few lights are summed."""


def basis(gbuffer: GBuffer, scene: Scene, material: Material) -> Basis:
    """The basis of an image for `material`'s terms, lobes and colours; ka, kd and ks are not read.

    What is absent is not computed: no ambient without I_a and k_a, no n.l or l without lights, no
    view without a lobe, no distance without attenuation.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.4))
    >>> scene = ds.Scene(lights=ds.ParallelLight((0, 0, 1)))
    >>> [plane.shape for plane in basis(g, scene, ds.Material(kd=0.5)).diffuse]
    [(32,)]
    """
    check_maps(gbuffer, material)
    check_visible(scene.lights, gbuffer.point_count)
    if not are_at_hand((gbuffer, scene, material)):
        return _terms(gbuffer, scene, material)
    more = gbuffer.in_bucket(), scene.in_bucket(), with_padded_maps(material)
    found = _terms.outermost(*more)
    return cut(found, gbuffer.pixel_count)


def lights_of(scene: Scene, seen: tuple[Seen, ...] | None = None) -> tuple[Lit | Many, ...]:
    """A scene's lights, gathered where there are many of a kind, with the angles that are known."""
    if seen is not None:
        return tuple(zip(scene.lights, seen, strict=True))
    return gathered([(light, None) for light in scene.lights])


def terms(
    gbuffer: GBuffer,
    ambient: Float[Array, "..."] | None,
    lights: Sequence[Lit | Many],
    material: Material,
    few: Few,
    tolerance: Float[Array, ""] | None = None,
) -> Basis:
    """`basis`, as a part of a program.

    `few` is how the terms of a few lights are summed. With a `tolerance` lights that add up to no more
    on any of the pixels are left out (`cull`).
    """
    sums: LightSums = (None, ())
    if lights and (material.kd is not None or material.specular):
        known = all(not isinstance(x, Many) and x[1] is not None for x in lights)
        view = _view(gbuffer) if material.is_seen_from and not known else None

        def term(lights: Sequence[Lit]) -> LightSums:
            return few(gbuffer, lights, material, view)

        dimmest = None if tolerance is None else _dimmest(gbuffer, material, tolerance)
        sums = sum_over_lights(term, lights, dimmest)
        sums = sums if gbuffer.spread is None else jax.tree.map(gbuffer.spread, sums)
    return of_light_sums(sums, ambient, material)


def _dimmest(gbuffer: GBuffer, material: Material, tolerance: Float[Array, ""]) -> Dimmest:
    tile, material = lax.stop_gradient((tile_of(gbuffer, material), material))
    return Dimmest(lambda one: at_most(tile, one[0], material), lax.stop_gradient(tolerance))


def written_out(
    gbuffer: GBuffer, lights: Sequence[Lit], material: Material, view: Vec3 | None
) -> LightSums:
    """The sum over a few lights, one after the other."""
    total: LightSums | None = None
    for light, seen in lights:
        if seen is None:
            seen = kept(angles, gbuffer, light, material.specular, material.body, view)
        total = add(total, reflected(seen, light, material))
    assert total is not None
    return total


def in_one_pass(
    gbuffer: GBuffer, lights: Sequence[Lit], material: Material, view: Vec3 | None
) -> LightSums:
    """The same in as few passes over the planes as can be: one for all lights of one colour.

    Of coloured lights each is one pass, which leaves its colour out.
    """
    if all(light.intensity.ndim == 0 for light, _ in lights):
        return packed(written_out, gbuffer, lights, material, view)

    def colourless(one: Lit, gbuffer: GBuffer, material: Material, view: Vec3 | None) -> LightSums:
        light, seen = one
        if seen is None:
            seen = angles(gbuffer, light, material.specular, material.body, view)
        return unlit(seen, light, material)

    total: LightSums | None = None
    for one in lights:
        total = add(total, lit(one[0], packed(colourless, one, gbuffer, material, view)))
    assert total is not None
    return total


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

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.4))
    >>> scene, material = ds.Scene(lights=ds.ParallelLight((0, 0, 1))), ds.Material(kd=0.5)
    >>> [plane.shape for plane in contract(basis(g, scene, material), material)]
    [(32,)]
    """
    if not are_at_hand((basis, material)):
        return _contracted(basis, material)
    maps = [x for x in jax.tree.leaves(material) if x.ndim == 2]
    counts = {x.shape[-1] for x in (*jax.tree.leaves(basis), *maps) if x.ndim}
    if len(counts) > 1:
        raise BadInput(
            f"basis and material have planes of {sorted(counts)} pixels: give a basis and maps of one"
            " G-buffer"
        )
    return cut(
        _contracted.outermost(pad(basis), with_padded_maps(material)), max(counts, default=0)
    )


def contracted(basis: Basis, material: Material) -> Channels:
    """`contract`, as a part of a program."""
    coefficients = (material.ka, material.kd, *(lobe.ks for lobe in material.specular))
    # Without lights there is no specular basis.
    shapes = (basis.ambient, basis.diffuse, *(basis.specular or (None,) * len(material.specular)))
    image: Channels = ()
    for coefficient, shape in zip(coefficients, shapes, strict=True):
        if coefficient is not None and shape is not None:
            term = times(channels(coefficient), shape)
            image = plus(image, term) if image else term
    return image


def check_maps(gbuffer: GBuffer, material: Material) -> None:
    """Raise `BadInput` where a material's maps are not over the pixels of a G-buffer."""
    maps = [leaf.shape for leaf in jax.tree.leaves(material) if leaf.ndim == 2]
    if maps and gbuffer.spread is not None:
        raise BadInput(
            "a material has maps over pixels, and this G-buffer is shaded once a face or a vertex:"
            " use PhongShading()"
        )
    for shape in maps:
        if shape[1] != gbuffer.pixel_count:
            raise BadInput(
                f"a coefficient has shape {shape}: a map is [C or 1, P], P = {gbuffer.pixel_count}"
                " foreground pixels (GBuffer.from_image makes one of an image)"
            )


T = TypeVar("T", Channels, Channels | None)


def _coloured(shape: T, colour: Float[Array, "..."] | None) -> T:
    """A term times its object colour; None is 1, and nothing is computed."""
    if shape is None or colour is None:
        return shape
    return times(channels(colour), shape)


@Led
def _terms(gbuffer: GBuffer, scene: Scene, material: Material) -> Basis:
    return terms(gbuffer, scene.ambient, lights_of(scene), material, written_out)


_contracted = Led(contracted)


def _view(gbuffer: GBuffer) -> Vec3:
    return gbuffer.viewer.direction(gbuffer.position)
