"""The sum over any number of lights, at a compile time that does not grow with their number.

A few lights of a kind are written out one after the other, which XLA fuses into one pass over the
planes. Many of a kind become a scan over chunks of them, so that a thousand lights compile in the
time of eight.
"""

from collections.abc import Callable
from typing import TypeAlias

import jax
import jax.numpy as jnp

from diffshade.channels import Channels, plus
from diffshade.light.base import AbstractLight

__all__ = ["LightSums", "add", "sum_over_lights"]

LightSums: TypeAlias = tuple[Channels | None, tuple[Channels, ...]]
"""The diffuse sum, and one a lobe."""

CHUNK = 8


def sum_over_lights(
    term: Callable[[AbstractLight], LightSums], lights: tuple[AbstractLight, ...]
) -> LightSums:
    """sum of term(light) over one or more lights."""
    total: LightSums | None = None
    for group in _by_kind(lights):
        chunked = len(group) // CHUNK * CHUNK if len(group) >= 2 * CHUNK else 0
        if chunked:
            total = add(total, _scan(term, group[:chunked]))
        for light in group[chunked:]:
            total = add(total, term(light))
    assert total is not None
    return total


def _by_kind(lights: tuple[AbstractLight, ...]) -> list[list[AbstractLight]]:
    """Lights whose fields have the same structure, shapes and types, in order of appearance."""
    groups: dict[object, list[AbstractLight]] = {}
    for light in lights:
        leaves, structure = jax.tree.flatten(light)
        groups.setdefault((structure, *((x.shape, x.dtype) for x in leaves)), []).append(light)
    return list(groups.values())


def _scan(term: Callable[[AbstractLight], LightSums], lights: list[AbstractLight]) -> LightSums:
    chunks = jax.tree.map(
        lambda *leaves: jnp.stack(leaves).reshape(-1, CHUNK, *leaves[0].shape), *lights
    )

    def add_chunk(total: LightSums, chunk: AbstractLight) -> tuple[LightSums, None]:
        for k in range(CHUNK):
            total = add(total, term(jax.tree.map(lambda leaf: leaf[k], chunk)))  # noqa: B023
        return total, None

    start = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(term, lights[0]))
    return jax.lax.scan(add_chunk, start, chunks)[0]


def add(total: LightSums | None, term: LightSums) -> LightSums:
    if total is None:
        return term
    diffuse = None if total[0] is None or term[0] is None else plus(total[0], term[0])
    return diffuse, tuple(plus(a, b) for a, b in zip(total[1], term[1], strict=True))
