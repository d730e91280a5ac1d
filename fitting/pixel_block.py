"""A block of pixels under all lights, fitted chunk by chunk.

A block is what is on the device at one time; a chunk is what a processor's cache holds. Directions,
attenuation and basis are computed within a chunk, so that nothing of the size of all images is. A loop
over chunks runs on one processor: each has a share of them, in a thread of its own.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from diffshade.channels import Channels, channels, per_channel, times
from diffshade.errors import BadInput
from diffshade.fusion import compiler_options, processors
from diffshade.geometry.viewer import AbstractViewer
from diffshade.light.base import AbstractLight, AbstractRayLight
from diffshade.light.environment import EnvironmentLight
from diffshade.reflectance.lambert import lambert
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from diffshade.shading.one_light import strength
from diffshade.shading.prefiltered import prefiltered
from diffshade.vector import Vec3, dot
from fitting.pixel import PixelFit, PixelProblem, Settings, fit_pixels

__all__ = ["Block", "Lamps", "fit_block", "lamps"]


class Lamps(eqx.Module):
    """The lights of K images: each slot holds one light of every image, its leaves [K, ...].

    An image with fewer lights than another has dark ones. `ambient` is I_a, [K] or [K, C].
    """

    slots: tuple[AbstractLight, ...]
    ambient: Float[Array, "K *C"] | Float[np.ndarray, "K *C"] | None


class Block(NamedTuple):
    """Pixels in n chunks: their surface, what K images show there, and which of it is used (1 or 0)."""

    normal: Vec3
    position: Vec3 | None
    observed: Float[Array, "n C K P"] | Float[np.ndarray, "n C K P"]
    weight: Float[Array, "n K P"] | Float[np.ndarray, "n K P"]


def lamps(scenes: Sequence[Scene]) -> Lamps:
    """The lights of all images, aligned: each slot is of one kind of light."""
    kinds: dict[object, list[list[AbstractLight]]] = {}
    for k, scene in enumerate(scenes):
        for light in scene.lights:
            if light.visible is not None:
                raise BadInput(
                    "a light has a plane of what is visible of it, which a fit of every pixel does not"
                    " take: leave shadowed pixels out by `valid`"
                )
            leaves, structure = jax.tree.flatten(light)
            kind = structure, *((np.shape(x), x.dtype) for x in leaves)
            kinds.setdefault(kind, [[] for _ in scenes])[k].append(light)
    slots: list[AbstractLight] = []
    for images in kinds.values():
        some = next(light for image in images for light in image)
        dark = eqx.tree_at(lambda x: x.intensity, some, jnp.zeros_like(some.intensity))
        for j in range(max(len(image) for image in images)):
            row = [image[j] if j < len(image) else dark for image in images]
            slots.append(jax.tree.map(lambda *leaves: np.stack(leaves), *row))
    if not slots:
        raise BadInput("no scene has a light: nothing tells kd, ks and the shininess of a pixel")
    return Lamps(tuple(slots), _ambient(scenes))


def _ambient(scenes: Sequence[Scene]) -> np.ndarray | None:
    if all(scene.ambient is None for scene in scenes):
        return None
    each = [np.zeros(()) if s.ambient is None else np.asarray(s.ambient) for s in scenes]
    if len({len(a) for a in each if a.ndim}) > 1:
        raise BadInput("the ambient intensities have different numbers of channels: give the same")
    return np.stack(np.broadcast_arrays(*each))


def fit_block(
    block: Block, lamps: Lamps, viewer: AbstractViewer, material: Material, settings: Settings
) -> Callable[[], PixelFit]:
    """Begin the fits of a block's pixels; what is returned waits for them, [n, ..., P].

    One program serves all blocks of a size.
    """
    pool, workers = _workers()
    count = len(block.weight)
    length = -(-count // workers)
    double = jax.config.jax_enable_x64  # type: ignore[attr-defined]  # of this thread alone, maybe

    def fit_share(first: int) -> PixelFit:
        def mine(planes: np.ndarray) -> np.ndarray:
            own = planes[first : first + length]
            # The last may be short, and is filled up with its own chunks.
            return own if len(own) == length else np.resize(own, (length, *own.shape[1:]))

        share = jax.tree.map(mine, block)
        with jax.enable_x64(double):
            return jax.device_get(_program()(share, lamps, viewer, material, settings))

    running = [pool.submit(fit_share, first) for first in range(0, count, length)]

    def wait() -> PixelFit:
        found = [future.result() for future in running]
        return jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *found)

    return wait


@cache
def _workers() -> tuple[ThreadPoolExecutor, int]:
    """A thread for each processor; one where another device does the work."""
    count = processors() if jax.default_backend() == "cpu" else 1
    return ThreadPoolExecutor(count, thread_name_prefix="fit_maps"), count


@cache
def _program() -> Any:
    return jax.jit(_fit_chunks, static_argnums=4, compiler_options=compiler_options())


def _fit_chunks(
    block: Block, lamps: Lamps, viewer: AbstractViewer, material: Material, settings: Settings
) -> PixelFit:
    def fit_chunk(chunk: Block) -> PixelFit:
        return fit_pixels(_problem(chunk, lamps, viewer, material), settings)

    return lax.map(fit_chunk, block)


def _problem(
    chunk: Block, lamps: Lamps, viewer: AbstractViewer, material: Material
) -> PixelProblem:
    """What each pixel of a chunk receives from every light, and shows in every image."""
    n, position, weight = chunk.normal, chunk.position, chunk.weight
    v = viewer.direction(position)
    (lobe,) = material.specular
    diffuse: list[Channels] = []
    specular: list[Channels] = []
    angles = []
    bands: list[tuple[Channels, ...]] = []
    for slot in lamps.slots:
        if isinstance(slot, EnvironmentLight):
            around = jax.vmap(lambda light: prefiltered(light, n, v))(slot)
            arriving = tuple(i[:, None] * weight for i in _by_channel(slot.intensity))
            diffuse.append(_coloured(times(arriving, around.irradiance), material.od))
            bands.append(
                tuple(_coloured(times(arriving, band), material.os) for band in around.bands)
            )
            continue
        assert isinstance(slot, AbstractRayLight)

        def arrives(light: AbstractRayLight) -> tuple[Array, Array, Array | None]:
            l, distance, emission = light.incidence(position)
            n_dot_l = dot(n, l)
            f = strength(light, distance, emission)
            return lambert(n_dot_l), lobe.angles(n, l, v, n_dot_l), f

        cosine, angle, f = jax.vmap(arrives)(slot)
        used = weight if f is None else weight * f
        arriving = tuple(i[:, None] * used for i in _by_channel(slot.intensity))
        angles.append(angle)
        diffuse.append(_coloured(times(arriving, (cosine,)), material.od))
        specular.append(_coloured(arriving, material.os))
    plain = []
    if material.ka is not None:
        dark = (jnp.zeros(len(weight), weight.dtype),)
        ambient = dark if lamps.ambient is None else _by_channel(lamps.ambient)
        plain.append(_coloured(tuple(i[:, None] * weight for i in ambient), material.od))
    if material.kd is not None:
        count = max(len(term) for term in diffuse)
        plain.append(tuple(sum(p[1:], p[0]) for p in _by_plane(diffuse, count)))
    count = max(len(term) for term in (*plain, *specular, *(x for own in bands for x in own)))
    channel_count = len(chunk.observed)
    if count not in (1, channel_count):
        raise BadInput(
            f"the images have {channel_count} channels, and lights, ambient light or object colours"
            f" {count}: give one number for all channels, or one a channel"
        )
    return PixelProblem(
        lobe=lobe,
        observed=tuple(chunk.observed),
        plain=_by_plane(plain, count) or ((),) * count,
        arriving=_by_plane(specular, count) or ((),) * count,
        angles=tuple(angles),
        environments=tuple(
            tuple(zip(*(per_channel(band, count) for band in degrees), strict=True))
            for degrees in bands
        ),
    )


def _by_channel(of_images: Any) -> Channels:
    """[K] for all channels, or one [K] a channel."""
    return (of_images,) if of_images.ndim == 1 else tuple(of_images.T)


def _coloured(term: Channels, colour: Float[Array, "..."] | None) -> Channels:
    return term if colour is None else times(channels(colour), term)


def _by_plane(terms: Sequence[Channels], count: int) -> tuple[Channels, ...]:
    """From terms of channels to channels of terms."""
    return tuple(zip(*(per_channel(term, count) for term in terms), strict=True))
