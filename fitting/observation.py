"""Photographs as data: what was observed, where, under which lights, with what weight.

Images that share a G-buffer and whose scenes have one structure form a group, stacked, so that a
capture of a hundred photographs compiles once. Pixels lie in blocks, so that memory beyond the data
does not grow with their number; each block is a comb over the whole surface, so that the first alone
is a fair sample of all.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diffshade.geometry.gbuffer import GBuffer
from diffshade.scene import Scene

__all__ = ["Group", "View", "group_views"]

BLOCK = 4096
"""Pixels a block: enough to be fast, few enough for a grid search on one."""


@dataclass(frozen=True)
class View:
    """One photograph: linear radiance at the G-buffer's pixels, and a weight each (0: not used)."""

    gbuffer: GBuffer
    scene: Scene
    observed: Float[np.ndarray, "C P"]
    weight: Float[np.ndarray, "P"]


class Group(eqx.Module):
    """K images of one structure, their pixels in B blocks of P."""

    blocks: GBuffer  # every plane [B, P]
    scenes: Scene  # every leaf [K, ...]
    observed: Float[Array, "K B C P"]
    weight: Float[Array, "K B P"]


def group_views(views: Sequence[View]) -> tuple[Group, ...]:
    """The views in groups, of the pixels that any view of a group uses."""
    together: dict[object, list[View]] = {}
    for view in views:
        leaves, structure = jax.tree.flatten(view.scene)
        shapes = tuple((leaf.shape, leaf.dtype) for leaf in leaves)
        together.setdefault((id(view.gbuffer), structure, shapes), []).append(view)
    return tuple(_group(members) for members in together.values())


def _group(views: list[View]) -> Group:
    gbuffer = views[0].gbuffer
    index, real, count = _comb(views)
    dtype = gbuffer.normal.x.dtype

    def planes(values: np.ndarray) -> np.ndarray:
        return values[..., index].reshape(*values.shape[:-1], count, -1)

    observed = np.stack([planes(view.observed) for view in views])
    weight = np.stack([planes(view.weight) * real.reshape(count, -1) for view in views])
    return Group(
        blocks=_in_blocks(gbuffer, index, count),
        scenes=jax.tree.map(lambda *leaves: np.stack(leaves), *(view.scene for view in views)),
        observed=jnp.asarray(np.moveaxis(observed, 2, 1), dtype),
        weight=jnp.asarray(weight, dtype),
    )


def _comb(views: list[View]) -> tuple[np.ndarray, np.ndarray, int]:
    """The pixels block after block, which of them are real and not filling, and how many blocks."""
    gbuffer = views[0].gbuffer
    if gbuffer.spread is not None:
        # Intensities spread from faces or vertices, all of which are shaded: one block, whole.
        everything = np.arange(gbuffer.pixel_count)
        return everything, np.ones(everything.size, bool), 1
    used = np.flatnonzero(np.any([view.weight > 0 for view in views], axis=0))
    count = max(1, -(-used.size // BLOCK))
    length = max(1, -(-used.size // count))
    padded = np.concatenate([used, np.zeros(count * length - used.size, used.dtype)])
    real = np.arange(padded.size) < used.size
    order = np.arange(padded.size).reshape(length, count).T.ravel()
    return padded[order], real[order], count


def _in_blocks(gbuffer: GBuffer, index: np.ndarray, count: int) -> GBuffer:
    whole = gbuffer.spread is not None

    def blocks(plane: Array) -> np.ndarray:
        host = np.asarray(plane)
        return host[None] if whole else host[index].reshape(count, -1)

    return GBuffer(
        shape=(1, index.size // count),
        normal=jax.tree.map(blocks, gbuffer.normal),
        viewer=jax.tree.map(lambda leaf: np.stack([leaf] * count), gbuffer.viewer),
        position=jax.tree.map(blocks, gbuffer.position),
        spread=jax.tree.map(lambda leaf: leaf[None], gbuffer.spread),
    )
