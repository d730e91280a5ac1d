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
from jaxtyping import Float

from diffshade import guard
from diffshade.channels import per_channel
from fitting.arrays import Array
from fitting.columns import Photo, photos, scenery
from fitting.linear import bounded_least_squares
from fitting.model import Model
from fitting.observation import Group
from fitting.observed import Observed
from fitting.polish import Minimum
from fitting.project import weights_of
from fitting.weights import Judge

__all__ = ["Bounded", "bound"]

EPS = float(np.finfo(np.float64).eps)
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

    sum: Float[Array, ""]
    column: Float[Array, ""]


def bound(
    observed: Observed,
    minimum: Minimum,
    intervals: Float[np.ndarray, "I 2"],
    threshold: float,
) -> Bounded:
    """The bounds over intervals of n of the one lobe that is searched; one pass over the data.

    The rest of u is known. Only coefficients that leave no more than `threshold` need be looked at.
    """
    problem, pages = minimum.problem, observed.pages
    column = _column(problem.model)
    grams, _ = pages.total(_grams, None, problem.model, minimum.u, intervals, minimum.judge)
    # The searched lobe's bounds last
    order = [*(i for i in range(problem.lower.shape[1]) if i != column), column]
    with jax.enable_x64(True):
        bounded = _bounded(
            np.sum(grams, axis=0),
            problem.lower[:, order],
            problem.upper[:, order],
            intervals[:, 1],
            np.asarray(threshold),
            np.asarray(4 * EPS * pages.additions),
        )
    return Bounded(*(np.asarray(x) for x in bounded))


def _column(model: Model) -> int:
    """The column of the lobe that is searched."""
    (column,) = model.reads
    return column


@jax.jit
def _bounded(
    grams: Float[Array, "I C m m"],
    lower: Float[Array, "C p"],
    upper: Float[Array, "C p"],
    ends: Float[Array, "I"],
    threshold: Float[Array, ""],
    summed: Float[Array, ""],
) -> Bounded:
    def of_interval(gram: Float[Array, "C m m"], b: Float[Array, ""]) -> tuple[Array, Array]:
        # exp(u), x^n and products: their errors grow with the exponent, which is at most 708.
        rounding = _Rounding(summed, EPS * (1e4 + 8 * b))
        of_channel = jax.vmap(_of_channel, (0, 0, 0, None, None))
        below, above = of_channel(gram, lower, upper, threshold, rounding)
        return jnp.linalg.norm(below), jnp.linalg.norm(above)

    below, above = jax.vmap(of_interval)(grams, ends)
    return Bounded(below, above, jnp.sqrt(jnp.sum(grams[0, :, -1, -1])))


def _grams(
    group: Group,
    gains: None,
    model: Model,
    u: Float[Array, "q"],
    intervals: Float[Array, "I 2"],
    judge: Judge | None,
) -> tuple[Float[Array, "K I C m m"], Float[Array, ""]]:
    """Of the rows [K, M, D, g/2, S(b), y] of every image, for each interval."""
    column, count = _column(model), model.channel_count

    def of_image(photo: Photo) -> Float[Array, "I C m m"]:
        at = scenery(photo, group.surface, model.material)
        weights = weights_of(model, at, judge)

        def of_interval(interval: Float[Array, "2"]) -> Float[Array, "C m m"]:
            def columns(n: Array) -> list[Float[Array, "C P"]]:
                found = model.columns(u.at[0].set(jnp.log(n)), at)
                return [jnp.stack(per_channel(planes, count)) for planes in found]

            one = jnp.ones(())
            (at_a, slope_a), (at_b, slope_b) = (jax.jvp(columns, (n,), (one,)) for n in interval)
            curve = [x[column] for x in (at_a, slope_a, at_b, slope_b)]
            others = [plane for i, plane in enumerate(at_a) if i != column]
            chord = _chord(curve, interval[1] - interval[0])
            rows = jnp.stack([*others, *chord, curve[2], photo.observed], axis=1)
            weighed = rows * weights[:, None]
            return jnp.einsum("cip,cjp->cij", weighed, rows, precision=lax.Precision.HIGHEST)

        return lax.map(of_interval, intervals)

    return lax.map(of_image, photos(group, gains)), jnp.zeros(())


def _chord(curve: list[Float[Array, "C P"]], width: Float[Array, ""]) -> tuple[Array, Array, Array]:
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
            solved, _ = bounded_least_squares(face.T @ inner @ face, side, low, high, nothing=0.0)
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
