"""The columns of the linear problem: what each linear coefficient adds to an image.

The image is A(u) k, with a column of A for k_a, for k_d and for the k_s of each lobe. Its geometry, under
every light at every point, does not depend on u: a `Scenery` holds it, and a search computes it once.
Lights of one kind are an axis of the planes, not a loop: a thousand compile in the time of one.
"""

import operator
from collections.abc import Callable
from dataclasses import replace
from functools import reduce
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Bool, Float

from diffshade.channels import Channels, per_channel, times
from diffshade.geometry.frequency import Spread
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.attenuation import AbstractAttenuation
from diffshade.light.base import AbstractLight
from diffshade.light.visible import map_visible, visible_of
from diffshade.reflectance.material import Material
from diffshade.shading.basis import of_light_sums
from diffshade.shading.lights import LightSums, add
from diffshade.shading.one_light import Seen, angles, reflected
from fitting.arrays import Array
from fitting.gauge import lit_by
from fitting.observation import Group

__all__ = [
    "Blocks",
    "Images",
    "Photo",
    "Scenery",
    "columns",
    "images_of",
    "photos",
    "predict",
    "scenery",
]


BLOCK = 65_536
"""Points in work at one time, where all of them are on the device."""


class Photo(eqx.Module):
    """One image of a group: its light, what was observed at P points, and a weight each (0: not used).

    `lights` are those of each kind, every leaf [L, ...]; `gain` is the strength of all of them. Of
    all images of a group at once every leaf has an axis more.
    """

    ambient: Float[Array, "..."] | None
    lights: tuple[AbstractLight, ...]
    observed: Float[Array, "*K C P"]
    weight: Float[Array, "*K P"]
    clipped: Bool[Array, "*K C P"] | None
    gain: Float[Array, "*K"] | None


def photos(group: Group, gains: Float[Array, "K"] | None) -> Photo:
    """All images of a group at once."""
    return Photo(group.ambient, group.lights, group.observed, group.weight, group.clipped, gains)


class Scenery(eqx.Module):
    """A photo, and what its lights' rays make of the surface: planes [L, S] for each kind of light.

    The S shaded points are the P points, but where intensities are spread over these.
    """

    photo: Photo
    angles: tuple[Seen, ...]
    spread: Spread | None


def scenery(photo: Photo, surface: GBuffer, material: Material) -> Scenery:
    """The geometry of a photo, for the lobes that a material has."""
    seen = tuple(
        jax.vmap(lambda light: angles(surface, light, material.specular, material.body))(kind)
        for kind in photo.lights
    )
    return Scenery(photo, seen, surface.spread)


class Images(eqx.Module):
    """All images of some groups with their geometry, at once; for samples, which are small.

    Every leaf has an axis more, for the images of its group.
    """

    groups: tuple[Scenery, ...]

    def each(self, of_image: Callable[[Scenery], Any]) -> list[Any]:
        """`of_image` of all images of every group."""

        def of_group(group: Scenery) -> Any:
            def of(photo: Photo, seen: tuple[Seen, ...]) -> Any:
                return of_image(Scenery(photo, seen, group.spread))

            return jax.vmap(of)(group.photo, group.angles)

        return [of_group(group) for group in self.groups]

    def sum(self, of_image: Callable[[Scenery], Array]) -> Array:
        """The sum of `of_image` over all images."""
        return reduce(operator.add, (jnp.sum(each, axis=0) for each in self.each(of_image)))


def images_of(
    groups: tuple[Group, ...], material: Material, gains: Float[Array, "K"] | None = None
) -> Images:
    """The groups' images, seen once; `gains` are those of all images, in the order of the groups."""

    def seen(group: Group, gains: Float[Array, "K"] | None) -> Scenery:
        def of(photo: Photo) -> tuple[Photo, tuple[Seen, ...]]:
            return photo, scenery(photo, group.surface, material).angles

        return Scenery(*jax.vmap(of)(photos(group, gains)), group.surface.spread)

    ends = np.cumsum([group.image_count for group in groups])[:-1]
    own = [None] * len(groups) if gains is None else jnp.split(gains, ends)
    return Images(tuple(seen(group, g) for group, g in zip(groups, own, strict=True)))


class Blocks(eqx.Module):
    """All images of some groups, block after block of points: no more is in work than one of an image."""

    groups: tuple[Group, ...]
    material: Material

    def sum(self, of_image: Callable[[Scenery], Array]) -> Array:
        """The sum of `of_image` over all blocks of all images."""
        return reduce(operator.add, (self._of_group(group, of_image) for group in self.groups))

    def _of_group(self, group: Group, of_image: Callable[[Scenery], Array]) -> Array:
        surface, size = group.surface, group.weight.shape[1]
        count = -(-size // BLOCK)
        length = -(-size // count)

        def cut(plane: Array) -> Array:
            # Filled up with a real point, at which everything is finite
            filling = jnp.repeat(plane[..., :1], count * length - size, axis=-1)
            whole = jnp.concatenate([plane, filling], axis=-1)
            return jnp.moveaxis(whole.reshape(*plane.shape[:-1], count, length), -2, 0)

        real = np.arange(count * length).reshape(count, 1, length) < size
        points = surface.spread or (surface.normal, surface.position, visible_of(group.lights))
        weight = jnp.where(real, cut(group.weight), 0)

        def of_block(block: tuple[Any, Array, Array]) -> Array:
            points, observed, weight = block
            lights = group.lights
            if surface.spread is None:
                here = replace(surface, shape=(1, length), normal=points[0], position=points[1])
                planes = iter(points[2])
                lights = map_visible(lambda _: next(planes), lights)
            else:
                here = replace(surface, shape=(1, length), spread=points)
            some = Group(here, group.ambient, lights, observed, weight)

            def of_photo(photo: Photo) -> Array:
                return of_image(scenery(photo, here, self.material))

            return jnp.sum(lax.map(of_photo, photos(some, None)), axis=0)

        blocks = (jax.tree.map(cut, points), cut(group.observed), weight)
        return jnp.sum(lax.map(of_block, blocks), axis=0)


def columns(
    material: Material, law: AbstractAttenuation | None, at: Scenery, channel_count: int
) -> tuple[Channels, ...]:
    """What each linear coefficient adds to the image: p columns of planes [P].

    Each has one plane a channel, or all have one for all channels. `law` is the attenuation of the
    point lights where that is fitted.
    """

    def of_light(seen: Seen, light: AbstractLight) -> LightSums:
        return reflected(seen, light if law is None else lit_by(light, law), material)

    total: LightSums | None = None
    for seen, kind in zip(at.angles, at.photo.lights, strict=True):
        each = jax.vmap(of_light)(seen, kind)
        total = add(total, jax.tree.map(lambda planes: jnp.sum(planes, axis=0), each))
    sums = (None, ()) if total is None else total
    if at.spread is not None:
        sums = jax.tree.map(at.spread, sums)
    terms = of_light_sums(sums, at.photo.ambient, material)

    gain = at.photo.gain
    lit = [
        *((terms.diffuse,) if material.kd is not None else ()),
        *(terms.specular or (None,) * len(material.specular)),
    ]
    if gain is not None:
        lit = [None if term is None else times(term, (gain,)) for term in lit]
    present = [*((terms.ambient,) if material.ka is not None else ()), *lit]
    dark = jnp.zeros_like(at.photo.weight)
    grey = all(term is None or len(term) == 1 for term in present)
    return tuple(
        tuple(plane + dark for plane in per_channel(term or (dark,), 1 if grey else channel_count))
        for term in present
    )


def predict(columns: tuple[Channels, ...], k: Float[Array, "C p"]) -> Channels:
    """The image A k, a plane a channel."""
    terms = [
        tuple(plane * own for plane, own in zip(per_channel(column, len(k)), ks, strict=True))
        for column, ks in zip(columns, k.T, strict=True)
    ]
    return tuple(reduce(operator.add, planes) for planes in zip(*terms, strict=True))
