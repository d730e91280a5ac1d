"""The few lengths of arrays that programs are compiled for.

XLA compiles a program for one length, and takes longer to than the program runs: images whose count of
foreground pixels differs by one would each wait for a compiler. Arrays are therefore padded to the next
of a few lengths, and results cut back on the host, where a view needs no program.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

__all__ = ["bucket", "cut", "pad"]

SMALLEST = 64
"""Images with fewer pixels share one program."""


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


def pad(tree: Any, length: int) -> Any:
    """Arrays with their last value repeated up to a length: what is computed of it has no surprises."""

    def longer(array: Any) -> np.ndarray:
        values = np.asarray(array)
        padded = np.zeros(length, values.dtype)
        padded[: values.size] = values
        if values.size:
            padded[values.size :] = values[-1]
        return padded

    return jax.tree.map(longer, tree)


def cut(tree: Any, count: int) -> Any:
    """The first `count` values of arrays along their last axis, without a program for that count."""
    return jax.tree.map(lambda array: jnp.asarray(np.asarray(array)[..., :count]), tree)
