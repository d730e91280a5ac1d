"""The planes of an image, and its squared error: the readable equations, led to a fast program.

Both are the composition of `terms` and `contracted` over the foreground, evaluated page by page. A
value takes the passes of `in_one_pass`; a derivative goes through `written_out`, with the nodes of the
computation stored. `plain` is the composition alone, as XLA fuses it by itself. Over several devices
each has its own pixels, page by page, and the sums of a squared error are added up.

Where lights are left out, within a `tolerance`, a page is a tile of the image: the foreground is put
into the order of tiles first, and the image's planes back.
"""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from diffshade.channels import Channels, per_channel
from diffshade.fusion import is_led, keeping, kept, page_size, stored
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.visible import are_planes
from diffshade.pages import map_pages, sum_pages
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from diffshade.shading.basis import (
    Basis,
    Few,
    Lit,
    contracted,
    in_one_pass,
    lights_of,
    terms,
    written_out,
)
from diffshade.shading.cull import TILE, tile_by_tile
from diffshade.shading.kept_geometry import KeptGeometry, planes_of
from diffshade.shading.lights import Many
from diffshade.shading.sharded import Sharded, on_each

__all__ = ["error_of_lights", "image_planes", "image_rows", "squared_error"]

FEW = 2**14
"""Images of fewer pixels take a millisecond, however compiled: not worth the longer compilation."""
MANY = 32
"""From so many lights of finite reach on, asking which ones a tile needs costs less than it saves."""

Surface = KeptGeometry | Sharded
Tolerance = Float[Array, ""] | None


def image_planes(
    surface: Surface, scene: Scene, material: Material, plain: bool, tolerance: Tolerance = None
) -> Channels:
    """The image's foreground, one plane [P] a channel."""
    arguments = _arguments(surface, scene, material, tolerance)
    shade = partial(_shade, tuple, plain=plain, wanted=None)
    if isinstance(surface, Sharded):
        return on_each(shade, surface.mesh, tuple(arguments), tuple(_planes(arguments)))
    return shade(*arguments)


def image_rows(
    surface: KeptGeometry, scene: Scene, material: Material, plain: bool, wanted: Int[Array, ""]
) -> Float[Array, "P C"]:
    """The image's foreground, one row a pixel; past the first `wanted` pixels, anything."""

    def rows(planes: Channels) -> tuple[Array]:
        return (jnp.stack(planes, axis=-1),)

    arguments = _arguments(surface, scene, material, None)
    return _shade(rows, *arguments, plain=plain, wanted=wanted)[0]


def squared_error(
    surface: Surface,
    scene: Scene,
    material: Material,
    observed: Float[Array, "C P"],
    plain: bool,
    tolerance: Tolerance = None,
    wanted: Int[Array, ""] | None = None,
) -> Float[Array, ""]:
    """The sum over the first `wanted` pixels of the mean over channels of (image - observed)^2.

    Over all of them, where it is None; of a surface on several devices, but for repeated ones.
    """
    arguments = _arguments(surface, scene, material, tolerance)
    add_up = partial(_add_up, plain=plain, wanted=wanted)
    if not isinstance(surface, Sharded):
        return add_up(observed, None, *arguments)
    counted = surface.counted()

    def part(*arguments: Any) -> Float[Array, "1"]:
        return add_up(*arguments)[None]

    planes = (True, None if counted is None else True, *_planes(arguments))
    return on_each(part, surface.mesh, (observed, counted, *arguments), planes).sum()


def error_of_lights(surface: Surface, scene: Scene, plain: bool, tolerance: Tolerance) -> Tolerance:
    """How much light tiles may leave out; None where all lights are computed, which is no error.

    Without a tolerance many lights of finite reach leave out nothing but zeros.
    """
    if plain or not is_led() or isinstance(surface, Sharded) or not surface.pixel_count:
        return None
    if surface.gbuffer.spread is not None or surface.angles is not None:
        return None
    if tolerance is None and sum(light.is_finite for light in scene.lights) >= MANY:
        return jnp.zeros((), surface.gbuffer.normal.x.dtype)
    return tolerance


class Arguments(NamedTuple):
    """What an image is computed from, the lights gathered before any page is cut."""

    gbuffer: GBuffer
    ambient: Float[Array, "..."] | None
    lights: tuple[Lit | Many, ...]
    material: Material
    tolerance: Tolerance


def _arguments(
    surface: Surface, scene: Scene, material: Material, tolerance: Tolerance
) -> Arguments:
    own = surface.surface if isinstance(surface, Sharded) else surface
    lights = lights_of(scene, own.angles)
    return Arguments(own.gbuffer, scene.ambient, lights, material, tolerance)


def _planes(arguments: Arguments) -> Arguments:
    """Which arrays are planes over the pixels: the G-buffer's but the eye's, what is visible of lights,
    known angles, maps.
    """

    def all_of(tree: Any, are: bool) -> PyTree:
        return jax.tree.map(lambda _: are, tree)

    gbuffer, ambient, lights, material, tolerance = arguments
    return Arguments(
        planes_of(KeptGeometry(gbuffer, None)).gbuffer,
        all_of(ambient, False),
        tuple(
            are_planes(x) if isinstance(x, Many) else (are_planes(x[0]), all_of(x[1], True))
            for x in lights
        ),
        jax.tree.map(lambda x: x.ndim == 2, material),
        all_of(tolerance, False),
    )


def _shade(
    arranged: Callable[[Channels], tuple[Array, ...]],
    *arguments: Any,
    plain: bool,
    wanted: Int[Array, ""] | None,
) -> tuple[Array, ...]:
    """The image's planes, arranged page by page, while they are in the cache."""

    def value(*arguments: Any) -> tuple[Array, ...]:
        return arranged(_shaded(in_one_pass, Arguments(*arguments)))

    def plainly(*arguments: Any) -> tuple[Array, ...]:
        return arranged(_shaded(written_out, Arguments(*arguments)))

    @keeping
    def for_derivative(*arguments: Any) -> tuple[Array, ...]:
        return arranged(_stored(Arguments(*arguments)))

    gbuffer, _, lights, _, tolerance = given = Arguments(*arguments)
    planes, count = _planes(given), gbuffer.pixel_count
    if tolerance is not None:
        order = tile_by_tile(gbuffer)
        ordered = _ordered(given, planes, order)
        tile = TILE**2
        tiles = map_pages(value, ordered, planes, count, tile, for_derivative, tile, None)
        return tuple(jnp.zeros_like(x).at[order].set(x, unique_indices=True) for x in tiles)
    if not _by_pages(gbuffer, plain):
        return plainly(*arguments)
    page = _page(page_size(), count, wanted)
    smaller = _page(page_size(_count(lights)), count, wanted)
    return map_pages(
        value, arguments, planes, count, page, for_derivative, smaller, plainly, wanted
    )


def _add_up(
    observed: Float[Array, "C P"],
    counted: Bool[Array, "P"] | None,
    *arguments: Any,
    plain: bool,
    wanted: Int[Array, ""] | None,
) -> Float[Array, ""]:
    """The squared error of the first `wanted` pixels, as far as they are `counted`; None: all."""

    @keeping
    def of_page(
        own: Bool[Array, "P"],
        observed: Float[Array, "C P"],
        counted: Bool[Array, "P"] | None,
        *arguments: Any,
    ) -> Float[Array, ""]:
        own = own if counted is None else own & counted
        return _squares(_stored(Arguments(*arguments)), observed, own)

    gbuffer, _, lights, _, tolerance = given = Arguments(*arguments)
    count = gbuffer.pixel_count
    if tolerance is None and not _by_pages(gbuffer, plain):
        own = jnp.ones(count, bool) if counted is None else counted
        own = own if wanted is None else own & (jnp.arange(count) < wanted)
        return _squares(_shaded(written_out, given), observed, own)
    everything: tuple[Any, ...] = (observed, counted, *given)
    planes = (True, None if counted is None else True, *_planes(given))
    page = _page(page_size(_count(lights)), count, wanted)
    if tolerance is not None:
        everything = _ordered(everything, planes, tile_by_tile(gbuffer))
        page = TILE**2
    return sum_pages(of_page, everything, planes, count, page, wanted)


def _ordered(arguments: Any, planes: Any, order: Int[Array, "P"]) -> Any:
    """The same with the pixels of its planes in another order."""
    return jax.tree.map(lambda is_plane, x: x[..., order] if is_plane else x, planes, arguments)


def _by_pages(gbuffer: GBuffer, plain: bool) -> bool:
    """Whether there is a page to fill: the points that a mesh is shaded at are not the pixels."""
    return gbuffer.spread is None and gbuffer.pixel_count >= FEW and is_led() and not plain


def _page(page: int, count: int, wanted: Int[Array, ""] | None) -> int:
    """How many pixels are shaded at once: fewer of a padded image, whose last page is in part in vain."""
    return page if wanted is None else min(page, max(FEW, count // 8))


def _count(lights: tuple[Lit | Many, ...]) -> int:
    return sum(x.count if isinstance(x, Many) else 1 for x in lights)


def _shaded(few: Few, given: Arguments) -> Channels:
    """The image of the shaded points, spread over the pixels where these are others."""
    gbuffer, ambient, lights, material, tolerance = given
    points = dataclasses.replace(gbuffer, spread=None)
    basis = terms(points, ambient, lights, material, few, tolerance)
    image = _image(basis, material, gbuffer.normal.x)
    if gbuffer.spread is None:
        return image
    # Stored before, or XLA shades a point for every pixel that reads it; and after, or it spreads
    # slowly, within the loop that puts channels side by side
    spread = gbuffer.spread
    points = stored(lambda *planes: planes, *image)
    return stored(lambda *planes: tuple(map(spread, planes)), *points)


def _stored(given: Arguments) -> Channels:
    """The same from a stored basis: what reads the image does not compute it again."""
    gbuffer, ambient, lights, material, tolerance = given
    basis = terms(gbuffer, ambient, lights, material, written_out, tolerance)
    return kept(_image, basis, material, gbuffer.normal.x)


def _image(basis: Basis, material: Material, like: Float[Array, "P"]) -> Channels:
    """The basis contracted; what is the same for all pixels becomes a plane."""
    dark = jnp.zeros_like(like)
    return tuple(plane + dark for plane in contracted(basis, material)) or (dark,)


def _squares(
    image: Channels, observed: Float[Array, "C P"], own: Bool[Array, "P"]
) -> Float[Array, ""]:
    count = max(len(image), len(observed))
    pairs = zip(per_channel(image, count), per_channel(tuple(observed), count), strict=True)
    squares = [jnp.where(own, (i - o) ** 2, 0) for i, o in pairs]
    return sum(squares[1:], squares[0]).sum() / count
