"""The sum over any number of lights, at a compile time that does not grow with their number.

A few lights of a kind are written out one after the other, which XLA fuses into one pass over the
planes. Many of a kind become arrays, field by field, and a scan over chunks of them, so that a thousand
lights compile in the time of a few. A GPU, for which every chunk is one more way through its memory,
has larger chunks.

Where it is known how bright each can be at the most, the dimmest are left out (`cull`). A value takes
as many turns as chunks are needed; a derivative, which JAX wants of a loop of known length, passes over
the others.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from diffshade.channels import Channels, plus
from diffshade.fusion import is_keeping, is_led
from diffshade.shading.cull import needed

__all__ = ["Dimmest", "LightSums", "Many", "add", "gathered", "sum_over_lights"]

LightSums: TypeAlias = tuple[Channels | None, tuple[Channels, ...]]
"""The diffuse sum, and one a lobe."""

Light: TypeAlias = Any
"""A light, with whatever is known of it: a tree of arrays."""

CHUNK = 4
CHUNK_OF_TILE = 8
CHUNK_ELSEWHERE = 32
TOGETHER = 32
"""So many arrays XLA stacks in one loop."""
AT_ONCE = 32
"""So many lights at the most have all that their derivative reads kept at once, for a page of pixels."""


class Many(eqx.Module):
    """Lights of one kind: the fields of all, [L, ...] each, as a tree like one of them."""

    fields: Light

    @property
    def count(self) -> int:
        """How many there are."""
        return jax.tree.leaves(self.fields)[0].shape[0]

    def split(self, size: int) -> tuple["Many", list[Light]]:
        """Those that fill whole chunks, and the few that are left, one by one."""
        whole = self.count // size * size
        left = [self.one(number) for number in range(whole, self.count)]
        return Many(self.one(slice(whole))), left

    def chunks(self, size: int) -> "Many":
        """[L / size, size, ...]: the lights in chunks, which they fill."""
        return Many(jax.tree.map(lambda leaf: leaf.reshape(-1, size, *leaf.shape[1:]), self.fields))

    def one(self, number: int | slice | Int[Array, "..."]) -> Light:
        """A light, a chunk, or several."""
        return jax.tree.map(lambda leaf: leaf[number], self.fields)

    def taken(self, numbers: Int[Array, "N"]) -> "Many":
        """Those of some numbers: the fields side by side, for gathering rows takes its time."""
        leaves, structure = jax.tree.flatten(self.fields)
        if len({leaf.dtype for leaf in leaves}) > 1:
            return Many(self.one(numbers))
        rows = jnp.concatenate([leaf.reshape(self.count, -1) for leaf in leaves], axis=1)[numbers]
        ends = np.cumsum([leaf[0].size for leaf in leaves])[:-1]
        parts = zip(jnp.split(rows, ends, axis=1), leaves, strict=True)
        fields = [part.reshape(-1, *leaf.shape[1:]) for part, leaf in parts]
        return Many(jax.tree.unflatten(structure, fields))


class Dimmest(NamedTuple):
    """What may be left out: lights that add up to no more than `tolerance`."""

    at_most: Callable[[Light], Float[Array, ""]]
    tolerance: Float[Array, ""]


def gathered(lights: Sequence[Light | Many]) -> tuple[Light | Many, ...]:
    """The same lights: those of which there are many of a kind as arrays, in order of appearance.

    Of a kind are lights whose fields have the same structure, shapes and types.
    """
    groups: dict[object, list[Light]] = {}
    for light in lights:
        leaves, structure = jax.tree.flatten(light)
        groups.setdefault((structure, *((x.shape, x.dtype) for x in leaves)), []).append(light)
    together: list[Light | Many] = []
    for group in groups.values():
        if len(group) >= 2 * _chunk_size():
            together.append(Many(jax.tree.map(lambda *leaves: _stack(leaves), *group)))
        else:
            together.extend(group)
    return tuple(together)


def sum_over_lights(
    term: Callable[[Sequence[Light]], LightSums],
    lights: Sequence[Light | Many],
    dimmest: Dimmest | None = None,
) -> LightSums:
    """The sum over one or more lights, where term(some) is the sum over a few."""
    total: LightSums | None = None
    size = _chunk_size()
    together = gathered(lights)
    few = [light for light in together if not isinstance(light, Many)]
    kinds = [light for light in together if isinstance(light, Many)]
    for many in kinds:
        whole, left = many.split(size if dimmest is None else CHUNK_OF_TILE)
        few += left
        if dimmest is None:
            total = add(total, _sum_of_all(term, whole, size))
        else:
            share = dimmest._replace(tolerance=dimmest.tolerance / len(kinds))
            total = add(total, _sum_of_needed(term, whole, CHUNK_OF_TILE, share))
    for first in range(0, len(few), size):
        total = add(total, term(few[first : first + size]))
    assert total is not None
    return total


def _sum_of_all(term: Callable[[Sequence[Light]], LightSums], many: Many, size: int) -> LightSums:
    """The sum over lights that fill whole chunks."""
    chunks, of_chunk, start = _in_chunks(term, many, size)

    def add_chunk(total: LightSums, chunk: Light) -> tuple[LightSums, None]:
        return add(total, of_chunk(chunk)), None

    return lax.scan(add_chunk, start, chunks.fields)[0]


def _sum_of_needed(
    term: Callable[[Sequence[Light]], LightSums], many: Many, size: int, dimmest: Dimmest
) -> LightSums:
    """The same without the dimmest."""
    most = jax.vmap(dimmest.at_most)(lax.stop_gradient(many.fields))
    numbers, count = needed(most, dimmest.tolerance)
    chunks, of_chunk, start = _in_chunks(term, many.taken(numbers), size)
    turns = -(-count // size)

    def add_chunk(total: LightSums, number: Int[Array, ""]) -> LightSums:
        return add(total, of_chunk(chunks.one(number)))

    def add_if_needed(total: LightSums, number: Int[Array, ""]) -> tuple[LightSums, None]:
        return lax.cond(number < turns, add_chunk, lambda total, _: total, total, number), None

    if is_keeping():
        return lax.scan(add_if_needed, start, jnp.arange(chunks.count, dtype=turns.dtype))[0]
    return lax.fori_loop(0, turns, lambda number, total: add_chunk(total, number), start)


def _in_chunks(
    term: Callable[[Sequence[Light]], LightSums], many: Many, size: int
) -> tuple[Many, Callable[[Light], LightSums], LightSums]:
    """The chunks, the sum over one, and a sum over none."""

    def of_chunk(chunk: Light) -> LightSums:
        return term([Many(chunk).one(number) for number in range(size)])

    chunks = many.chunks(size)
    shapes = jax.eval_shape(lambda: of_chunk(chunks.one(0)))
    start = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)
    if is_keeping() and many.count <= AT_ONCE:
        return chunks, of_chunk, start
    # A derivative computes a chunk's terms again, rather than keep those of all lights.
    return chunks, jax.checkpoint(of_chunk), start


def add(total: LightSums | None, term: LightSums) -> LightSums:
    """The sum of two sums."""
    if total is None:
        return term
    diffuse = None if total[0] is None or term[0] is None else plus(total[0], term[0])
    return diffuse, tuple(plus(a, b) for a, b in zip(total[1], term[1], strict=True))


def _chunk_size() -> int:
    return CHUNK if is_led() else CHUNK_ELSEWHERE


def _stack(leaves: Sequence[Array]) -> Float[Array, "L ..."]:
    """Arrays as one, part by part: XLA takes minutes over a thousand arrays that it fuses."""
    if len(leaves) <= TOGETHER:
        return jnp.stack(leaves)
    firsts = range(0, len(leaves), TOGETHER)
    parts = [jnp.stack(leaves[first : first + TOGETHER]) for first in firsts]
    return jnp.concatenate(lax.optimization_barrier(parts))
