"""The planes of an image, and its squared error: the readable equations, led to a fast program.

Both are the composition of `basis` and `contract` over the foreground, evaluated page by page. A value
takes the passes of `in_one_pass`; a derivative goes through `written_out`, with the nodes of the
computation stored. `plain` is the composition alone, as XLA fuses it by itself.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from diffshade.channels import Channels, per_channel
from diffshade.fusion import is_led, keeping, kept, page_size
from diffshade.pages import map_pages, sum_pages
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from diffshade.shading.basis import Basis, Few, contracted, in_one_pass, terms, written_out
from diffshade.shading.kept_geometry import KeptGeometry

__all__ = ["image_planes", "image_rows", "squared_error"]

FEW = 2**14
"""Images of fewer pixels take a millisecond, however compiled: not worth the longer compilation."""


def image_planes(surface: KeptGeometry, scene: Scene, material: Material, plain: bool) -> Channels:
    """The image's foreground, one plane [P] a channel."""
    return _everywhere(tuple, surface, scene, material, plain)


def image_rows(
    surface: KeptGeometry,
    scene: Scene,
    material: Material,
    plain: bool,
    wanted: Int[Array, ""],
) -> Float[Array, "P C"]:
    """The image's foreground, one row a pixel; past the first `wanted` pixels, anything."""

    def rows(planes: Channels) -> tuple[Array]:
        return (jnp.stack(planes, axis=-1),)

    return _everywhere(rows, surface, scene, material, plain, wanted)[0]


def _everywhere(
    arranged: Callable[[Channels], tuple[Array, ...]],
    surface: KeptGeometry,
    scene: Scene,
    material: Material,
    plain: bool,
    wanted: Int[Array, ""] | None = None,
) -> tuple[Array, ...]:
    """The image's planes, arranged page by page, while they are in the cache."""

    def value(surface: KeptGeometry, scene: Scene, material: Material) -> tuple[Array, ...]:
        return arranged(_shaded(surface, scene, material, in_one_pass))

    def plainly(surface: KeptGeometry, scene: Scene, material: Material) -> tuple[Array, ...]:
        return arranged(_shaded(surface, scene, material, written_out))

    def stored(surface: KeptGeometry, scene: Scene, material: Material) -> tuple[Array, ...]:
        return arranged(_stored(surface, scene, material))

    if not _by_pages(surface, plain):
        return plainly(surface, scene, material)
    arguments, count = (surface, scene, material), surface.pixel_count
    planes, page = _planes(*arguments), _page(count, wanted)
    return map_pages(value, arguments, planes, count, page, keeping(stored), plainly, wanted)


def squared_error(
    surface: KeptGeometry,
    scene: Scene,
    material: Material,
    observed: Float[Array, "C P"],
    plain: bool,
    wanted: Int[Array, ""] | None = None,
) -> Float[Array, ""]:
    """The sum over the first `wanted` pixels of the mean over channels of (image - observed)^2.

    Over all of them, where it is None.
    """
    if not _by_pages(surface, plain):
        pixel = jnp.arange(surface.pixel_count)
        own = jnp.ones_like(pixel, bool) if wanted is None else pixel < wanted
        return _squares(image_planes(surface, scene, material, plain), observed, own)

    @keeping
    def of_page(
        own: Bool[Array, "P"],
        surface: KeptGeometry,
        scene: Scene,
        material: Material,
        observed: Float[Array, "C P"],
    ) -> Float[Array, ""]:
        return _squares(_stored(surface, scene, material), observed, own)

    arguments = (surface, scene, material, observed)
    planes = (*_planes(surface, scene, material), True)
    count = surface.pixel_count
    return sum_pages(of_page, arguments, planes, count, _page(count, wanted), wanted)


def _planes(surface: KeptGeometry, scene: Scene, material: Material) -> tuple[Any, Any, Any]:
    """Which arrays are planes over the pixels: of the surface, all but the eye's; of a material, maps."""
    of_gbuffer = jax.tree.map(lambda _: True, surface)
    of_gbuffer = eqx.tree_at(
        lambda s: s.gbuffer.viewer,
        of_gbuffer,
        jax.tree.map(lambda _: False, surface.gbuffer.viewer),
    )
    of_scene = jax.tree.map(lambda _: False, scene)
    return of_gbuffer, of_scene, jax.tree.map(lambda x: x.ndim == 2, material)


def _by_pages(surface: KeptGeometry, plain: bool) -> bool:
    """Whether there is a page to fill: the points that a mesh is shaded at are not the pixels."""
    paged = surface.gbuffer.spread is None and surface.pixel_count >= FEW
    return paged and is_led() and not plain


def _page(count: int, wanted: Int[Array, ""] | None) -> int:
    """How many pixels are shaded at once: fewer of a padded image, whose last page is in part in vain."""
    return page_size() if wanted is None else min(page_size(), max(FEW, count // 16))


def _shaded(surface: KeptGeometry, scene: Scene, material: Material, few: Few) -> Channels:
    gbuffer = surface.gbuffer
    dark = gbuffer.normal.x if gbuffer.spread is None else gbuffer.spread(gbuffer.normal.x)
    return _image(terms(gbuffer, scene, material, surface.angles, few), material, dark)


def _stored(surface: KeptGeometry, scene: Scene, material: Material) -> Channels:
    """The same from a stored basis: what reads the image does not compute it again."""
    gbuffer = surface.gbuffer
    basis = terms(gbuffer, scene, material, surface.angles, written_out)
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
