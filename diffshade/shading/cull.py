"""Which lights a tile of pixels can do without, and how large the error is at the most.

A tile asks of every light how bright it can be at the most on any of its pixels (`at_most`): from where
it stands, where the normals point, and how near the light is, by the equation itself at the largest
cosines. Lights that face no pixel or do not reach one are at 0; a coefficient or an intensity of 0 alone
does not put them there, for its derivative needs them. The least bright of all are left out while what
they can add up to is no more than the tolerance, which therefore bounds the error of the sum.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from diffshade.bounds import Ball, Cone, largest_cosine
from diffshade.fusion import stored
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.base import AbstractLight, AbstractRayLight
from diffshade.reflectance.material import Material

__all__ = ["TILE", "Tile", "at_most", "largest", "needed", "tile_by_tile", "tile_of"]

TILE = 32
"""Pixels on a side of a tile."""

Number = Float[Array, ""]


class Tile(NamedTuple):
    """Where a tile's points are, where their normals point, and where the viewer is."""

    ball: Ball | None
    n: Cone
    v: Cone | None


def tile_of(gbuffer: GBuffer, material: Material) -> Tile:
    """All that is asked of a tile's pixels; where the viewer is only for the sake of lobes."""
    ball = None if gbuffer.position is None else Ball.around(gbuffer.position)
    v = gbuffer.viewer.over(ball) if material.specular else None
    return Tile(ball, Cone.around(gbuffer.normal), v)


def at_most(tile: Tile, light: AbstractLight, material: Material) -> Number:
    """The largest radiance that a light adds to a channel of any pixel: infinite if not known."""
    dtype = tile.n.cosine.dtype
    unknown = jnp.asarray(jnp.inf, dtype)
    incoming = light.over(tile.ball) if isinstance(light, AbstractRayLight) else None
    if incoming is None:
        return unknown
    assert isinstance(light, AbstractRayLight)
    cosine = largest_cosine(tile.n, incoming.l)
    reflected = largest(material.kd, material.od) * cosine
    for lobe in material.specular:
        assert tile.v is not None
        shape = lobe.most(tile.n, incoming.l, tile.v)
        reflected += largest(lobe.ks, material.os) * (unknown if shape is None else shape)
    arriving = jnp.abs(light.intensity)
    dark = cosine <= 0
    f = light.falloff(incoming.nearest)
    if f is not None:
        smallest = float(jnp.finfo(dtype).tiny)
        f = jnp.where(incoming.nearest <= smallest**0.5, unknown, f)  # there laws are guarded
        dark |= f == 0
        arriving *= jnp.abs(f)
    most = (arriving * reflected).max().astype(dtype)
    return jnp.where(dark, 0, jnp.where(most == 0, float(jnp.finfo(dtype).tiny), most))


def needed(most: Float[Array, "L"], tolerance: Number) -> tuple[Int[Array, "L"], Int[Array, ""]]:
    """The numbers of the lights, those that are needed first, and how many these are.

    All below a threshold are left out: the largest of a few, a factor of sqrt(2) apart, below which
    lights add up to no more than the tolerance. Of L lights those below tolerance / L always do.
    """
    most = stored(lambda most: jnp.where(jnp.isnan(most), jnp.inf, most), most)
    count = most.size
    steps = np.arange(2 * np.ceil(np.log2(count)) + 1)
    thresholds = tolerance * jnp.asarray(2.0 ** (-steps / 2), most.dtype)
    left = jnp.where(most[None] <= thresholds[:, None], most[None], 0).sum(1)
    is_needed = most > jnp.where(left <= tolerance, thresholds, 0).max()
    up_to = jnp.cumsum(is_needed, dtype=np.int32)
    own = jnp.arange(count, dtype=np.int32)
    place = jnp.where(is_needed, up_to - 1, up_to[-1] + own - up_to)
    return jnp.zeros_like(own).at[place].set(own, unique_indices=True), up_to[-1]


def tile_by_tile(gbuffer: GBuffer) -> Int[Array, "P"]:
    """An order of the foreground in which pixels of a tile, and neighbouring tiles, follow each other."""
    height, width = gbuffer.shape
    count = gbuffer.pixel_count
    numbers = jnp.arange(count, dtype=np.int32)
    image = numbers
    if gbuffer.index is not None:
        image = jnp.full(height * width, -1, np.int32).at[gbuffer.index].set(numbers)
    down, across = -(-height // TILE), -(-width // TILE)
    margins = ((0, down * TILE - height), (0, across * TILE - width))
    image = jnp.pad(image.reshape(height, width), margins, constant_values=-1)
    tiles = image.reshape(down, TILE, across, TILE).swapaxes(1, 2)
    there_and_back = jnp.where(np.arange(down)[:, None, None, None] % 2, tiles[:, ::-1], tiles)
    inside = there_and_back.reshape(-1)
    place = jnp.where(inside < 0, count, jnp.cumsum(inside >= 0) - 1)
    return numbers.at[place].set(inside, mode="drop")


def largest(coefficient: Array | None, colour: Array | None) -> Float[Array, "..."]:
    """The largest |k O| in each channel, over all pixels; 0 for an absent term."""
    if coefficient is None:
        return jnp.zeros(())
    k = _over_pixels(coefficient)
    return k if colour is None else k * _over_pixels(colour)


def _over_pixels(coefficient: Array) -> Float[Array, "..."]:
    return jnp.abs(coefficient) if coefficient.ndim < 2 else jnp.abs(coefficient).max(-1)
