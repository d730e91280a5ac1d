"""How low the residual can be over a whole interval of shininess: a bound that is a proof.

Let S(n) be a lobe's column, the sum over lights of I_j f_j s_j(n) at every pixel. Where s falls with n
and is convex in it, so does S, and between a and b it lies under its chord and over its tangents at
a and b. With n = (1 - t) a + t b

    S(n) = M + (2 t - 1) D + e,    |e_p| <= g_p / 2    at every pixel p,
    M = (S(a) + S(b)) / 2 - g / 2,    D = (S(b) - S(a)) / 2,

where g_p is how far the tangents' intersection lies under the chord. So for every k, and whatever n,

    |y - K k - ks S(n)|  >=  |y - K k - ks M - d D| - ks h,    h = |g| / 2,  |d| <= ks,

K being the other columns. The right side is convex in x = (k, ks, d). A norm is no less than its
component along any v with |v| <= 1, which for v along the residual r' of any x' is a plane under it:

    |y - A x|  >=  v.y - sum over i of x_i v.A_i,    v = r' / rho,  rho >= |r'|,

and a plane over the box that x lies in is lowest at a corner. No solver needs to be trusted: a poor x'
gives a poor bound, not a wrong one. What is given away shrinks with the square of the interval's width;
of several channels, which may each choose an n of their own in it, with the width.

All is summed in float64, and `rounding` bounds what that leaves out, in proportion to the pixels.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, PyTree

from diffshade import guard
from diffshade.channels import per_channel
from fitting.linear import bounded_least_squares
from fitting.project import Problem, predict
from fitting.sharding import over_devices
from fitting.stream import Block, sum_over_blocks

__all__ = ["Bounded", "bound"]

EPS = float(np.finfo(np.float64).eps)
BLOCKS = np.iinfo(np.int32).max
"""All of them."""
TOUCHES = 3
"""Planes from each face: the first at the least squares, the next where ks h is weighed against it."""


class Bounded(NamedTuple):
    """Of each interval [a, b]: no n in it leaves less than `below`, and n = a no more than `above`.

    Both are norms of the residual, of the best linear coefficients within their bounds; `below` is
    also allowed to be any number above the threshold where all of the interval leaves more than that.
    """

    below: Float[Array, "I"]
    above: Float[Array, "I"]
    norm: Float[Array, ""]  # of everything observed


class _Rounding(NamedTuple):
    """Relative errors: of a sum over all pixels, and of a column's values."""

    sum: float
    column: Float[Array, ""]


@over_devices
def bound(
    problem: Problem,
    u: Float[Array, "q"],
    intervals: Float[Array, "I 2"],
    threshold: Float[Array, ""],
) -> Bounded:
    """The bounds over intervals of n of the one lobe that is searched; one pass over the data.

    The rest of u is known. Only coefficients that leave no more than `threshold` need be looked at.
    To be called in JAX's 64-bit mode.
    """
    lobe = _lobe(problem)
    # The searched lobe's bounds last
    order = [*(i for i in range(problem.lower.shape[1]) if i != lobe), lobe]
    lower, upper = (_double(edge)[:, order] for edge in (problem.lower, problem.upper))
    shapes = [group.weight.shape for group in problem.groups]
    summed = 4 * EPS * sum(sum(shape) for shape in shapes)

    def of_interval(interval: Float[Array, "2"]) -> tuple[Array, Array, Array]:
        a, b = interval
        grams = _grams(problem, lobe, u, a, b)
        # exp(u), x^n and products: their errors grow with the exponent, which is at most 708.
        rounding = _Rounding(summed, EPS * (1e4 + 8 * b))
        of_channel = jax.vmap(_of_channel, (0, 0, 0, None, None))
        below, above = of_channel(grams, lower, upper, threshold, rounding)
        return jnp.linalg.norm(below), jnp.linalg.norm(above), jnp.sum(grams[:, -1, -1])

    below, above, square = jax.vmap(of_interval)(intervals)
    return Bounded(below, above, jnp.sqrt(square[0]))


def _lobe(problem: Problem) -> int:
    """The column of the lobe that is searched."""
    model = problem.model
    return model.column_count - len(model.material.specular) + model.searched[0]


def _double(tree: PyTree) -> PyTree:
    """The tree's floats in float64."""
    floating = lambda x: jnp.issubdtype(jnp.result_type(x), jnp.floating)  # noqa: E731
    return jax.tree.map(lambda x: jnp.asarray(x, jnp.float64) if floating(x) else x, tree)


def _grams(
    problem: Problem, lobe: int, u: Float[Array, "q"], a: Float[Array, ""], b: Float[Array, ""]
) -> Float[Array, "C m m"]:
    """The Gram matrix of the rows [K, M, D, g/2, S(b), y] in each channel, over all pixels."""
    model, judge = _double((problem.model, problem.judge))
    channel_count = len(problem.lower)

    def of_block(block: Block, _: Array | None) -> Float[Array, "C m m"]:
        block = _double(block)

        def columns(n: Array) -> tuple[tuple[Array, ...], ...]:
            return model.columns(u.at[0].set(jnp.log(n)), block)

        columns_at = [jax.jvp(columns, (n,), (jnp.ones_like(n),)) for n in (a, b)]
        (at_a, slope_a), (at_b, slope_b) = columns_at
        observed, weights, sets = block.observed, block.weight[None], len(at_a[lobe])
        if judge is not None:
            judged = predict(model.columns(judge.u, block), judge.k)
            weights = judge.weights(judged, observed, block.clipped) * weights
            sets = channel_count
        grams = []
        for g in range(sets):
            others = [per_channel(c, sets)[g] for i, c in enumerate(at_a) if i != lobe]
            curve = [per_channel(c[lobe], sets)[g] for c in (at_a, slope_a, at_b, slope_b)]
            seen = observed if sets < channel_count else observed[g : g + 1]
            rows = jnp.stack([*others, *_chord(curve, b - a), curve[2], *seen])
            weighed = rows * weights[min(g, len(weights) - 1)][None]
            grams.append(jnp.matmul(weighed, rows.T, precision=lax.Precision.HIGHEST))
        # One matrix a channel, whose last row is what that channel saw
        m = len(at_a) + 4
        taken = np.tile(np.arange(m), (channel_count, 1))
        if sets < channel_count:
            taken[:, -1] += np.arange(channel_count)
        of_set = np.minimum(np.arange(channel_count), sets - 1)
        return jnp.stack(grams)[of_set[:, None, None], taken[:, :, None], taken[:, None, :]]

    each = (sum_over_blocks(group, of_block, jnp.int32(BLOCKS)) for group in problem.groups)
    total = [jnp.sum(of_images, axis=0) for of_images in each]
    return sum(total[1:], total[0])


def _chord(curve: list[Float[Array, "P"]], width: Float[Array, ""]) -> tuple[Array, Array, Array]:
    """M, D and g / 2: the middle of what a convex function may be, its run, and half its gap.

    `curve` is S and dS/dn at a, and the same at b.
    """
    at_a, slope_a, at_b, slope_b = curve
    rise = at_b - at_a
    before, after = guard.positive(rise - slope_a * width), guard.positive(slope_b * width - rise)
    half_gap = before * (after * guard.reciprocal(before + after)) / 2
    return (at_a + at_b) / 2 - half_gap, rise / 2, half_gap


def _of_channel(
    gram: Float[Array, "m m"],
    lower: Float[Array, "p"],
    upper: Float[Array, "p"],
    threshold: Float[Array, ""],
    rounding: _Rounding,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """`Bounded.below` and `.above` of one channel; its rows are [K, M, D, g/2, S(b), y]."""
    p = len(lower)
    inner, moment, square = gram[: p + 1, : p + 1], gram[: p + 1, -1], gram[-1, -1]
    norms = jnp.sqrt(jnp.diagonal(gram))
    h, end_norm, y = norms[p + 1 :]

    # Nothing here is negative, so each k_i |A_i| is no more than |A k| <= |y| + threshold.
    least = jnp.append(norms[: p - 1], end_norm)
    most = (y + threshold) * (1 + 1e-6) / jnp.where(least > 0, least, 1)
    top = jnp.minimum(upper, jnp.where(least > 0, most, jnp.inf))
    # no less than |y| and all |x_i A_i| together
    reach = y + jnp.sum(_product(top, jnp.append(norms[: p - 1], norms[p - 1] + norms[p] + h)))

    def plane(x: Float[Array, "m"]) -> tuple[Array, Array, Array]:
        """The lowest that the plane through x is over the box, rho, and what is left at n = a."""
        along, onto = moment - inner @ x, square - moment @ x
        size = y + jnp.abs(x) @ norms[: p + 1]
        error = rounding.sum * size
        rho = jnp.sqrt(jnp.maximum(onto - x @ along, 0) + error * size)
        slope = along / rho
        # d between -ks and ks takes the side that is lower
        steep = jnp.append(slope[: p - 1], slope[p - 1] + jnp.abs(slope[p]) + h)
        fall = jnp.maximum(_product(top, steep), lower * steep)
        lost = (error / rho + 8 * rounding.column) * reach
        above = rho + x[p - 1] * h + 8 * rounding.column * size
        return onto / rho - jnp.sum(fall) - lost, rho, above

    # Of what d may be, a side of the triangle it lies in with ks, n = a or n = b; or any number
    ks, d = jnp.eye(p + 1)[p - 1 :]
    sides = [jnp.diag(1 - d) + side * jnp.outer(d, ks) for side in (-1, 1)]
    faces = jnp.stack([*sides, jnp.eye(p + 1)])
    low, high = jnp.append(lower, -jnp.inf), jnp.append(top, jnp.inf)

    def from_face(face: Float[Array, "m m"]) -> tuple[Array, Array]:
        """The best of the planes through least squares on a face, and what is left at n = a."""

        def touch(weight: Array, _: None) -> tuple[Array, tuple[Array, Array]]:
            side = (moment + weight * h * ks) @ face
            solved = bounded_least_squares(face.T @ inner @ face, side, low, high)[0]
            lowest, rho, above = plane(face @ solved)
            return rho, (lowest, above)

        lowest, left = lax.scan(touch, jnp.zeros(()), length=TOUCHES)[1]
        return jnp.max(jnp.where(lowest > 0, lowest, 0)), left[0]

    below, above = jax.vmap(from_face)(faces)
    impossible = jnp.any(lower > top)
    return (
        jnp.where(impossible, jnp.inf, jnp.max(below)),
        jnp.where(impossible, jnp.inf, above[0]),
    )


def _product(edge: Float[Array, "p"], size: Float[Array, "p"]) -> Float[Array, "p"]:
    """edge * size, and 0 where size is, even of an edge without end."""
    return jnp.where(size == 0, 0, edge * jnp.where(size == 0, 0, size))
