"""Sums over all pixels, block after block: memory does not grow with their number."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from diffshade.geometry.gbuffer import GBuffer
from diffshade.scene import Scene
from fitting.observation import Group

__all__ = ["Block", "sum_over_blocks"]

T = TypeVar("T")


class Block(NamedTuple):
    """Some pixels of one image: surface, light, what was observed, and a weight each (0: not used)."""

    gbuffer: GBuffer
    scene: Scene
    observed: Float[Array, "C P"]
    weight: Float[Array, "P"]
    clipped: Bool[Array, "C P"] | None


def sum_over_blocks(
    group: Group,
    of_block: Callable[[Block, Float[Array, ""] | None], T],
    most_blocks: Int[Array, ""],
    gains: Float[Array, "K"] | None = None,
) -> T:
    """The sums of `of_block(block, gain)` over the blocks of each image: every leaf [K, ...].

    How many blocks are visited is a value, not a shape: few and all run in one program. Blocks that
    lie on several devices are summed by each of these, and the sums added up.
    """
    visited = group.own(jnp.minimum(group.count, most_blocks))

    def of_image(_: None, image: tuple[Any, ...]) -> tuple[None, T]:
        scene, observed, weight, clipped, gain = image

        def at(b: Int[Array, ""] | int) -> T:
            planes = (group.blocks, observed, weight, clipped)
            surface, y, w, limits = jax.tree.map(lambda plane: plane[b], planes)
            return of_block(Block(surface, scene, y, w, limits), gain)

        nothing = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(lambda: at(0)))
        if group.mesh is not None:
            nothing = lax.pcast(nothing, group.mesh.axis_names, to="varying")

        def add_block(b: Array, total: T) -> T:
            return jax.tree.map(jnp.add, total, at(b))

        return None, lax.fori_loop(0, visited, add_block, nothing)

    images = (group.scenes, group.observed, group.weight, group.clipped, gains)
    sums = lax.scan(of_image, None, images)[1]
    if group.mesh is None:
        return sums
    devices = group.mesh.axis_names
    return jax.tree.map(lambda own: lax.psum(own, devices).astype(own.dtype), sums)
