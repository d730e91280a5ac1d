"""What a search gives, apart from the search itself, which alone needs Optimistix.

Importing that takes longer than all else that a fit imports but JAX, and a search that was traced by an
earlier process (`diffshade.kept`) does without it.
"""

from typing import TYPE_CHECKING, Any

import equinox as eqx
from jaxtyping import Bool, Float, Int

from fitting.arrays import Array

if TYPE_CHECKING:
    from optimistix import AbstractLeastSquaresSolver as Solver
else:
    Solver = Any

__all__ = ["APART", "Basins", "Box", "Solver"]

APART = 0.02
"""Of u: minima that are no further from each other are one."""

Box = tuple[Float[Array, "q"], Float[Array, "q"]]


class Basins(eqx.Module):
    """Where the descents ended, the lowest first, and what is left there of the sample.

    Of those that are none, because the grid had fewer minima, the cost is infinite.
    """

    u: Float[Array, "M q"]
    k: Float[Array, "M C p"]
    cost: Float[Array, "M"]
    converged: Bool[Array, "M"]
    steps: Int[Array, ""]
