"""The planes of an image, and its squared error: the readable equations, led to a fast program.

Both are the composition of `basis` and `contract` over the foreground, evaluated page by page. A value
takes the passes of `in_one_pass`; a derivative goes through `written_out`, with the nodes of the
computation stored. `plain` is the composition alone, as XLA fuses it by itself. Over several devices
each has its own pixels, page by page, and the sums of a squared error are added up.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from diffshade.channels import Channels, per_channel
from diffshade.fusion import is_led, keeping, kept, page_size
from diffshade.pages import map_pages, sum_pages
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from diffshade.shading.basis import Basis, Few, basis, contract, in_one_pass, written_out
from diffshade.shading.kept_geometry import KeptGeometry, planes_of
from diffshade.shading.sharded import Sharded, on_each

__all__ = ["image_planes", "squared_error"]

FEW = 2**14
"""Images of fewer pixels take a millisecond, however compiled: not worth the longer compilation."""


def image_planes(
    surface: KeptGeometry | Sharded, scene: Scene, material: Material, plain: bool
) -> Channels:
    """The image's foreground, one plane [P] a channel."""
    if isinstance(surface, Sharded):
        shared = (surface.surface, scene, material)
        return on_each(partial(image_planes, plain=plain), surface.mesh, shared, _planes(*shared))
    if not _by_pages(surface, plain):
        return _shaded(surface, scene, material, written_out)

    def value(surface: KeptGeometry, scene: Scene, material: Material) -> Channels:
        return _shaded(surface, scene, material, in_one_pass)

    def plainly(surface: KeptGeometry, scene: Scene, material: Material) -> Channels:
        return _shaded(surface, scene, material, written_out)

    arguments = (surface, scene, material)
    planes = _planes(*arguments)
    return map_pages(
        value, arguments, planes, surface.pixel_count, page_size(), keeping(_stored), plainly
    )


def squared_error(
    surface: KeptGeometry | Sharded,
    scene: Scene,
    material: Material,
    observed: Float[Array, "C P"],
    plain: bool,
) -> Float[Array, ""]:
    """The sum over pixels of the mean over channels of (image - observed)^2."""
    if not isinstance(surface, Sharded):
        return _squared_error(surface, scene, material, observed, None, plain=plain)

    def part(*arguments: Any) -> Float[Array, "1"]:
        return _squared_error(*arguments, plain=plain)[None]

    counted = surface.counted()
    arguments = (surface.surface, scene, material, observed, counted)
    planes = (*_planes(*arguments[:3]), True, None if counted is None else True)
    return on_each(part, surface.mesh, arguments, planes).sum()


def _squared_error(
    surface: KeptGeometry,
    scene: Scene,
    material: Material,
    observed: Float[Array, "C P"],
    counted: Bool[Array, "P"] | None,
    *,
    plain: bool,
) -> Float[Array, ""]:
    """That of the pixels that are `counted`; None: of all."""
    if not _by_pages(surface, plain):
        everywhere = jnp.ones(surface.pixel_count, bool) if counted is None else counted
        image = image_planes(surface, scene, material, plain)
        return _squares(image, observed, everywhere)

    @keeping
    def of_page(
        own: Bool[Array, "P"],
        surface: KeptGeometry,
        scene: Scene,
        material: Material,
        observed: Float[Array, "C P"],
        counted: Bool[Array, "P"] | None,
    ) -> Float[Array, ""]:
        own = own if counted is None else own & counted
        return _squares(_stored(surface, scene, material), observed, own)

    arguments = (surface, scene, material, observed, counted)
    planes = (*_planes(surface, scene, material), True, None if counted is None else True)
    return sum_pages(of_page, arguments, planes, surface.pixel_count, page_size())


def _planes(surface: KeptGeometry, scene: Scene, material: Material) -> tuple[Any, Any, Any]:
    """Which arrays are planes over the pixels: of a material, maps."""
    of_scene = jax.tree.map(lambda _: False, scene)
    return planes_of(surface), of_scene, jax.tree.map(lambda x: x.ndim == 2, material)


def _by_pages(surface: KeptGeometry, plain: bool) -> bool:
    """Whether there is a page to fill: the points that a mesh is shaded at are not the pixels."""
    paged = surface.gbuffer.spread is None and surface.pixel_count >= FEW
    return paged and is_led() and not plain


def _shaded(surface: KeptGeometry, scene: Scene, material: Material, few: Few) -> Channels:
    gbuffer = surface.gbuffer
    dark = gbuffer.normal.x if gbuffer.spread is None else gbuffer.spread(gbuffer.normal.x)
    return _image(basis(gbuffer, scene, material, surface.angles, few), material, dark)


def _stored(surface: KeptGeometry, scene: Scene, material: Material) -> Channels:
    """The same from a stored basis: what reads the image does not compute it again."""
    gbuffer = surface.gbuffer
    terms = basis(gbuffer, scene, material, surface.angles, written_out)
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
