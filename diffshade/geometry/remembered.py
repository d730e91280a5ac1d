"""Results that are remembered for as long as the arrays live that they were computed from.

JAX arrays do not change: the same array is the same geometry, and nothing needs to be compared.
"""

import weakref
from collections.abc import Callable, Hashable
from functools import wraps
from typing import Any, TypeVar

import jax
import numpy as np

__all__ = ["remembered"]

T = TypeVar("T")


def remembered(compute: Callable[..., T]) -> Callable[..., T]:
    """`compute`, of JAX arrays and hashable values, called once while all those arrays live.

    Arrays of NumPy's may change, and nothing that came from one is remembered. The result must not hold
    the arrays themselves, or neither it nor they would ever be freed.
    """
    known: dict[tuple[Hashable, ...], tuple[T, list[Any]]] = {}

    @wraps(compute)
    def result(*arguments: Any) -> T:
        if any(isinstance(x, np.ndarray) for x in arguments):
            return compute(*arguments)
        key = tuple(id(x) if isinstance(x, jax.Array) else x for x in arguments)
        if key not in known:

            def forget(_: Any) -> None:
                known.pop(key, None)

            arrays = [weakref.ref(x, forget) for x in arguments if isinstance(x, jax.Array)]
            known[key] = compute(*arguments), arrays
        return known[key][0]

    return result
