"""The planes of an image, and its squared error: the readable equations, led to a fast program.

Both are the composition of `basis` and `contract` over the foreground, evaluated page by page. A value
takes the passes of `in_one_pass`; a derivative goes through `written_out`, with the nodes of the
computation stored. `plain` is the composition alone, as XLA fuses it by itself.

Where lights are left out, within a `tolerance`, a page is a tile of the image: the foreground is put
into the order of tiles first, and the image's planes back.
"""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from diffshade.channels import Channels, per_channel
from diffshade.fusion import is_led, keeping, kept, page_size
from diffshade.geometry.gbuffer import GBuffer
from diffshade.pages import map_pages, sum_pages
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from diffshade.shading.basis import (
    Basis,
    Few,
    Lit,
    basis_of,
    contract,
    in_one_pass,
    lights_of,
    written_out,
)
from diffshade.shading.cull import TILE, tile_by_tile
from diffshade.shading.kept_geometry import KeptGeometry
from diffshade.shading.lights import Many

__all__ = ["image_planes", "squared_error"]

FEW = 2**14
"""Images of fewer pixels take a millisecond, however compiled: not worth the longer compilation."""
MANY = 32
"""From so many lights of finite reach on, asking which ones a tile needs costs less than it saves."""


def image_planes(
    surface: KeptGeometry,
    scene: Scene,
    material: Material,
    plain: bool,
    tolerance: Float[Array, ""] | None = None,
) -> Channels:
    """The image's foreground, one plane [P] a channel."""
    tolerance = _to_leave_out(surface, scene, plain, tolerance)
    arguments = _arguments(surface, scene, material, tolerance)
    if tolerance is None and not _by_pages(surface, plain):
        return _shaded(*arguments, few=written_out)
    value, for_derivative = partial(_shaded, few=in_one_pass), keeping(_stored)
    planes, count = _planes(*arguments), surface.pixel_count
    if tolerance is None:
        page, plainly = page_size(len(scene.lights)), partial(_shaded, few=written_out)
        return map_pages(value, arguments, planes, count, page, for_derivative, plainly)
    order = tile_by_tile(surface.gbuffer)
    ordered = _ordered(arguments, planes, order)
    tiles = map_pages(value, ordered, planes, count, TILE**2, for_derivative, None)
    return tuple(jnp.zeros_like(x).at[order].set(x, unique_indices=True) for x in tiles)


def squared_error(
    surface: KeptGeometry,
    scene: Scene,
    material: Material,
    observed: Float[Array, "C P"],
    plain: bool,
    tolerance: Float[Array, ""] | None = None,
) -> Float[Array, ""]:
    """The sum over pixels of the mean over channels of (image - observed)^2."""
    tolerance = _to_leave_out(surface, scene, plain, tolerance)
    if tolerance is None and not _by_pages(surface, plain):
        everywhere = jnp.ones(surface.pixel_count, bool)
        image = image_planes(surface, scene, material, plain)
        return _squares(image, observed, everywhere)

    @keeping
    def of_page(
        own: Bool[Array, "P"], observed: Float[Array, "C P"], *arguments: Any
    ) -> Float[Array, ""]:
        return _squares(_stored(*arguments), observed, own)

    arguments: tuple[Any, ...] = (observed, *_arguments(surface, scene, material, tolerance))
    planes = (True, *_planes(*arguments[1:]))
    page = page_size(len(scene.lights))
    if tolerance is not None:
        arguments = _ordered(arguments, planes, tile_by_tile(surface.gbuffer))
        page = TILE**2
    return sum_pages(of_page, arguments, planes, surface.pixel_count, page)


def _to_leave_out(
    surface: KeptGeometry, scene: Scene, plain: bool, tolerance: Float[Array, ""] | None
) -> Float[Array, ""] | None:
    """How much light tiles may leave out; None where all lights are computed, which is no error.

    Without a tolerance many lights of finite reach leave out nothing but zeros.
    """
    possible = surface.gbuffer.spread is None and surface.angles is None
    if plain or not possible or not is_led():
        return None
    if tolerance is None and sum(light.is_finite for light in scene.lights) >= MANY:
        return jnp.zeros((), surface.gbuffer.normal.x.dtype)
    return tolerance


def _ordered(arguments: Any, planes: Any, order: Int[Array, "P"]) -> Any:
    """The same with the pixels of its planes in another order."""
    return jax.tree.map(lambda is_plane, x: x[..., order] if is_plane else x, planes, arguments)


class Arguments(NamedTuple):
    """What an image is computed from, the lights gathered before any page is cut."""

    gbuffer: GBuffer
    ambient: Float[Array, "..."] | None
    lights: tuple[Lit | Many, ...]
    material: Material
    tolerance: Float[Array, ""] | None


def _arguments(
    surface: KeptGeometry, scene: Scene, material: Material, tolerance: Float[Array, ""] | None
) -> Arguments:
    lights = lights_of(scene, surface.angles)
    return Arguments(surface.gbuffer, scene.ambient, lights, material, tolerance)


def _planes(*arguments: Any) -> Arguments:
    """Which arrays are planes over the pixels: the G-buffer's but the eye's, known angles, maps."""
    gbuffer, ambient, lights, material, tolerance = arguments

    def all_of(tree: Any, are: bool) -> Any:
        return jax.tree.map(lambda _: are, tree)

    of_gbuffer = eqx.tree_at(
        lambda g: g.viewer, all_of(gbuffer, True), all_of(gbuffer.viewer, False)
    )
    of_lights = tuple(
        all_of(x, False) if isinstance(x, Many) else (all_of(x[0], False), all_of(x[1], True))
        for x in lights
    )
    maps = jax.tree.map(lambda x: x.ndim == 2, material)
    return Arguments(of_gbuffer, all_of(ambient, False), of_lights, maps, all_of(tolerance, False))


def _by_pages(surface: KeptGeometry, plain: bool) -> bool:
    """Whether there is a page to fill: the points that a mesh is shaded at are not the pixels."""
    paged = surface.gbuffer.spread is None and surface.pixel_count >= FEW
    return paged and is_led() and not plain


def _shaded(
    gbuffer: GBuffer,
    ambient: Float[Array, "..."] | None,
    lights: tuple[Lit | Many, ...],
    material: Material,
    tolerance: Float[Array, ""] | None,
    few: Few,
) -> Channels:
    dark = gbuffer.normal.x if gbuffer.spread is None else gbuffer.spread(gbuffer.normal.x)
    terms = basis_of(gbuffer, ambient, lights, material, few, tolerance)
    return _image(terms, material, dark)


def _stored(
    gbuffer: GBuffer,
    ambient: Float[Array, "..."] | None,
    lights: tuple[Lit | Many, ...],
    material: Material,
    tolerance: Float[Array, ""] | None,
) -> Channels:
    """The same from a stored basis: what reads the image does not compute it again."""
    terms = basis_of(gbuffer, ambient, lights, material, written_out, tolerance)
    return kept(_image, terms, material, gbuffer.normal.x)


def _image(terms: Basis, material: Material, like: Float[Array, "P"]) -> Channels:
    """The basis contracted; what is the same for all pixels becomes a plane."""
    dark = jnp.zeros_like(like)
    return tuple(plane + dark for plane in contract(terms, material)) or (dark,)


def _squares(
    image: Channels, observed: Float[Array, "C P"], own: Bool[Array, "P"]
) -> Float[Array, ""]:
    count = max(len(image), len(observed))
    pairs = zip(per_channel(image, count), per_channel(tuple(observed), count), strict=True)
    squares = [jnp.where(own, (i - o) ** 2, 0) for i, o in pairs]
    return sum(squares[1:], squares[0]).sum() / count
