"""The arrays of annotations where both kinds come: JAX's on devices, NumPy's on the host."""

from typing import TYPE_CHECKING, Any

import jax
import numpy as np

__all__ = ["Array"]

if TYPE_CHECKING:
    Array = Any  # what both can do is no protocol that a type checker knows
else:
    Array = jax.Array | np.ndarray | np.generic
