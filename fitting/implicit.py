"""Differentiating through a fit: the solution as a function of images, lights, surface and held values.

The solution theta = (k, u) of a fit is where the gradient of

    F(theta, data) = 1/2 sum w |observed - A(u) k|^2

vanishes in every coefficient that is free, while the others stay at their bound or at the value they
are held at. By the implicit function theorem its derivative is

    dtheta/ddata = -H^-1 d(grad F)/ddata,   H = d(grad F)/dtheta,

with the exact Hessian H, not that of Gauss and Newton, which is wrong wherever a residual is left.
Only this equation is differentiated, never the search that solved it. The gradient is summed block by
block and computed anew in the backward pass, so that no more is kept than one block.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from diffshade.arrays import ArrayLike, is_concrete, is_outermost
from diffshade.errors import BadInput
from diffshade.fusion import compiler_options
from diffshade.geometry.gbuffer import GBuffer
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from fitting.inputs import match, traced_views, views
from fitting.limits import Bounds, Grid, Limits, limits
from fitting.model import (
    Model,
    coefficient,
    default_material,
    held_names,
    linear_names,
    model_of,
)
from fitting.observation import Group, View, group_views, in_precision
from fitting.project import Problem, predict
from fitting.search import ALL, minimise
from fitting.stream import Block

__all__ = ["solve"]

Vector = Float[Array, "n"]


def solve(
    images: ArrayLike | Sequence[ArrayLike],
    gbuffer: GBuffer | Sequence[GBuffer],
    scenes: Scene | Sequence[Scene],
    *,
    material: Material | None = None,
    hold: Iterable[str] = (),
    bounds: Bounds | None = None,
    valid: ArrayLike | Sequence[ArrayLike] | None = None,
) -> Material:
    """The material that `fit` recovers, as a function to compose: under `jit`, `vmap` and `grad`.

    Images, scenes, G-buffers, masks and what `material` holds may be traced; the arguments are those
    of `fit`, and so is the minimum that is found (the start is not looked at: the search is global).
    Every attenuation is taken as known. Nothing is reported of errors: see `fit` for how far to trust
    the values.

    Derivatives are those of the equation that the minimum solves, not of the search, by the implicit
    function theorem (Krantz and Parks 2002): exact at the minimum that was found, in forward and
    reverse mode and of second order, with respect to every number that went in.

    - A coefficient on its bound stays there: its derivative is 0. Where it only touches the bound,
      within 4e-10 (in float32 7e-5), and nothing presses it, that is the derivative from outside;
      from inside it would move.
    - Directions in which the images tell nothing have derivative 0: the shininess of a lobe with
      ks = 0, say. Where two coefficients have one picture and both lie inside their bounds, the
      change is the least one, each in units of what it does to the images.
    - Not smooth where the image is not: at the edge of a highlight or a shadow that meets a pixel,
      and where another minimum becomes the lowest.

    Memory is a few times that of the inputs. Beside the search, a derivative costs as many passes over
    the data as there are coefficients; in reverse mode so does that by all inputs together.

    Raises `BadInput` as `fit` does; of what is traced only the shapes are looked at.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(32, 32, 2.2))
    >>> scene = ds.Scene(lights=ds.ParallelLight((1, 1, 2)))
    >>> image, matte = ds.render(g, scene, ds.Material(kd=0.5)), ds.Material(kd=1.0)
    >>> kd = lambda image: solve(image, g, scene, material=matte).kd[0]
    >>> round(float(jax.jvp(kd, (image,), (image,))[1]), 6)
    0.5
    """
    seen = _seen(images, gbuffer, scenes, valid)
    start = default_material(view.scene for view in seen) if material is None else material
    held = held_names(hold, start)
    if material is None and held:
        raise BadInput(
            f"hold names {min(held)} and no material is given: its value is what is kept; give material="
        )
    dtype = seen[0].gbuffer.normal.x.dtype
    channel_count = seen[0].observed.shape[1]
    model = model_of(in_precision(start, dtype), held, channel_count)
    # Limits are made of names and shapes; what is held may be traced, and is put in after.
    shapes = jax.tree.map(lambda leaf: np.zeros(leaf.shape), start)
    limit = limits(model, held, shapes, bounds or {}, start_given=False)
    groups, _ = group_views(seen)
    grid, box = limit.searched(dtype)
    arguments = (_problem(model, groups, limit), grid, box)
    outermost = is_outermost() and is_concrete(arguments)
    return (_solve_outermost() if outermost else _solve)(*arguments)


def _seen(
    images: ArrayLike | Sequence[ArrayLike],
    gbuffer: GBuffer | Sequence[GBuffer],
    scenes: Scene | Sequence[Scene],
    valid: ArrayLike | Sequence[ArrayLike] | None,
) -> list[View]:
    if is_concrete((images, gbuffer, scenes, valid)):
        return views(match(images, gbuffer, scenes, valid))
    return traced_views(images, gbuffer, scenes, valid)


def _problem(model: Model, groups: tuple[Group, ...], limit: Limits) -> Problem:
    dtype = groups[0].weight.dtype
    names, zero = linear_names(model.material), jnp.zeros((), dtype)
    held = limit.held[0]  # of all channels alike
    values = [
        coefficient(model.material, n) if h else zero
        for n, h in zip(names, held.tolist(), strict=True)
    ]
    of_channels = [jnp.broadcast_to(value, (model.channel_count,)) for value in values]
    given = jnp.stack(of_channels, axis=1).astype(dtype)
    lower, upper = (
        jnp.where(limit.held, given, edge.astype(dtype)) for edge in (limit.lower, limit.upper)
    )
    squares = [jnp.sum(group.weight[:, :, None] * group.observed**2) for group in groups]
    square = sum(squares[1:], squares[0])
    return Problem(
        model=model,
        groups=groups,
        lower=lower,
        upper=upper,
        reference=jnp.clip(0, lower, upper),
        norm=jnp.sqrt(lax.stop_gradient(jnp.where(square > 0, square, 1))),
        most_blocks=jnp.asarray(ALL, jnp.int32),
    )


def _solution(problem: Problem, grid: Grid, box: tuple[Array, Array]) -> Material:
    """The minimum, with the derivative of the equation that it solves."""
    model = problem.model
    shape = problem.lower.shape
    found = minimise(*lax.stop_gradient((problem, grid, box)))
    theta = lax.stop_gradient(jnp.append(found.at.k.ravel(), found.u))
    lower = jnp.append(problem.lower.ravel(), box[0])
    upper = jnp.append(problem.upper.ravel(), box[1])
    free = lax.stop_gradient(_inside(theta, lower, upper))
    edge = jnp.where(theta - lower <= upper - theta, lower, upper)
    # Where a bound is infinite the edge is not looked at, and must be finite for its derivative.
    edge = jnp.where(free, 0, edge)
    least = jnp.square(jnp.finfo(theta.dtype).eps * problem.norm)

    def equation(theta: Vector) -> Vector:
        k, u = theta[: problem.lower.size].reshape(shape), theta[problem.lower.size :]
        of_k, of_u = _gradient(problem, k, u)
        return jnp.where(free, jnp.append(of_k.ravel(), of_u), theta - edge)

    def newton(linear: Callable[[Vector], Vector], right: Vector) -> Vector:
        matrix = jax.vmap(linear, out_axes=1)(jnp.eye(len(right), dtype=right.dtype))
        return _step(matrix, right, free, least)

    solved = lax.custom_root(
        equation,
        jnp.where(free, theta, lax.stop_gradient(edge)),
        lambda _, theta: theta,  # it is solved already
        newton,
    )
    k, u = solved[: problem.lower.size].reshape(shape), solved[problem.lower.size :]
    return model.with_linear(model.unpack(u)[0], k)


_solve = jax.jit(_solution)


@cache
def _solve_outermost() -> Callable[..., Material]:
    return jax.jit(_solution, compiler_options=compiler_options())


def _inside(theta: Vector, lower: Vector, upper: Vector) -> Bool[Array, "n"]:
    """Which coefficients lie inside their bounds, by more than the search leaves open."""
    slack = float(jnp.finfo(theta.dtype).eps) ** 0.6
    return (theta - lower > slack) & (upper - theta > slack)


def _gradient(
    problem: Problem, k: Float[Array, "C p"], u: Float[Array, "q"]
) -> tuple[Float[Array, "C p"], Float[Array, "q"]]:
    """d/dk and d/du of F."""
    model = problem.model

    def cost(k: Array, u: Array) -> Array:
        @jax.checkpoint
        def of_block(block: Block) -> Array:
            residual = block.observed - predict(model.columns(u, block), k)
            return 0.5 * jnp.sum(block.weight[None] * residual**2)

        zero = jnp.zeros((), k.dtype)
        return sum((_sum(group, of_block, zero) for group in problem.groups), zero)

    return jax.grad(cost, argnums=(0, 1))(k, u)


class _Image(NamedTuple):
    scene: Scene
    observed: Float[Array, "B C P"]
    weight: Float[Array, "B P"]


def _sum(group: Group, of_block: Callable[[Block], Array], zero: Array) -> Array:
    """Over all images and blocks: how many is known beforehand, as reverse mode needs it."""

    def add_image(total: Array, image: _Image) -> tuple[Array, None]:
        def add_block(total: Array, planes: tuple[GBuffer, Array, Array]) -> tuple[Array, None]:
            surface, observed, weight = planes
            return total + of_block(Block(surface, image.scene, observed, weight, None)), None

        return lax.scan(add_block, total, (group.blocks, image.observed, image.weight))

    images = _Image(group.scenes, group.observed, group.weight)
    return lax.scan(add_image, zero, images)[0]


def _step(
    matrix: Float[Array, "n n"], right: Vector, free: Bool[Array, "n"], least: Float[Array, ""]
) -> Vector:
    """The x of matrix x = right, where the rows that are not free are those of the identity.

    Of the free ones in units of their curvature. What has less than the `least`, which the images'
    own rounding would hide, and directions that the matrix has only by rounding, do not move.
    """
    dtype = right.dtype
    curvature = jnp.diagonal(matrix)
    alive = free & (curvature > least)
    scale = jnp.where(alive, lax.rsqrt(jnp.where(alive, curvature, 1)), 0)
    at_edge = jnp.where(free, 0, right)
    unit = matrix * jnp.outer(scale, scale)
    values, vectors = jnp.linalg.eigh(lax.stop_gradient(unit), symmetrize_input=True)
    told = values > 100 * float(jnp.finfo(dtype).eps)
    basis = lax.stop_gradient(jnp.where(told[None], vectors, 0))
    # Diagonal, but for its own derivative.
    inner = basis.T @ unit @ basis + jnp.diag((~told).astype(dtype))
    moved = jnp.linalg.solve(inner, basis.T @ (scale * (right - matrix @ at_edge)))
    return at_edge + scale * (basis @ moved)
