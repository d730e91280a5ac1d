"""From a G-buffer, a scene and a material to an image."""

from collections.abc import Callable, Sequence
from functools import cache, partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from diffshade.arrays import ArrayLike, is_concrete, is_outermost
from diffshade.channels import Channels
from diffshade.errors import BadInput
from diffshade.fusion import compiler_options
from diffshade.geometry.gbuffer import GBuffer
from diffshade.reflectance.material import Material, by_slot
from diffshade.scene import Scene
from diffshade.shading.image import image_planes, squared_error
from diffshade.shading.kept_geometry import KeptGeometry, kinds
from diffshade.shading.sharded import Sharded

__all__ = ["mean_squared_error", "render"]


def render(
    gbuffer: GBuffer | KeptGeometry | Sharded,
    scene: Scene,
    material: Material | Sequence[Material],
    *,
    plain: bool = False,
) -> Float[Array, "H W C"]:
    """The image I = I_a k_a + sum_j I_j f(d_j) [k_d n.l_j + k_s (r_j.v)^n] (LIGHT-13).

    Linear radiance [H, W, C] in the unit of the lights' intensities, background 0; C is the number
    of channels of lights and coefficients. A surface with several materials takes a sequence of
    them, numbered by `gbuffer.slot`. What scene or material lack is not computed.

    It nests in `jit`, `grad`, `vmap` and `scan`, and every derivative is exact, for every input, in
    forward and reverse mode. Called outermost with concrete arrays it compiles with the best
    options for the platform. Not smooth where n.l = 0, r.v = 0 and where an attenuation is clamped.
    `plain` leaves the program to XLA: the same image to rounding, slower on a CPU. Of `ds.shard`ed
    surfaces each device shades its own pixels. For many scenes or materials `jax.lax.map` takes one
    at a time; `jax.vmap` is twice as fast for the squared error of many materials, and twice as slow
    for gradients under many scenes, for a page then has planes for all of them. Images of fewer
    than 16,384 foreground pixels are best rendered in a loop.

    Raises `BadInput` for numbers of channels that do not match, a point light or an eye with a
    G-buffer that has no positions, and a sequence of materials with a G-buffer that has no slots.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.4))
    >>> ds.render(g, ds.Scene(lights=ds.ParallelLight((0, 0, 1))), ds.Material(kd=0.5)).shape
    (8, 8, 1)
    """
    arguments = _checked(gbuffer, scene, material)
    if is_outermost() and is_concrete(arguments):
        return _to_image(arguments[0].gbuffer, _planes_jit()(*arguments, plain))
    return _render(*arguments, plain)


def mean_squared_error(
    gbuffer: GBuffer | KeptGeometry | Sharded,
    scene: Scene,
    material: Material | Sequence[Material],
    image: ArrayLike,
    *,
    plain: bool = False,
) -> Float[Array, ""]:
    """The mean of (I - image)^2 over foreground pixels and channels, I as `render` has it.

    `image` is [H, W, C], or the foreground's planes [C, P] as `GBuffer.from_image` gives them, which
    spares a search for the same loss again and again to look for its foreground. Value and gradient
    take one way through the pixels on a CPU, page by page, and no memory beyond the gradient.
    Exact for every input, in forward and reverse mode; raises as `render` does, for an image of
    another size, and for a G-buffer without foreground.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.4))
    >>> scene, material = ds.Scene(lights=ds.ParallelLight((0, 0, 1))), ds.Material(kd=0.5)
    >>> float(mean_squared_error(g, scene, material, ds.render(g, scene, material)))
    0.0
    """
    surface, scene, one = _checked(gbuffer, scene, material)
    if not isinstance(image, jax.Array):
        image = jnp.asarray(image, float)
    if not surface.pixel_count:
        raise BadInput("the G-buffer has no foreground pixel: there is nothing to compare")
    shape, pixels = surface.gbuffer.shape, surface.pixel_count
    if image.ndim == 3 and image.shape[:2] == shape:
        image = surface.from_image(image)
    elif image.ndim != 2 or image.shape[1] != pixels:
        raise BadInput(
            f"the image has shape {image.shape}: give [{shape[0]}, {shape[1]}, C], or the"
            f" foreground's planes [C, {pixels}]"
        )
    return _mean_squared_error(surface, scene, one, image, plain)


def _checked(
    gbuffer: GBuffer | KeptGeometry | Sharded, scene: Scene, material: Material | Sequence[Material]
) -> tuple[KeptGeometry | Sharded, Scene, Material]:
    surface = KeptGeometry(gbuffer, None) if isinstance(gbuffer, GBuffer) else gbuffer
    one = _one_material(surface.gbuffer, material)
    _check_maps(surface.gbuffer, one)
    kept = surface.surface if isinstance(surface, Sharded) else surface
    if kept.angles is not None:
        _check_kept(kept, scene, one)
    return surface, scene, one


def _one_material(gbuffer: GBuffer, material: Material | Sequence[Material]) -> Material:
    if isinstance(material, Material):
        return material
    if not material:
        raise BadInput("no materials are given: give one, or one a slot")
    if len(material) == 1:
        return material[0]
    if gbuffer.slot is None:
        raise BadInput(
            f"{len(material)} materials for a surface that has one: give one material, or a mesh"
            " whose faces have slots"
        )
    return by_slot(material, gbuffer.slot)


def _check_maps(gbuffer: GBuffer, material: Material) -> None:
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


def _check_kept(kept: KeptGeometry, scene: Scene, material: Material) -> None:
    asked = kinds(scene, material)
    if asked != kept.kinds:
        raise BadInput(
            f"the kept geometry is of {_listed(kept.kinds)}, and what is rendered has"
            f" {_listed(asked)}: keep it for this scene and material"
        )
    for seen, light in zip(kept.angles or (), scene.lights, strict=True):
        if getattr(light, "attenuation", None) is not None and seen.distance is None:
            raise BadInput(
                "the kept geometry has no distance to a light, which has an attenuation now: keep it"
                " for this scene"
            )


def _listed(kinds: tuple[str, ...]) -> str:
    return ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds)) or "no lights"


@partial(jax.jit, static_argnums=3)
def _render(
    surface: KeptGeometry | Sharded, scene: Scene, material: Material, plain: bool
) -> Float[Array, "H W C"]:
    return surface.gbuffer.to_image(image_planes(surface, scene, material, plain))


@partial(jax.jit, static_argnums=4)
def _mean_squared_error(
    surface: KeptGeometry | Sharded,
    scene: Scene,
    material: Material,
    observed: Float[Array, "C P"],
    plain: bool,
) -> Float[Array, ""]:
    return squared_error(surface, scene, material, observed, plain) / surface.foreground


@cache
def _planes_jit() -> Callable[[KeptGeometry | Sharded, Scene, Material, bool], Channels]:
    return jax.jit(image_planes, static_argnums=3, compiler_options=compiler_options())


_to_image = jax.jit(GBuffer.to_image)
