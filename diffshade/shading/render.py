"""From a G-buffer, a scene and a material to an image."""

from collections.abc import Sequence
from functools import partial
from typing import TypeAlias

import jax
import numpy as np
from jaxtyping import Array, Float, Int

from diffshade.arrays import ArrayLike, optional, positive
from diffshade.buckets import are_at_hand, pad
from diffshade.errors import BadInput
from diffshade.fusion import Led
from diffshade.geometry.gbuffer import GBuffer, check_lengths
from diffshade.light.visible import check_visible
from diffshade.reflectance.material import Material, by_slot, check_slots, with_padded_maps
from diffshade.scene import Scene
from diffshade.shading.basis import check_maps
from diffshade.shading.image import error_of_lights, image_planes, image_rows, squared_error
from diffshade.shading.kept_geometry import KeptGeometry, kinds
from diffshade.shading.sharded import Sharded

__all__ = ["mean_squared_error", "render"]

Materials: TypeAlias = tuple[Material, ...]
"""One, or one a slot."""


def render(
    gbuffer: GBuffer | KeptGeometry | Sharded,
    scene: Scene,
    material: Material | Sequence[Material],
    *,
    plain: bool = False,
    tolerance: ArrayLike | None = None,
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
    for gradients under many scenes, for a page then has planes for all of them.

    Of many lights a CPU leaves out, tile by tile, what adds up to at most `tolerance` in any channel of
    any pixel, in the unit of the image; 0 leaves out what is exactly dark, as is done without asking
    for many lights of finite reach (`Windowed`). Derivatives are those of the lights that are left:
    from a coefficient or an intensity of 0 ask for no more than a tolerance of 0.
    Kept geometry, several devices and points that are no pixels have all lights computed.

    Raises `BadInput` for numbers of channels that do not match, a point light or an eye with a
    G-buffer that has no positions, and a sequence of materials with a G-buffer that has no slots.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.4))
    >>> ds.render(g, ds.Scene(lights=ds.ParallelLight((0, 0, 1))), ds.Material(kd=0.5)).shape
    (8, 8, 1)
    """
    surface, scene, materials = _checked(gbuffer, scene, material)
    error = error_of_lights(surface, scene, plain, _tolerance(tolerance))
    given = (surface, scene, materials)
    if isinstance(surface, Sharded) or error is not None or not are_at_hand(given):
        return _render(surface, scene, materials, plain, error)
    more = surface.in_bucket(), scene.in_bucket(), with_padded_maps(materials)
    return surface.gbuffer.placed(_rows.outermost(*more, surface.pixel_count, plain))


def mean_squared_error(
    gbuffer: GBuffer | KeptGeometry | Sharded,
    scene: Scene,
    material: Material | Sequence[Material],
    image: ArrayLike,
    *,
    plain: bool = False,
    tolerance: ArrayLike | None = None,
) -> Float[Array, ""]:
    """The mean of (I - image)^2 over foreground pixels and channels, I as `render` has it.

    `image` is [H, W, C], or the foreground's planes [C, P] as `GBuffer.from_image` gives them, which
    spares a search for the same loss again and again to look for its foreground. Value and gradient
    take one way through the pixels on a CPU, page by page, and no memory beyond the gradient.
    Exact for every input, in forward and reverse mode; raises as `render` does, for an image of
    another size, and for a G-buffer without foreground. `plain` and `tolerance` are those of `render`.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.4))
    >>> scene, material = ds.Scene(lights=ds.ParallelLight((0, 0, 1))), ds.Material(kd=0.5)
    >>> float(mean_squared_error(g, scene, material, ds.render(g, scene, material)))
    0.0
    """
    surface, scene, materials = _checked(gbuffer, scene, material)
    if isinstance(image, jax.Array):
        observed: jax.Array = image
    else:
        try:
            host = np.asarray(image, jax.dtypes.canonicalize_dtype(float))
        except (TypeError, ValueError):
            raise BadInput(
                f"the image is a {type(image).__name__} that is no array: give numbers [H, W, C]"
            ) from None
        observed = jax.device_put(host)
    if not surface.pixel_count:
        raise BadInput("the G-buffer has no foreground pixel: there is nothing to compare")
    shape, pixels = surface.gbuffer.shape, surface.pixel_count
    if observed.ndim == 3 and observed.shape[:2] == shape:
        observed = surface.from_image(observed)
    elif observed.ndim != 2 or observed.shape[1] != pixels:
        raise BadInput(
            f"the image has shape {observed.shape}: give [{shape[0]}, {shape[1]}, C], or the"
            f" foreground's planes [C, {pixels}]"
        )
    arguments = surface, scene, materials, observed
    error = error_of_lights(surface, scene, plain, _tolerance(tolerance))
    if isinstance(surface, Sharded) or error is not None or not are_at_hand(arguments):
        return _mean_squared_error(*arguments, None, plain, error)
    more = surface.in_bucket(), scene.in_bucket(), with_padded_maps(materials), pad(observed)
    return _mean_squared_error.outermost(*more, pixels, plain, None)


def _tolerance(value: ArrayLike | None) -> Float[Array, ""] | None:
    tolerance = optional(positive("tolerance"))(value)
    if tolerance is not None and tolerance.ndim:
        raise BadInput(f"tolerance has shape {tolerance.shape}: give one number")
    return tolerance


def _checked(
    gbuffer: GBuffer | KeptGeometry | Sharded, scene: Scene, material: Material | Sequence[Material]
) -> tuple[KeptGeometry | Sharded, Scene, Materials]:
    surface = KeptGeometry(gbuffer, None) if isinstance(gbuffer, GBuffer) else gbuffer
    check_lengths(surface.gbuffer)
    check_visible(scene.lights, surface.gbuffer.point_count)
    slot = surface.gbuffer.slot
    several = [material] if isinstance(material, Material) else list(material)
    if not several:
        raise BadInput("no materials are given: give one, or one a slot")
    if len(several) > 1:
        if slot is None:
            raise BadInput(
                f"{len(several)} materials for a surface that has one: give one material, or a mesh"
                " whose faces have slots"
            )
        check_slots(several, slot)
    else:
        check_maps(surface.gbuffer, several[0])
    own = surface.surface if isinstance(surface, Sharded) else surface
    if own.angles is not None:
        _check_kept(own, scene, several[0])
    return surface, scene, tuple(several)


def _check_kept(kept: KeptGeometry, scene: Scene, material: Material) -> None:
    asked = kinds(scene, material)
    if asked != kept.kinds:
        raise BadInput(
            f"the kept geometry is of {_listed(kept.kinds)}, and what is rendered has"
            f" {_listed(asked)}: keep it for this scene and material"
        )
    for seen, light in zip(kept.angles or (), scene.lights, strict=True):
        if (
            getattr(light, "attenuation", None) is not None
            and getattr(seen, "distance", None) is None
        ):
            raise BadInput(
                "the kept geometry has no distance to a light, which has an attenuation now: keep it"
                " for this scene"
            )


def _listed(kinds: tuple[str, ...]) -> str:
    return ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds)) or "no lights"


def _one_material(gbuffer: GBuffer, materials: Materials) -> Material:
    if len(materials) == 1:
        return materials[0]
    assert gbuffer.slot is not None
    one = by_slot(materials, gbuffer.slot)
    check_maps(gbuffer, one)
    return one


@partial(Led, static=(3,))
def _render(
    surface: KeptGeometry | Sharded,
    scene: Scene,
    materials: Materials,
    plain: bool,
    tolerance: Float[Array, ""] | None,
) -> Float[Array, "H W C"]:
    material = _one_material(surface.gbuffer, materials)
    return surface.gbuffer.to_image(image_planes(surface, scene, material, plain, tolerance))


@partial(Led, static=(4,))
def _rows(
    surface: KeptGeometry, scene: Scene, materials: Materials, count: Int[Array, ""], plain: bool
) -> Float[Array, "P C"]:
    material = _one_material(surface.gbuffer, materials)
    return image_rows(surface, scene, material, plain, count)


@partial(Led, static=(5,))
def _mean_squared_error(
    surface: KeptGeometry | Sharded,
    scene: Scene,
    materials: Materials,
    observed: Float[Array, "C P"],
    wanted: Int[Array, ""] | None,
    plain: bool,
    tolerance: Float[Array, ""] | None,
) -> Float[Array, ""]:
    material = _one_material(surface.gbuffer, materials)
    error = squared_error(surface, scene, material, observed, plain, tolerance, wanted)
    return error / (surface.foreground if wanted is None else wanted)
