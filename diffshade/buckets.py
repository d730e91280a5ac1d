"""The few lengths of arrays that programs are compiled for.

XLA compiles a program for one length, and takes longer to than the program runs: images whose count of
foreground pixels differs by one would each wait for a compiler. Where a function is called outermost its
arrays are therefore padded to the next of a few lengths, and results cut back: on the host, in NumPy,
for an operation of JAX would be one more program for every length. So is `jnp.asarray` of an array of
NumPy's since JAX 0.12; `jax.device_put` is not. A CPU reads and hands out arrays where they lie, so that
nothing is copied but what is padded; elsewhere arrays would travel, and do not.
"""

import math
import weakref
from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from diffshade.arrays import is_outermost
from diffshade.fusion import is_led

__all__ = ["are_at_hand", "bucket", "cut", "joined", "pad", "room_for", "split"]

SMALLEST = 64
"""Images with fewer pixels share one program."""

BOUNDARY = 64
"""Bytes: XLA reads an array of NumPy's where it lies if it begins at a multiple of these."""


def bucket(count: int) -> int:
    """The least of 64, 80, 96, 112, 128, 160, ... that holds `count`: four lengths an octave.

    At most a quarter is in vain, an eighth on average, and from a thumbnail to 100 megapixels there are
    no more than 70 lengths.

    >>> [bucket(count) for count in (0, 64, 65, 113, 170132)]
    [64, 64, 80, 128, 196608]
    """
    if count <= SMALLEST:
        return SMALLEST
    step = 1 << ((count - 1).bit_length() - 3)
    return -(-count // step) * step


def pad(tree: Any) -> Any:
    """Arrays with what is last along their last axis repeated up to the bucket of its length.

    What is computed of it has no surprises. Numbers, and arrays that fill their bucket, stay as they are.
    """

    def longer(array: Any) -> Any:
        if not array.ndim:
            return array
        count = array.shape[-1]
        length = bucket(count)
        if length == count:
            return array
        if id(array) in _whole and _whole[id(array)][0].size == length:
            return _whole[id(array)][0]
        values = np.asarray(array)
        padded = room_for((*values.shape[:-1], length), values.dtype)
        padded[..., :count] = values
        padded[..., count:] = values[..., -1:] if count else 0
        return padded

    return jax.tree.map(longer, tree)


def cut(tree: Any, count: int) -> Any:
    """What is first along the last axis of arrays, without a program for that count; numbers as they are.

    On a CPU a part of a plane is a view, which costs nothing; `pad` finds the whole of it again.
    """
    wholes, structure = jax.tree.flatten(tree)
    parts = jax.device_put([np.asarray(x)[..., :count] if x.ndim else x for x in wholes])
    if is_led():
        for part, whole in zip(parts, wholes, strict=True):
            if whole.ndim == 1:
                _whole[id(part)] = whole, weakref.ref(part, partial(_forget, id(part)))
    return jax.tree.unflatten(structure, parts)


_whole: dict[int, tuple[Any, Any]] = {}
"""What a plane was cut from, by its identity and for as long as it lives."""


def _forget(part: int, _: Any) -> None:
    _whole.pop(part, None)


def joined(*planes: Any) -> Any:
    """Planes one after the other, on the host without a program for their lengths."""
    if are_at_hand(planes):
        return jax.device_put(np.concatenate(planes))
    return jnp.concatenate(planes)


def split(plane: Any, counts: Sequence[int]) -> list[Any]:
    """The other way round: planes of so many each."""
    ends = np.cumsum(counts)
    parts = zip(ends - np.asarray(counts), ends, strict=True)
    if are_at_hand(plane):
        host = np.asarray(plane)
        return jax.device_put([host[first:end] for first, end in parts])
    return [plane[first:end] for first, end in parts]


def room_for(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """`np.empty`, at a place from which XLA need not copy it."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    room = np.empty(size + BOUNDARY, np.uint8)
    first = -room.ctypes.data % BOUNDARY
    return room[first : first + size].view(dtype).reshape(shape)


def are_at_hand(tree: Any) -> bool:
    """Whether a tree holds values that the host can pad: on a CPU, outside of any program.

    What somebody has placed on devices of their choice stays there.
    """
    if not is_led() or not is_outermost():
        return False
    return not any(
        isinstance(x, jax.core.Tracer) or (isinstance(x, jax.Array) and x.committed)
        for x in jax.tree.leaves(tree)
    )
