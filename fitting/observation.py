"""Photographs as data: what was observed, where, under which lights, with what weight.

Images that share a G-buffer and whose scenes have one structure form a group, stacked, so that a
capture of a hundred photographs compiles once. Pixels lie in blocks, so that memory beyond the data
does not grow with their number; each block is a comb over the whole surface, so that the first alone
is a fair sample of all.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Int, PyTree

from diffshade.arrays import is_concrete
from diffshade.geometry.gbuffer import GBuffer
from diffshade.scene import Scene
from fitting.devices import place

__all__ = ["Group", "View", "group_views", "in_precision"]

BLOCK = 4096
"""Pixels a block: more are no faster, and these stay in a processor's cache."""


@dataclass(frozen=True)
class View:
    """One photograph: linear radiance at the G-buffer's pixels, and a weight each (0: not used)."""

    gbuffer: GBuffer
    scene: Scene
    observed: Float[np.ndarray, "P C"] | Float[Array, "P C"]
    weight: Float[np.ndarray, "P"] | Float[Array, "P"]
    clipped: Bool[np.ndarray, "P C"] | None = None


class Group(eqx.Module):
    """K images of one structure, their pixels in B blocks of P, of which the first `count` are filled.

    B and P grow in steps, so that captures of many sizes share a few compiled programs. With a `mesh`
    the blocks are split over its devices, and inside a program that runs on each B is its part.
    """

    blocks: GBuffer  # every plane [B, P]
    scenes: Scene  # every leaf [K, ...]
    observed: Float[Array, "K B C P"]
    weight: Float[Array, "K B P"]
    count: Int[Array, ""]
    clipped: Bool[Array, "K B C P"] | None = None
    mesh: Mesh | None = eqx.field(static=True, default=None)

    def own(self, count: Int[Array, ""]) -> Int[Array, ""]:
        """How many of the first `count` blocks this device has; they are dealt out in turn."""
        if self.mesh is None:
            return count
        devices, (axis,) = self.mesh.size, self.mesh.axis_names
        return (count + devices - 1 - lax.axis_index(axis)) // devices

    def sample(self, size: int) -> "Group":
        """A fair sample of about `size` pixels: a comb of the first block."""
        step = self.weight.shape[2] // size
        if step < 2 or self.blocks.spread is not None:
            return self
        blocks = replace(
            self.blocks,
            shape=(1, -(-self.weight.shape[2] // step)),
            normal=jax.tree.map(lambda plane: plane[:1, ::step], self.blocks.normal),
            position=jax.tree.map(lambda plane: plane[:1, ::step], self.blocks.position),
            viewer=jax.tree.map(lambda leaf: leaf[:1], self.blocks.viewer),
        )
        observed, weight = self.observed[:, :1, :, ::step], self.weight[:, :1, ::step]
        clipped = None if self.clipped is None else self.clipped[:, :1, :, ::step]
        count = jnp.minimum(self.count, 1)
        return Group(blocks, self.scenes, observed, weight, count, clipped, self.mesh)


def group_views(
    views: Sequence[View], mesh: Mesh | None = None
) -> tuple[tuple[Group, ...], tuple[int, ...]]:
    """The views in groups, of the pixels that any view of a group uses; and which image is where."""
    together: dict[object, list[int]] = {}
    for k, view in enumerate(views):
        leaves, structure = jax.tree.flatten(view.scene)
        shapes = tuple((leaf.shape, leaf.dtype) for leaf in leaves)
        together.setdefault((id(view.gbuffer), structure, shapes), []).append(k)
    groups = tuple(_group([views[k] for k in members], mesh) for members in together.values())
    return groups, tuple(k for members in together.values() for k in members)


def _group(views: list[View], mesh: Mesh | None) -> Group:
    gbuffer = views[0].gbuffer
    dtype = gbuffer.normal.x.dtype
    if gbuffer.spread is not None:
        mesh = None  # one block, which every device has
    index, real, count = _comb(views, 1 if mesh is None else mesh.size)
    shape = index.shape
    # What is at hand is arranged by NumPy, which is faster; what is traced, by JAX.
    concrete = is_concrete(
        [(view.gbuffer, view.scene, view.observed, view.weight) for view in views]
    )
    xp: Any = np if concrete else jnp

    def planes(values: Any) -> Any:
        return xp.asarray(values, dtype)[index]

    def blocks(plane: Array) -> Any:
        host = xp.asarray(plane)
        return host[index] if gbuffer.spread is None else host[None]

    def channels_first(values: list[Any]) -> Any:
        return xp.moveaxis(xp.stack(values), 3, 2)

    observed = channels_first([planes(view.observed) for view in views])
    weight = xp.stack([planes(view.weight) * real.astype(dtype) for view in views])
    masks = [view.clipped for view in views]
    if any(mask is not None for mask in masks):
        none = np.zeros(views[0].observed.shape, bool)
        clipped = channels_first([(none if mask is None else mask)[index] for mask in masks])
    else:
        clipped = None
    viewers = jax.tree.map(lambda leaf: xp.stack([leaf] * shape[0]), gbuffer.viewer)
    scenes = jax.tree.map(lambda *leaves: xp.stack(leaves), *(view.scene for view in views))
    surface = jax.tree.map(blocks, (gbuffer.normal, gbuffer.position))
    # One precision throughout, that of the surface, whatever images and lights came in.
    parts = (*surface, *in_precision((viewers, scenes), dtype))
    parts = (*parts, observed, weight, clipped, np.int32(count))
    if mesh is None:
        parts = jax.device_put(parts) if concrete else jax.tree.map(jnp.asarray, parts)
    else:
        axes = (0, 0, 0, None, 1, 1, 1, None)
        parts = tuple(place(x, mesh, axis) for x, axis in zip(parts, axes, strict=True))
    normal, position, viewers, scenes, observed, weight, clipped, count = parts
    return Group(
        blocks=GBuffer(
            shape=(1, shape[1]),
            normal=normal,
            viewer=viewers,
            position=position,
            spread=jax.tree.map(lambda leaf: leaf[None], gbuffer.spread),
        ),
        scenes=scenes,
        observed=observed,
        weight=weight,
        count=count,
        clipped=clipped,
        mesh=mesh,
    )


def in_precision(tree: PyTree, dtype: np.dtype) -> PyTree:
    """The tree's floats as arrays of one type, NumPy's where they are not traced."""

    def converted(x: Any) -> Any:
        if not jnp.issubdtype(x.dtype, jnp.floating):
            return x
        return np.asarray(x, dtype) if is_concrete(x) else jnp.asarray(x, dtype)

    return jax.tree.map(converted, tree)


def _comb(
    views: list[View], devices: int
) -> tuple[Int[np.ndarray, "B P"], Bool[np.ndarray, "B P"], int]:
    """The pixels of each block, which of them are real and not filling, and how many blocks hold any.

    The blocks come in the order of the devices that they are dealt out to in turn.
    """
    gbuffer = views[0].gbuffer
    if gbuffer.spread is not None:
        # Intensities spread from faces or vertices, all of which are shaded: one block, whole.
        everything = np.arange(gbuffer.pixel_count)[None]
        return everything, np.ones(everything.shape, bool), 1
    if is_concrete([view.weight for view in views]):
        used = np.flatnonzero(np.any([np.asarray(view.weight) > 0 for view in views], axis=0))
    else:
        used = np.arange(gbuffer.pixel_count)
    count = max(1, -(-used.size // BLOCK))
    length = BLOCK if count > 1 else _stepped(used.size)
    order = np.arange(count * length).reshape(length, count).T
    each = -(-_stepped(count) // devices)
    filling = np.full((each * devices - count, length), used.size)
    order = np.concatenate([order, filling])
    order = order.reshape(each, devices, length).swapaxes(0, 1).reshape(-1, length)
    real = order < used.size
    return used[np.where(real, order, 0)], real, count


def _stepped(size: int) -> int:
    """The least of 1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 20, ... that is no less: four an octave."""
    step = 1 << max(0, (size - 1).bit_length() - 3)
    return -(-size // step) * step
