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

import operator
from collections.abc import Callable, Iterable, Sequence
from functools import cache, reduce

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from diffshade.arrays import ArrayLike, is_concrete, is_outermost
from diffshade.errors import BadInput
from diffshade.fusion import search_options
from diffshade.geometry.gbuffer import GBuffer
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from fitting.columns import Blocks, Scenery, predict
from fitting.inputs import Traced, match, traced
from fitting.limits import Bounds, Grid, Limits, limits
from fitting.model import (
    Model,
    coefficient,
    default_material,
    held_names,
    linear_names,
    model_of,
)
from fitting.observation import SAMPLE, Group, in_precision, traced_groups
from fitting.project import Problem
from fitting.search import descend, search

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
    channel_count = seen[0].observed.shape[0]
    model = model_of(in_precision(start, dtype), held, channel_count)
    # Limits are made of names and shapes; what is held may be traced, and is put in after.
    shapes = jax.tree.map(lambda leaf: np.zeros(leaf.shape), start)
    limit = limits(model, held, shapes, bounds or {}, start_given=False)
    groups = traced_groups(seen)
    arguments = (_problem(model, groups, limit), groups, *limit.searched(dtype))
    outermost = is_outermost() and is_concrete(arguments)
    return (_solve_outermost() if outermost else _solve)(*arguments)


def _seen(
    images: ArrayLike | Sequence[ArrayLike],
    gbuffer: GBuffer | Sequence[GBuffer],
    scenes: Scene | Sequence[Scene],
    valid: ArrayLike | Sequence[ArrayLike] | None,
) -> list[Traced]:
    if is_concrete((images, gbuffer, scenes, valid)):
        for photograph in match(images, gbuffer, scenes, valid):
            photograph.check()
    return traced(images, gbuffer, scenes, valid)


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
    squares = [jnp.sum(group.weight[:, None] * group.observed**2) for group in groups]
    square = lax.stop_gradient(reduce(operator.add, squares))
    return Problem(model, lower, upper, jnp.sqrt(jnp.where(square > 0, square, 1)))


def _solution(
    problem: Problem, groups: tuple[Group, ...], grid: Grid, box: tuple[Array, Array]
) -> Material:
    """The minimum, with the derivative of the equation that it solves."""
    model, everything = problem.model, Blocks(groups, problem.model.material)
    shape = problem.lower.shape
    k, u = lax.stop_gradient(_minimum(*lax.stop_gradient((problem, groups, grid, box))))
    theta = jnp.append(k.ravel(), u)
    lower = jnp.append(problem.lower.ravel(), box[0])
    upper = jnp.append(problem.upper.ravel(), box[1])
    free = lax.stop_gradient(_inside(theta, lower, upper))
    edge = jnp.where(theta - lower <= upper - theta, lower, upper)
    # Where a bound is infinite the edge is not looked at, and must be finite for its derivative.
    edge = jnp.where(free, 0, edge)
    least = jnp.square(jnp.finfo(theta.dtype).eps * problem.norm)

    def equation(theta: Vector) -> Vector:
        k, u = theta[: problem.lower.size].reshape(shape), theta[problem.lower.size :]
        of_k, of_u = _gradient(model, everything, k, u)
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
    material, _ = model.unpack(u)
    for name, column in zip(linear_names(material), k.T, strict=True):
        material = eqx.tree_at(lambda m: coefficient(m, name), material, column)  # noqa: B023
    return material


def _minimum(
    problem: Problem, groups: tuple[Group, ...], grid: Grid, box: tuple[Array, Array]
) -> tuple[Float[Array, "C p"], Float[Array, "q"]]:
    """k and u: searched on a comb of the points, finished on all."""
    comb = tuple(
        group.part(slice(None, None, max(group.weight.shape[1] // SAMPLE, 1))) for group in groups
    )
    start = search(problem, comb, grid, box).u[0]
    everything = Blocks(groups, problem.model.material)
    u, k, *_ = descend(problem, everything, start, box, damping=1e-9)
    return k, u


_solve = jax.jit(_solution)


@cache
def _solve_outermost() -> Callable[..., Material]:
    return jax.jit(_solution, compiler_options=search_options())


def _inside(theta: Vector, lower: Vector, upper: Vector) -> Bool[Array, "n"]:
    """Which coefficients lie inside their bounds, by more than the search leaves open."""
    slack = float(jnp.finfo(theta.dtype).eps) ** 0.6
    return (theta - lower > slack) & (upper - theta > slack)


def _gradient(
    model: Model, everything: Blocks, k: Float[Array, "C p"], u: Float[Array, "q"]
) -> tuple[Float[Array, "C p"], Float[Array, "q"]]:
    """d/dk and d/du of F."""

    def cost(k: Array, u: Array) -> Array:
        @jax.checkpoint
        def of_image(at: Scenery) -> Array:
            residual = at.photo.observed - jnp.stack(predict(model.columns(u, at), k))
            return 0.5 * jnp.sum(at.photo.weight[None] * residual**2)

        return everything.sum(of_image)

    return jax.grad(cost, argnums=(0, 1))(k, u)


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
