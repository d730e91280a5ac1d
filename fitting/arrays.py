"""The arrays of annotations where both kinds come: JAX's on devices, NumPy's on the host."""

import jax
import numpy as np

__all__ = ["Array"]

Array = jax.Array | np.ndarray | np.generic
