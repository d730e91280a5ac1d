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

import operator
from collections.abc import Sequence
from functools import reduce
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import lax
from jaxtyping import Array, Bool, Float

from diffshade.fusion import stored
from diffshade.reflectance.lobe import AbstractLobe
from diffshade.shading.prefiltered import filtered
from fitting.closed_form import bounded, own_share, rounding, solve
from fitting.solver import BoundedLevenbergMarquardt

__all__ = ["CHUNK", "PixelFit", "PixelProblem", "Settings", "fit_pixels"]

NODES = 16
SHARPEST_NODE = 3000.0
"""The grid's largest shininess, where bounds do not set it."""
MAX_STEPS = 12
"""Of Optimistix: all pixels of a chunk wait for the slowest, and those that need more tell nothing."""
STEP_LEFT = 1e-3
"""Of u: the step that a search which has arrived may leave ..."""
CHANGE_LEFT = 1e-2, 1e-5
"""... or the change of the fit by it, as a share of the residual, or of what was observed."""
NEAR = 0.05
"""A step of u as small as this is taken without a look at where it leads."""


Plane = Float[Array, "*P"]
Observations = Float[Array, "K *P"]
State = tuple[Plane, Plane, Plane, Plane]


CHUNK = 240
"""Pixels at one time: with fewer the overhead of each operation shows, with more the cache is too small.
Not a power of two: the rows of such a plane would have one place in the cache."""


class Settings(NamedTuple):
    """Bounds of the linear coefficients and of log n, and how many steps (None: to convergence)."""

    bounds: tuple[tuple[float, float], ...]
    log_shininess: tuple[float, float]
    steps: int | None


class PixelProblem(eqx.Module):
    """What is known of each pixel: planes [K, P], or [K] of one pixel under `vmap`.

    `observed` has a plane a channel. The basis has G planes for each column, G = C, or 1 where all
    channels share it: `plain` are the columns without a lobe, a and d; of each of L lights in an
    image `arriving` is I_p f, and `angles` what the lobe needs of the directions. Observations that
    are not used are 0 in `observed`, `plain` and `arriving`. `environments` hold what arrives from all
    around, degree by degree, in the direction that the viewer is mirrored to; 0 likewise.
    """

    lobe: AbstractLobe
    observed: tuple[Observations, ...]  # C
    plain: tuple[tuple[Observations, ...], ...]  # G, columns
    arriving: tuple[tuple[Observations, ...], ...]  # G, L
    angles: tuple[Observations, ...]  # L
    environments: tuple[tuple[tuple[Observations, ...], ...], ...] = ()  # of each: G, degrees

    def lobe_at(self, u: Float[Array, "..."]) -> list[Observations]:
        """The specular column s at log n = u, a number or a plane: G planes."""
        return stored(self._lobe, u)

    def lobe_and_slope(self, u: Plane) -> tuple[list[Observations], list[Observations]]:
        """The specular column, and its derivative in u."""
        return stored(lambda u: jax.jvp(self._lobe, (u,), (jnp.ones_like(u),)), u)

    def _lobe(self, u: Float[Array, "..."]) -> list[Observations]:
        # One for all channels, and where there is one a pixel, for all its observations.
        shininess = jnp.exp(u)[None] if u.ndim == 0 else jnp.exp(u)[None, None]
        lobe = eqx.tree_at(lambda l: l.shininess, self.lobe, shininess)
        values = [lobe.at(angles)[0] for angles in self.angles]
        terms = [[x * y for x, y in zip(a, values, strict=True)] for a in self.arriving]
        for around in self.environments:
            for own, bands in zip(terms, around, strict=True):
                own += filtered(lobe, tuple((band,) for band in bands))
        return [_total(own) for own in terms]


class Linear(NamedTuple):
    """One channel at one u: its columns, their Gram matrix, the k that fits best, and what is left."""

    columns: list[Observations]
    gram: list[list[Plane]]
    k: list[Plane]
    left: Observations


class Projected(NamedTuple):
    """The fit at one u: k a channel and column, what is left, and its Gauss-Newton model in u.

    To first order what is left at u + du is cost - 2 gradient du + curvature du^2.
    """

    k: list[list[Plane]]
    cost: Plane
    gradient: Plane
    curvature: Plane

    @property
    def step(self) -> Plane:
        """From u to the minimum of the model; 0 where there is none."""
        told = self.curvature > 0
        return jnp.where(told, self.gradient / jnp.where(told, self.curvature, 1), 0)


class PixelFit(NamedTuple):
    """At each pixel: k, u, |r|^2, their errors for noise 1, how many unknowns were fitted, and whether
    the search had arrived: another step would move u, or the fit, by next to nothing.
    """

    k: tuple[tuple[Plane, ...], ...]  # C, p: in one array XLA would compute all for each
    u: Plane
    cost: Plane
    k_error: tuple[tuple[Plane, ...], ...]
    u_error: Plane
    unknowns: Plane
    converged: Bool[Array, "*P"]


def fit_pixels(problem: PixelProblem, settings: Settings) -> PixelFit:
    """The best k and u at each pixel of a chunk."""
    u = _best_node(problem, settings)
    if settings.steps is None:
        u = _by_optimistix(problem, settings, u)
    else:
        u = _by_steps(problem, settings, u)
    return _with_errors(problem, settings, u)


def _linear(problem: PixelProblem, settings: Settings, s: list[Observations]) -> list[Linear]:
    """Each channel with the linear coefficients that fit best."""
    bases = [[*plain, s_g] for plain, s_g in zip(problem.plain, s, strict=True)]
    grams = [_gram(columns) for columns in bases]
    channels = []
    for c, y in enumerate(problem.observed):
        g = c if len(bases) > 1 else 0
        columns, gram = bases[g], grams[g]
        moment = [_sum(column, y) for column in columns]
        k, _ = stored(lambda g, m: bounded(g, m, settings.bounds), gram, moment)
        left = y
        for column, k_i in zip(columns, k, strict=True):
            left = left - k_i[None] * column
        channels.append(Linear(columns, gram, k, left))
    return channels


def _best_node(problem: PixelProblem, settings: Settings) -> Plane:
    """The node of a grid over u from which least is left."""
    low, high = settings.log_shininess
    nodes = np.linspace(max(low, 0.0), min(high, np.log(SHARPEST_NODE)), NODES)
    y = problem.observed[0]
    count, dtype = y.shape[1], y.dtype

    def judge(
        best: tuple[Plane, Plane], node: Float[Array, ""]
    ) -> tuple[tuple[Plane, Plane], None]:
        least, u = best
        s = problem.lobe_at(node)
        costs = []
        for c, y in enumerate(problem.observed):
            g = c if len(s) > 1 else 0
            columns = [*problem.plain[g], s[g]]
            moment = [_sum(column, y) for column in columns]
            costs.append(bounded(_gram(columns), moment, settings.bounds)[1])
        cost = _total(costs)
        better = cost < least
        return (jnp.where(better, cost, least), jnp.where(better, node, u)), None

    start = jnp.full(count, jnp.inf, dtype), jnp.full(count, nodes[0], dtype)
    (_, u), _ = lax.scan(judge, start, jnp.asarray(np.clip(nodes, low, high), dtype))
    return u


def _project(problem: PixelProblem, settings: Settings, u: Plane) -> Projected:
    """The linear coefficients eliminated at u."""
    return _projected(problem, settings, *problem.lobe_and_slope(u))


def _projected(
    problem: PixelProblem,
    settings: Settings,
    s: list[Observations],
    slopes: list[Observations],
) -> Projected:
    """The same from the specular column at u, and its derivative."""
    ks, costs, gradients, curvatures = [], [], [], []
    for c, (columns, gram, k, left) in enumerate(_linear(problem, settings, s)):
        slope = slopes[c if len(slopes) > 1 else 0]
        free = [(low < x) & (x < high) for x, (low, high) in zip(k, settings.bounds, strict=True)]
        # What rounding left of the columns in the residual: k refined once against it.
        side = [_sum(column, left) for column in columns]
        across = [_sum(column, slope) for column in columns]
        change, explained = stored(
            lambda gram, free, *rights: [solve(gram, right, free) for right in rights],
            gram,
            free,
            side,
            across,
        )
        square = _sum(slope, slope)
        curvature = square - _dot(explained, across)
        # Where the other columns explain the slope within rounding, this channel does not tell u.
        told = curvature > rounding(square)
        gradient = k[-1] * (_sum(slope, left) - _dot(explained, side))
        gradients.append(jnp.where(told, gradient, 0))
        curvatures.append(jnp.where(told, k[-1] * k[-1] * curvature, 0))
        costs.append(jnp.maximum(_sum(left, left) - _dot(change, side), 0))
        within = zip(k, change, settings.bounds, strict=True)
        ks.append([jnp.clip(x + dx, low, high) for x, dx, (low, high) in within])
    return Projected(ks, _total(costs), _total(gradients), _total(curvatures))


def _by_steps(problem: PixelProblem, settings: Settings, u: Array) -> Array:
    """A fixed number of Gauss-Newton steps, each taken back and shortened where it went uphill."""
    low, high = settings.log_shininess
    noise = 1 + 16 * float(jnp.finfo(u.dtype).eps)  # rounding of the cost

    def advance(state: State, _: None) -> tuple[State, None]:
        trial, u, cost, step = state
        at = _project(problem, settings, trial)
        accept = at.cost <= cost * noise
        step = jnp.where(accept, jnp.clip(at.step, -0.5, 0.5), 0.25 * step)
        u = jnp.where(accept, trial, u)
        cost = jnp.where(accept, at.cost, cost)
        return (jnp.clip(u + step, low, high), u, cost, step), None

    start = u, u, jnp.full_like(u, jnp.inf), jnp.zeros_like(u)
    (ahead, best, _, _), _ = lax.scan(advance, start, None, length=settings.steps)
    return jnp.where(jnp.abs(ahead - best) <= NEAR, ahead, best)


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

    def minimise(u: Array, planes: Any) -> Array:
        pixel = PixelProblem(problem.lobe, *planes)
        solution: Any = optx.least_squares(
            residual, solver, u[None], args=pixel, max_steps=MAX_STEPS, throw=False
        )
        return solution.value[0]

    planes = (
        problem.observed,
        problem.plain,
        problem.arriving,
        problem.angles,
        problem.environments,
    )
    u = jax.vmap(minimise, in_axes=(0, -1))(u, planes)
    # Its tolerances are met before the last digits are: one step more, where it is a small one.
    step = _project(problem, settings, u).step
    return jnp.where(jnp.abs(step) <= NEAR, jnp.clip(u + step, *settings.log_shininess), u)


def _with_errors(problem: PixelProblem, settings: Settings, u: Plane) -> PixelFit:
    """k at u, and the Cramer-Rao errors for noise 1, bounds left aside."""
    s, slopes = problem.lobe_and_slope(u)
    at = _projected(problem, settings, s, slopes)
    p = len(settings.bounds)
    full, unknowns = [], []
    for c, k in enumerate(at.k):
        # The columns, and k_s ds/du. A column of zeros is no unknown.
        g = c if len(s) > 1 else 0
        matrix = _gram([*problem.plain[g], s[g], slopes[g]])
        for i in range(p):
            matrix[i][p] = matrix[p][i] = k[-1] * matrix[i][p]
        matrix[p][p] = k[-1] * k[-1] * matrix[p][p]
        full.append(matrix)
        unknowns += [(matrix[i][i] > 0).astype(u.dtype) for i in range(p)]
    of_u = [own_share(matrix, p) for matrix in full]
    information = _total(of_u)
    shares = []
    for matrix, own in zip(full, of_u, strict=True):
        # u is shared: what the other channels tell of it adds to its diagonal entry.
        matrix[p][p] = matrix[p][p] + (information - own)
        shares.append([own_share(matrix, i) for i in range(p)])
    left = jnp.clip(u + at.step, *settings.log_shininess) - u
    of_residual, of_observed = CHANGE_LEFT
    square = _total([_sum(y, y) for y in problem.observed])
    slight = jnp.maximum(of_residual**2 * at.cost, of_observed**2 * square)
    return PixelFit(
        k=tuple(tuple(row) for row in at.k),
        u=u,
        cost=at.cost,
        k_error=tuple(tuple(_error(share) for share in row) for row in shares),
        u_error=_error(information),
        unknowns=_total([*unknowns, (information > 0).astype(u.dtype)]),
        converged=(jnp.abs(left) <= STEP_LEFT) | (at.curvature * left**2 <= slight),
    )


def _error(information: Array) -> Array:
    """1 / sqrt(information), infinite where there is none."""
    told = information > 0
    return jnp.where(told, lax.rsqrt(jnp.where(told, information, 1)), jnp.inf)


def _gram(columns: list[Observations]) -> list[list[Plane]]:
    """The Gram matrix of columns of observations."""
    size = len(columns)
    half = {(i, j): _sum(columns[i], columns[j]) for i in range(size) for j in range(i + 1)}
    return [[half[max(i, j), min(i, j)] for j in range(size)] for i in range(size)]


def _sum(a: Observations, b: Observations) -> Plane:
    """a.b over the observations of each pixel."""
    return jnp.sum(a * b, axis=0)


def _dot(a: Sequence[Array], b: Sequence[Array]) -> Array:
    return _total([x * y for x, y in zip(a, b, strict=True)])


def _total(terms: Sequence[Array]) -> Array:
    return reduce(operator.add, terms)
