"""The minima of a coarse grid over u, judged by few pixels: where descents begin.

A node is a choice of the lobes' shapes with a law of attenuation. For each law one Gram matrix holds the
columns of all shapes, and every node picks its own from it.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Bool, Float, Int

from diffshade.channels import Channels, per_channel
from fitting.arrays import Array
from fitting.columns import Images, Scenery
from fitting.limits import Grid
from fitting.model import Model
from fitting.project import Problem, best_linear, gram_of

__all__ = ["minima"]

ROUNDING = 16
"""Times the precision, and |observed|^2, that a cost may be off by."""


def minima(
    problem: Problem, images: Images, grid: Grid, count: int
) -> tuple[Float[Array, "M q"], Bool[Array, "M"]]:
    """The `count` lowest local minima, the lowest first; and which of them are any."""
    costs = _costs(problem, images, grid)
    info = jnp.finfo(costs.dtype)
    # Of nodes that differ by rounding only the first is taken: the broadest lobe, the flattest law.
    costs = jnp.maximum(costs, ROUNDING * float(info.eps) * problem.norm**2)
    costs = jnp.where(jnp.isfinite(costs), costs, info.max)
    around = jnp.where(grid.near_shapes[:, :, None], costs[None], jnp.inf).min(axis=1)
    around = jnp.where(grid.near_laws[None], around[:, None], jnp.inf).min(axis=2)
    lowest = costs <= around
    # First those of different shapes: of one shape any law leads to the others.
    of_shape = costs.min(axis=1)
    leads = of_shape <= jnp.where(grid.near_shapes, of_shape[None], jnp.inf).min(axis=1)
    first = lowest & leads[:, None] & (costs <= of_shape[:, None])
    ranked = jnp.where(lowest, costs, jnp.inf).ravel()
    order = jnp.lexsort((ranked, ~first.ravel() & lowest.ravel(), ~lowest.ravel()))
    best = order[:count]
    choice, law = best // len(grid.laws), best % len(grid.laws)
    return jnp.concatenate([grid.shapes[choice], grid.laws[law]], axis=1), jnp.isfinite(
        ranked[best]
    )


def _costs(problem: Problem, images: Images, grid: Grid) -> Float[Array, "N M"]:
    """What is left at every node, the best linear coefficients within their bounds."""
    model, at = problem.model, _rows(problem.model, grid)

    def of_law(law: Float[Array, "s"]) -> Float[Array, "N"]:
        total = images.sum(lambda image: _every_shape(model, grid, law, image))
        each = jnp.swapaxes(total[:, at[:, :, None], at[:, None, :]], 0, 1)
        return best_linear(problem, each)[1]

    return lax.map(of_law, grid.laws).T


def _rows(model: Model, grid: Grid) -> Int[Array, "N r"]:
    """Where in the Gram matrix of `_every_shape` each node has its columns, and what was observed."""
    others = [i for i in range(model.column_count) if i not in model.reads]
    first = len(others)
    rows: dict[int, Any] = {i: jnp.full(len(grid.chosen), r) for r, i in enumerate(others)}
    for j, (column, distinct) in enumerate(zip(model.reads, grid.distinct, strict=True)):
        rows[column] = first + grid.chosen[:, j]
        first += len(distinct)
    last = jnp.full(len(grid.chosen), first)
    return jnp.stack([*(rows[i] for i in range(model.column_count)), last], axis=1)


def _every_shape(
    model: Model, grid: Grid, law: Float[Array, "s"], image: Scenery
) -> Float[Array, "C R R"]:
    """The Gram matrix of the columns without a shape, of each other with all of its, and of the image."""
    each = model.columns(jnp.concatenate([grid.shapes[0], law]), image)
    rows = [column for i, column in enumerate(each) if i not in model.reads]
    for column, distinct in zip(model.reads, grid.distinct, strict=True):

        def shaped(shape: Float[Array, "l"], column: int = column) -> Channels:
            return model.columns(jnp.concatenate([shape, law]), image)[column]

        rows += zip(*jax.vmap(shaped)(grid.shapes[distinct]), strict=True)
    rows.append(tuple(image.photo.observed))
    counted = [per_channel(tuple(row), model.channel_count) for row in rows]
    return gram_of(counted, model.channel_count, image.photo.weight[None])
