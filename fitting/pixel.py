"""A material for every pixel: thousands of small separable fits at once.

At one pixel, with K observations y in each of C channels,

    y = k_a a + k_d d + k_s s(n) + noise,      s(n) the lobe of shininess n,

so for a given n the coefficients k are a tiny bounded least-squares problem, and what is left is a
search over u = log n alone (variable projection, Golub and Pereyra 1973). A grid over u finds the
basin. From there either Optimistix goes to the minimum, or a fixed number of Gauss-Newton steps does
in a fraction of the time.

Pixels lie last in every array, and a chunk of them fits a processor's cache: XLA turns each line
into arithmetic on contiguous planes, whatever the number of pixels.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import lax
from jaxtyping import Array, Float

from diffshade.reflectance.lobe import AbstractLobe
from fitting.pixel_linear import bounded, own_share, solve
from fitting.solver import BoundedLevenbergMarquardt

__all__ = ["CHUNK", "NODES", "PixelFit", "PixelProblem", "Settings", "fit_pixels"]

CHUNK = 1024
NODES = 16
SHARPEST_NODE = 3000.0
"""The grid's largest shininess, where bounds do not set it."""
MAX_STEPS = 30


class Settings(NamedTuple):
    """Bounds of the linear coefficients and of log n, and how many steps (None: to convergence)."""

    bounds: tuple[tuple[float, float], ...]
    log_shininess: tuple[float, float]
    steps: int | None


class PixelProblem(eqx.Module):
    """What is known of each pixel: [..., P], or [...] of one pixel under `vmap`.

    `observed` and the rows of the basis are 0 where an observation is not used. `plain` are the
    columns without a lobe, a and d. Of each of L lights in an image, `arriving` is I_p f and
    `angles` what the lobe needs of the directions. G is C, or 1 where all channels share a basis.
    """

    lobe: AbstractLobe
    observed: Float[Array, "C K *P"]
    plain: tuple[Float[Array, "G K *P"], ...]
    arriving: Float[Array, "G L K *P"]
    angles: Float[Array, "L K *P"]

    def lobes(self, u: Float[Array, "*P"]) -> tuple[Float[Array, "G K *P"], Float[Array, "G K *P"]]:
        """The specular column s at log n = u, and its derivative in u."""

        def shape(u: Float[Array, "*P"]) -> Float[Array, "L K *P"]:
            lobe = eqx.tree_at(lambda l: l.shininess, self.lobe, jnp.exp(u)[None])
            at = jax.vmap(jax.vmap(lambda angles: lobe.at(angles)[0]))
            return at(self.angles)

        s, slope = jax.jvp(shape, (u,), (jnp.ones_like(u),))
        return jnp.sum(self.arriving * s[None], 1), jnp.sum(self.arriving * slope[None], 1)


class Projected(NamedTuple):
    """The fit at one u: k, what is left, and its Gauss-Newton model in u with k eliminated."""

    k: tuple[Float[Array, "C *P"], ...]
    cost: Float[Array, "*P"]
    gradient: Float[Array, "*P"]
    curvature: Float[Array, "*P"]


class PixelFit(NamedTuple):
    """At each pixel: k by column, u, |r|^2, the errors for noise 1, and how many unknowns those fix."""

    k: Float[Array, "p C *P"]
    u: Float[Array, "*P"]
    cost: Float[Array, "*P"]
    k_error: Float[Array, "p C *P"]
    u_error: Float[Array, "*P"]
    unknowns: Float[Array, "*P"]


def fit_pixels(problem: PixelProblem, settings: Settings) -> PixelFit:
    """The best k and u at each pixel of a chunk."""
    u = _best_node(problem, settings)
    if settings.steps is None:
        u = _by_optimistix(problem, settings, u)
    else:
        u = _by_steps(problem, settings, u)
    return _with_errors(problem, settings, u)


def _sum(a: Array, b: Array) -> Array:
    """Over the observations."""
    return jnp.sum(a * b, axis=1)


def _linear(
    problem: PixelProblem, settings: Settings, s: Array
) -> tuple[list[Array], list[list[Array]], list[Array]]:
    """The columns with s the last, their Gram matrix, and the k that fits best."""
    columns = [*problem.plain, s]
    gram = _gram(columns)
    moment = [_sum(column, problem.observed) for column in columns]
    channel_count = problem.observed.shape[0]
    gram = [[jnp.broadcast_to(g, (channel_count, *g.shape[1:])) for g in row] for row in gram]
    return columns, gram, bounded(gram, moment, settings.bounds)


def _gram(columns: list[Array]) -> list[list[Array]]:
    size = len(columns)
    half = {(i, j): _sum(columns[i], columns[j]) for i in range(size) for j in range(i + 1)}
    return [[half[max(i, j), min(i, j)] for j in range(size)] for i in range(size)]


def _residual(problem: PixelProblem, columns: list[Array], k: list[Array]) -> Array:
    left = problem.observed
    for column, k_i in zip(columns, k, strict=True):
        left = left - k_i[:, None] * column
    return left


def _best_node(problem: PixelProblem, settings: Settings) -> Float[Array, "P"]:
    """The node of a grid over u from which least is left."""
    low, high = settings.log_shininess
    nodes = np.linspace(max(low, 0.0), min(high, np.log(SHARPEST_NODE)), NODES)
    nodes = np.clip(nodes, low, high)
    dtype, count = problem.observed.dtype, problem.observed.shape[-1]

    def judge(best: tuple[Array, Array], node: Array) -> tuple[tuple[Array, Array], None]:
        least, u = best
        s, _ = problem.lobes(node)
        columns, _, k = _linear(problem, settings, s)
        left = _residual(problem, columns, k)
        cost = jnp.sum(_sum(left, left), 0)
        better = cost < least
        return (jnp.where(better, cost, least), jnp.where(better, node, u)), None

    start = jnp.full(count, jnp.inf, dtype), jnp.full(count, nodes[0], dtype)
    (_, u), _ = lax.scan(judge, start, jnp.asarray(nodes, dtype))
    return u


def _project(problem: PixelProblem, settings: Settings, u: Array) -> Projected:
    """The linear coefficients eliminated at u; `gradient` points downhill."""
    s, slope = problem.lobes(u)
    columns, gram, k = _linear(problem, settings, s)
    left = _residual(problem, columns, k)
    free = [(low < k_i) & (k_i < high) for k_i, (low, high) in zip(k, settings.bounds, strict=True)]
    # What rounding left of the columns in the residual: k refined once against it.
    side = [_sum(column, left) for column in columns]
    refinement = solve(gram, side, free)
    across = [_sum(column, slope) for column in columns]
    explained = solve(gram, across, free)
    ks = k[-1]
    cost = _sum(left, left) - _dot(refinement, side)
    gradient = ks * (_sum(slope, left) - _dot(explained, side))
    square = _sum(slope, slope)
    curvature = square - _dot(explained, across)
    # Where the other columns explain the slope within rounding, u cannot be told.
    told = curvature > 30 * jnp.finfo(u.dtype).eps * square
    return Projected(
        k=tuple(
            jnp.clip(value + change, *edges)
            for value, change, edges in zip(k, refinement, settings.bounds, strict=True)
        ),
        cost=jnp.maximum(jnp.sum(cost, 0), 0),
        gradient=jnp.sum(jnp.where(told, gradient, 0), 0),
        curvature=jnp.sum(jnp.where(told, ks * ks * curvature, 0), 0),
    )


def _dot(a: list[Array], b: list[Array]) -> Array:
    total = a[0] * b[0]
    for x, y in zip(a[1:], b[1:], strict=True):
        total = total + x * y
    return total


def _by_steps(problem: PixelProblem, settings: Settings, u: Array) -> Array:
    """A fixed number of Gauss-Newton steps, each taken back and shortened where it went uphill."""
    low, high = settings.log_shininess
    rounding = 1 + 16 * jnp.finfo(u.dtype).eps

    def advance(state: tuple[Array, ...], _: None) -> tuple[tuple[Array, ...], None]:
        trial, u, cost, step = state
        at = _project(problem, settings, trial)
        accept = at.cost <= cost * rounding
        told = at.curvature > 0
        ahead = jnp.where(told, at.gradient / jnp.where(told, at.curvature, 1), 0)
        step = jnp.where(accept, jnp.clip(ahead, -0.5, 0.5), 0.25 * step)
        u = jnp.where(accept, trial, u)
        cost = jnp.where(accept, at.cost, cost)
        return (jnp.clip(u + step, low, high), u, cost, step), None

    start = u, u, jnp.full_like(u, jnp.inf), jnp.zeros_like(u)
    (trial, *_), _ = lax.scan(advance, start, None, length=settings.steps)
    return trial


def _by_optimistix(problem: PixelProblem, settings: Settings, u: Array) -> Array:
    """To the minimum near u."""
    dtype = u.dtype
    eps = float(jnp.finfo(dtype).eps)
    tolerance = eps**0.5 if dtype == jnp.float64 else 100 * eps
    low, high = (jnp.full(1, edge, dtype) for edge in settings.log_shininess)
    solver = BoundedLevenbergMarquardt(tolerance, tolerance, low, high)

    def residual(v: Float[Array, "1"], pixel: PixelProblem) -> Float[Array, "2"]:
        """Two numbers with the norm, and the Gauss-Newton model, of the whole residual."""
        here = lax.stop_gradient(v)
        at = _project(pixel, settings, here[0])
        told = at.curvature > 0
        root = jnp.sqrt(jnp.where(told, at.curvature, 1))
        along = jnp.where(told, at.gradient / root, 0)
        rest = jnp.sqrt(jnp.maximum(at.cost - along**2, 0))
        slope = jnp.where(told, root, 0)
        return jnp.stack([along - slope * (v[0] - here[0]), rest])

    def minimise(u: Array, pixel: PixelProblem) -> Array:
        solution: Any = optx.least_squares(
            residual, solver, u[None], args=pixel, max_steps=MAX_STEPS, throw=False
        )
        return solution.value[0]

    axes = replace(jax.tree.map(lambda _: -1, problem), lobe=None)
    return jax.vmap(minimise, in_axes=(0, axes))(u, problem)


def _with_errors(problem: PixelProblem, settings: Settings, u: Array) -> PixelFit:
    """k at u, and the Cramer-Rao errors for noise 1, bounds left aside."""
    at = _project(problem, settings, u)
    s, slope = problem.lobes(u)
    columns = [*problem.plain, s]
    shape = at.k[0].shape
    # In each channel the columns and k_s ds/du; u is shared, and what the other channels tell of
    # it adds to its diagonal entry.
    full = [[jnp.broadcast_to(g, shape) for g in row] for row in _gram([*columns, slope])]
    p = len(columns)
    ks = at.k[-1]
    for i in range(p):
        full[i][p] = full[p][i] = ks * full[i][p]
    full[p][p] = ks * ks * full[p][p]
    of_u = own_share(full, p)
    information = jnp.sum(of_u, 0)
    full[p][p] = full[p][p] + (information[None] - of_u)
    shares = [own_share(full, i) for i in range(p)]
    return PixelFit(
        k=jnp.stack(at.k),
        u=u,
        cost=at.cost,
        k_error=jnp.stack([_error(share) for share in shares]),
        u_error=_error(information),
        unknowns=jnp.sum(jnp.stack([full[i][i] > 0 for i in range(p)]), (0, 1), dtype=u.dtype)
        + (information > 0).astype(u.dtype),
    )


def _error(information: Array) -> Array:
    """1 / sqrt(information), infinite where there is none."""
    told = information > 0
    return jnp.where(told, lax.rsqrt(jnp.where(told, information, 1)), jnp.inf)
