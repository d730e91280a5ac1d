"""How the fields of surfaces and cameras are converted, once, when an object is built."""

import operator
from collections.abc import Callable
from typing import Any, SupportsIndex

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from diffshade.arrays import ArrayLike, floats
from diffshade.errors import BadInput

__all__ = ["count", "indices", "number"]


def count(name: str) -> Callable[[SupportsIndex], int]:
    """A field converter for a whole number of at least 1."""

    def convert(value: SupportsIndex) -> int:
        try:
            whole = operator.index(value)
        except TypeError:
            whole = 0
        if whole < 1:
            raise BadInput(f"{name} is {value!r}: give a whole number of at least 1")
        return whole

    return convert


def number(name: str) -> Callable[[ArrayLike], Float[Array, ""]]:
    """A field converter for one finite number."""
    to_floats = floats(name)

    def convert(value: ArrayLike) -> Float[Array, ""]:
        array = to_floats(value)
        if array.ndim:
            raise BadInput(f"{name} has shape {array.shape}: give one number")
        return array

    return convert


def indices(name: str) -> Callable[[Any], Int[Array, "..."]]:
    """A field converter for whole numbers that count from 0."""

    def convert(value: Any) -> Int[Array, "..."]:
        if not isinstance(value, jax.Array):
            # A copy: JAX may share memory that its owner can still write to.
            value = np.array(value)
        if not jnp.issubdtype(value.dtype, jnp.integer):
            raise BadInput(f"{name} holds {value.dtype} numbers: give whole numbers")
        return jnp.asarray(value, dtype=jnp.int32)

    return convert
