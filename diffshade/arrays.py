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
from jax import lax
from jaxtyping import Array, Float

from diffshade.errors import BadInput

__all__ = [
    "ArrayLike",
    "coefficients",
    "floats",
    "is_concrete",
    "is_outermost",
    "optional",
    "positive",
    "vector",
]

ArrayLike = float | int | np.generic | Sequence[Any] | np.ndarray | Array


def floats(name: str) -> Callable[[ArrayLike], Float[Array, "..."]]:
    """A field converter: numbers, sequences and NumPy arrays to a float array; NaN is refused."""

    def convert(value: ArrayLike) -> Float[Array, "..."]:
        if isinstance(value, jax.Array):
            return value if jnp.issubdtype(value.dtype, jnp.floating) else value.astype(float)
        if _holds_tracers(value):
            return jnp.asarray(value, float)
        try:
            host = np.asarray(value)
            if host.dtype.kind not in "biuf":
                raise TypeError
            host = host if host.dtype in (np.float32, np.float64) else host.astype(np.float64)
        except (TypeError, ValueError):
            raise BadInput(f"{name} is {value!r}: give a number or a sequence of numbers") from None
        # An array keeps its precision as far as JAX's 64-bit mode allows; plain numbers have the
        # default one.
        dtype = jax.dtypes.canonicalize_dtype(
            host.dtype if isinstance(value, np.ndarray) else float
        )
        with np.errstate(over="ignore"):
            rounded = host.astype(dtype)
        if not np.isfinite(rounded).all():
            raise BadInput(f"{name} is {_brief(host)}: every number must be finite, in {dtype} too")
        with jax.ensure_compile_time_eval():  # a value inside jit too, not a tracer
            return jax.device_put(rounded)

    return convert


def coefficients(name: str) -> Callable[[ArrayLike], Float[Array, "..."]]:
    """A field converter for a coefficient: one number, one a channel [C], or maps [C or 1, P]."""
    to_floats = floats(name)

    def convert(value: ArrayLike) -> Float[Array, "..."]:
        array = to_floats(value)
        if array.ndim > 2:
            raise BadInput(
                f"{name} has shape {array.shape}: give one number, one a channel [C], or maps over"
                " the foreground's pixels [C or 1, P]"
            )
        return array

    return convert


def positive(name: str) -> Callable[[ArrayLike], Float[Array, "..."]]:
    """A field converter for a coefficient that is not negative."""
    to_coefficients = coefficients(name)

    def convert(value: ArrayLike) -> Float[Array, "..."]:
        array = to_coefficients(value)
        if (
            not isinstance(value, jax.Array)
            and is_concrete(array)
            and np.any(np.asarray(array) < 0)
        ):
            raise BadInput(f"{name} is {_brief(np.asarray(array))}: it cannot be negative")
        return array

    return convert


def vector(name: str) -> Callable[[ArrayLike], Float[Array, "3"]]:
    """A field converter for one point or direction, three numbers."""
    to_floats = floats(name)

    def convert(value: ArrayLike) -> Float[Array, "3"]:
        array = to_floats(value)
        if array.shape != (3,):
            raise BadInput(f"{name} has shape {array.shape}: give three numbers, x, y and z")
        return array

    return convert


def optional(convert: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A field converter that lets None, an absent part, through."""
    return lambda value: None if value is None else convert(value)


def is_concrete(tree: object) -> bool:
    """Whether a tree holds values, not the tracers of an enclosing `jit`, `grad` or `vmap`."""
    return not any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))


def is_outermost() -> bool:
    """Whether no enclosing `jit` or `scan` traces what is computed now."""
    return not isinstance(lax.neg(0.0), jax.core.Tracer)  # the cheapest operation there is


def _holds_tracers(value: object) -> bool:
    return isinstance(value, (list, tuple)) and any(
        isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(value)
    )


def _brief(array: np.ndarray) -> str:
    return np.array2string(array, threshold=6, separator=", ").replace("\n", "")
