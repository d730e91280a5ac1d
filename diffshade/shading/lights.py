"""The sum over any number of lights, at a compile time that does not grow with their number.

A few lights of a kind are written out one after the other, which XLA fuses into one pass over the
planes. Many of a kind become a scan over chunks of them, so that a thousand lights compile in the
time of a few. A GPU, for which every chunk is one more way through its memory, has larger ones.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias, TypeVar

import jax
import jax.numpy as jnp

from diffshade.channels import Channels, plus
from diffshade.fusion import is_led

__all__ = ["LightSums", "add", "sum_over_lights"]

LightSums: TypeAlias = tuple[Channels | None, tuple[Channels, ...]]
"""The diffuse sum, and one a lobe."""

CHUNK = 4
CHUNK_ELSEWHERE = 32

Light = TypeVar("Light")
"""A light, with whatever is known of it: a tree of arrays."""


def sum_over_lights(
    term: Callable[[Sequence[Light]], LightSums], lights: tuple[Light, ...]
) -> LightSums:
    """The sum over one or more lights, where term(some) is the sum over a few of one kind."""
    total: LightSums | None = None
    size = CHUNK if is_led() else CHUNK_ELSEWHERE
    for group in _by_kind(lights):
        chunked = len(group) // size * size if len(group) >= 2 * size else 0
        if chunked:
            total = add(total, _scan(term, group[:chunked], size))
        for first in range(chunked, len(group), size):
            total = add(total, term(group[first : first + size]))
    assert total is not None
    return total


def _by_kind(lights: tuple[Light, ...]) -> list[list[Light]]:
    """Lights whose fields have the same structure, shapes and types, in order of appearance."""
    groups: dict[object, list[Light]] = {}
    for light in lights:
        leaves, structure = jax.tree.flatten(light)
        groups.setdefault((structure, *((x.shape, x.dtype) for x in leaves)), []).append(light)
    return list(groups.values())


def _scan(
    term: Callable[[Sequence[Light]], LightSums], lights: list[Light], size: int
) -> LightSums:
    chunks = jax.tree.map(
        lambda *leaves: jnp.stack(leaves).reshape(-1, size, *leaves[0].shape), *lights
    )

    # A derivative computes a chunk's terms again, rather than keep those of all lights.
    @jax.checkpoint
    def of_chunk(chunk: Light) -> LightSums:
        return term([jax.tree.map(lambda leaf: leaf[k], chunk) for k in range(size)])  # noqa: B023

    def add_chunk(total: LightSums, chunk: Light) -> tuple[LightSums, None]:
        return add(total, of_chunk(chunk)), None

    shapes = jax.eval_shape(lambda: term(lights[:size]))
    start = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)
    return jax.lax.scan(add_chunk, start, chunks)[0]


def add(total: LightSums | None, term: LightSums) -> LightSums:
    if total is None:
        return term
    diffuse = None if total[0] is None or term[0] is None else plus(total[0], term[0])
    return diffuse, tuple(plus(a, b) for a, b in zip(total[1], term[1], strict=True))
