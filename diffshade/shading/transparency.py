"""Images of transparent surfaces: layers that `geometry.layers` has sorted, composited back to front."""

from collections.abc import Sequence
from functools import partial
from itertools import accumulate
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from diffshade.arrays import ArrayLike, floats, optional
from diffshade.buckets import are_at_hand, joined
from diffshade.channels import per_channel
from diffshade.errors import BadInput
from diffshade.fusion import Led
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.visible import visible_of
from diffshade.reflectance.material import Material
from diffshade.reflectance.transparency import AbstractTransparency, Share
from diffshade.scene import Scene
from diffshade.shading.render import render

__all__ = ["render_layers"]

OfObject = AbstractTransparency | Sequence[AbstractTransparency | None] | None


def render_layers(
    layers: Sequence[Sequence[GBuffer]],
    scene: Scene,
    materials: Material | Sequence[Material | Sequence[Material]],
    transparencies: OfObject | Sequence[OfObject] = None,
    background: ArrayLike | None = None,
    *,
    plain: bool = False,
) -> Float[Array, "H W C"]:
    """The image of `ds.layers`, each in front of what is behind it: I = a I_front + b I_behind.

    `materials` are those of the objects in order, each as `render` takes it, one or a sequence over
    slots; of a single object one stands alone. So do `transparencies`: None is opaque. `background`,
    one number, [C], or an image [H, W, C], is what is seen behind the last surface; None is black.
    Each surface is lit as if nothing were around it: no shadows, no refraction.

    Where all is opaque only the nearest layer is in the program: that of `render`. Jittable, and every
    derivative is exact for every input, in forward and reverse mode. A surface whose k_t is 0 is seen
    as an opaque one is, at the cost of a transparent one. `plain` is that of `render`.

    Raises `BadInput` for numbers of objects, slots or channels that do not match, a background of another
    size, and as `render` does.

    >>> import diffshade as ds
    >>> glass, wall = ds.Sphere(), ds.Sphere((0, 0, -3), 2)
    >>> layers = ds.layers([glass, wall], ds.OrthographicCamera(8, 8, 2.4))
    >>> scene, matt = ds.Scene(lights=ds.ParallelLight((0, 0, 1))), ds.Material(kd=0.5)
    >>> render_layers(layers, scene, [matt, matt], [ds.InterpolatedTransparency(0.5), None]).shape
    (8, 8, 1)
    """
    objects = _check(layers)
    of_objects = [
        (of,) if isinstance(of, Material) else tuple(of)
        for of in _one_each("materials", materials, Material, objects)
    ]
    given = [None] * objects if transparencies is None else transparencies
    kinds = tuple(
        (of,) if of is None or isinstance(of, AbstractTransparency) else tuple(of)
        for of in _one_each("transparencies", given, AbstractTransparency, objects)
    )
    for slots, of_slots in zip(of_objects, kinds, strict=True):
        if len(of_slots) not in (1, len(slots)):
            raise BadInput(
                f"{len(of_slots)} transparencies for an object of {len(slots)} materials: give one,"
                " or one a material"
            )
    if all(kind is None for of_slots in kinds for kind in of_slots):
        layers = layers[:1]
    if (len(layers) > 1 or objects > 1) and visible_of(scene.lights):
        raise BadInput(
            "a light has the shadows on one G-buffer, and layers are of several: give it as it is"
            " without ds.shadowed"
        )
    stacks = [_stacked(parts) for parts in zip(*layers, strict=True)]
    images = tuple(
        render(stack, scene, slots, plain=plain)
        for stack, slots in zip(stacks, of_objects, strict=True)
    )
    behind = optional(floats("background"))(background)
    if len(layers) == objects == 1 and behind is None:
        return images[0]
    first = accumulate((len(of_slots) for of_slots in kinds), initial=1)
    numbers = tuple(
        _numbers(stack, number, len(of_slots) > 1)
        for stack, number, of_slots in zip(stacks, first, kinds, strict=False)
    )
    if behind is not None:
        behind = _image_behind(behind, layers[0][0].shape)
    return _composited(images, numbers, kinds, behind, len(layers))


def _check(layers: Sequence[Sequence[GBuffer]]) -> int:
    """How many objects the layers are of."""
    parts = [part for layer in layers for part in layer]
    if not parts or len({len(layer) for layer in layers}) > 1:
        raise BadInput("the layers have not one G-buffer an object each: give what ds.layers gives")
    if len({part.shape for part in parts}) > 1:
        raise BadInput("the layers are of different sizes: give those of one camera")
    return len(layers[0])


def _one_each(name: str, given: Any, alone: type[Any], objects: int) -> list[Any]:
    several = [given] if isinstance(given, alone) else list(given)
    if len(several) != objects:
        raise BadInput(
            f"{name} are given for {len(several)} objects of {objects}: give each its own"
        )
    return several


def _stacked(parts: Sequence[GBuffer]) -> GBuffer:
    """An object's part in every layer, as one of images that stand one below the other."""
    if len(parts) == 1:
        return parts[0]
    if any(part.spread is not None for part in parts):
        raise BadInput("a layer is shaded once a face or vertex: give one shaded once a pixel")
    pixels = parts[0].shape[0] * parts[0].shape[1]
    normal, position, slot = jax.tree.map(
        joined, *((part.normal, part.position, part.slot) for part in parts)
    )
    index = joined(*(_numbered(part, k * pixels) for k, part in enumerate(parts)))
    shape = (len(parts) * parts[0].shape[0], parts[0].shape[1])
    return GBuffer(shape, normal, parts[0].viewer, position, index, slot)


def _numbered(part: GBuffer, first: int) -> Int[Array, "P"]:
    """The numbers of a layer's pixels, from `first` on."""
    if part.index is None:
        return jax.device_put(np.arange(first, first + part.pixel_count, dtype=np.int32))
    return _plus(part.index, first)


def _plus(plane: Int[Array, "P"], number: int) -> Int[Array, "P"]:
    """A sum, on the host without a program for the plane's length."""
    if are_at_hand(plane):
        return jax.device_put(np.asarray(plane) + np.int32(number))
    return plane + jnp.int32(number)


def _numbers(stack: GBuffer, first: int, by_slot: bool) -> Int[Array, "R W 1"]:
    """Which transparency, counted from 1 over all objects, every pixel has; 0 where nothing is."""
    if not by_slot:
        return stack.to_image((jax.device_put(np.full(stack.pixel_count, first, np.int32)),))
    assert stack.slot is not None  # there are several materials, which `render` has checked
    return stack.to_image((_plus(stack.slot, first),))


def _image_behind(background: Float[Array, "..."], shape: tuple[int, int]) -> Float[Array, "..."]:
    """[1, 1, C] or [H, W, C]."""
    if background.ndim < 2:
        return background.reshape(1, 1, -1)
    if background.ndim != 3 or background.shape[:2] != shape:
        raise BadInput(
            f"the background has shape {background.shape}: give one number, one a channel, or an"
            f" image [{shape[0]}, {shape[1]}, C]"
        )
    return background


@partial(Led, static=(4,))
def _composited(
    images: tuple[Float[Array, "R W _"], ...],
    numbers: tuple[Int[Array, "R W 1"], ...],
    kinds: tuple[tuple[AbstractTransparency | None, ...], ...],
    background: Float[Array, "_ _ _"] | None,
    count: int,
) -> Float[Array, "H W C"]:
    """I = a I_front + b I_behind, from the farthest of `count` layers to the nearest."""
    shares = [_shares(kind, images[0].dtype) for of_slots in kinds for kind in of_slots]
    ends = images if background is None else (*images, background)
    sizes = {x.shape[-1] for x in ends} | {x.size for pair in shares for x in pair}
    channels = max(sizes)
    for size in sizes:
        per_channel((None,) * size, channels)  # raises where they do not match

    def by_number(nothing: int, those: Sequence[Share]) -> Float[Array, "N C"]:
        rows = [jnp.full((), nothing, those[0].dtype), *those]
        return jnp.stack([jnp.broadcast_to(x, (channels,)) for x in rows])

    height, width = images[0].shape[0] // count, images[0].shape[1]
    number = sum(numbers[1:], numbers[0]).reshape(count, height, width)
    # A pixel of a layer is of one object at most: the others' images are 0 there.
    front = sum(images[1:], images[0]).reshape(count, height, width, -1)
    own = by_number(0, [a for a, _ in shares])[number] * front
    through = by_number(1, [b for _, b in shares])[number]
    if background is None:
        behind, own, through = own[-1], own[:-1], through[:-1]
    else:
        behind = jnp.broadcast_to(background, own.shape[1:])

    def over(behind: Any, layer: Any) -> tuple[Any, None]:
        own, through = layer
        return own + through * behind, None

    return lax.scan(over, behind, (own, through), reverse=True)[0]


def _shares(kind: AbstractTransparency | None, dtype: np.dtype) -> tuple[Share, Share]:
    """a and b; of what is opaque, 1 and 0."""
    return (jnp.ones((), dtype), jnp.zeros((), dtype)) if kind is None else kind.shares()
