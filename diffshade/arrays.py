"""How numbers from outside become arrays: once, when an object is built.

A Python float that reached a compiled function as it is would be a new constant, or a new weak type,
at every call; converted here it is an argument like any other. What is already a JAX array, a tracer
included, passes through untouched, so that objects can be built inside `jit`, `grad` and `vmap`.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diffshade.errors import BadInput

__all__ = ["ArrayLike", "floats", "is_concrete", "optional", "vector"]

ArrayLike = float | Sequence[Any] | np.ndarray | Array


def floats(name: str) -> Callable[[ArrayLike], Float[Array, "..."]]:
    """A field converter: numbers, sequences and NumPy arrays to a float array; NaN is refused."""

    def convert(value: ArrayLike) -> Float[Array, "..."]:
        if isinstance(value, jax.Array):
            return value if jnp.issubdtype(value.dtype, jnp.floating) else value.astype(float)
        if _holds_tracers(value):
            return jnp.asarray(value)
        try:
            host = np.asarray(value)
            host = host if host.dtype in (np.float32, np.float64) else host.astype(np.float64)
        except (TypeError, ValueError):
            raise BadInput(f"{name} is {value!r}: give a number or a sequence of numbers") from None
        if not np.isfinite(host).all():
            raise BadInput(f"{name} is {_brief(host)}: every number must be finite")
        # An array keeps its precision as far as JAX's 64-bit mode allows; plain numbers have the
        # default one.
        dtype = host.dtype if isinstance(value, np.ndarray) else float
        return jnp.asarray(host, dtype=jax.dtypes.canonicalize_dtype(dtype))

    return convert


def vector(name: str) -> Callable[[ArrayLike], Float[Array, "3"]]:
    """A field converter for one point or direction, three numbers."""
    to_floats = floats(name)

    def convert(value: ArrayLike) -> Float[Array, "3"]:
        array = to_floats(value)
        if array.shape[-1:] != (3,):
            raise BadInput(f"{name} has shape {array.shape}: give three numbers, x, y and z")
        return array

    return convert


def optional(convert: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A field converter that lets None, an absent part, through."""
    return lambda value: None if value is None else convert(value)


def is_concrete(tree: object) -> bool:
    """Whether a tree holds values, not the tracers of an enclosing `jit`, `grad` or `vmap`."""
    return not any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))


def _holds_tracers(value: object) -> bool:
    return isinstance(value, (list, tuple)) and any(
        isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(value)
    )


def _brief(array: np.ndarray) -> str:
    return np.array2string(array, threshold=6, separator=", ").replace("\n", "")
