"""Systems of colour that are linear in one another."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

__all__ = ["transformed"]


def transformed(colours: Float[Array, "... 3"], matrix: np.ndarray) -> Float[Array, "... 3"]:
    """M (a, b, c) of every colour (a, b, c), in its precision."""
    return jnp.einsum("ij,...j->...i", jnp.asarray(matrix, colours.dtype), colours)
