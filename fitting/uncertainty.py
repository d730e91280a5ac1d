"""How far to trust each coefficient: its standard error, its interval, and with what it is correlated.

The covariance of the unknowns is sigma^2 I^-1 (Cramer and Rao), I the Gram matrix of all derivatives; a
function of them moves by its Jacobian. Directions without information are left out of I^-1, and make
infinite what depends on them.

Bounds: where an unknown rests on a bound, what the images say of it alone is a normal density whose peak
lies t standard deviations beyond the bound, of which only the half-line inside is allowed. Its mean
square distance from the bound, a share m(t) of the variance without the bound (m(0) = 1, m -> 2/t^2),
is the squared error of the estimate; the variance of everything that is correlated with it shrinks
accordingly, between that of the unknown free (t = 0) and of the unknown held (t large). To hold it
there outright would be too sure of the others where the truth lies just inside the bound: intervals
said to cover 95 % would cover 84 % at a correlation of 0.95. So they cover 95 to 97.5 %.

Where the model is not the whole truth (dirt, a lobe of another shape, normals a little off) the residual
is no noise: pixels err together, and more of them help no more. Several images tell: where they disagree
about a number by more than twice what noise would explain, its error is the one by which they disagree.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import erfc, exp, pi, sqrt
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from fitting.intervals import NORMAL, bounded_interval, quantile
from fitting.null_space import Spectrum, spectrum
from fitting.project import Gains
from fitting.shapes import is_shape

__all__ = ["Uncertainty", "propagate"]

ByName = dict[str, np.ndarray]
Report = Callable[
    [Float[np.ndarray, "*n C p"], Float[np.ndarray, "*n m"]], Mapping[str, np.ndarray]
]
Interval = tuple[np.ndarray, np.ndarray]

FEWEST_IMAGES, DISAGREE = 4, 2.0
"""Images that can be compared; and the ratio to what noise explains from which on they disagree."""
ALONE = 0.9
"""The share of a number's movement from which on one unknown is as good as all."""
INFINITE = np.array([[-np.inf], [np.inf]])
STEP, LEAST = 2.0**-17, 1e-3
"""By which an unknown is moved for a derivative: of it, or of this where it is less."""


@runtime_checkable
class Minimum(Protocol):
    """What is needed of a `fitting.project.Linearised`: k, the cost, and Gram matrices of [A, J, r]."""

    k: Any  # [C, p]
    cost: Any
    information: Any  # [C, p + q + 1, p + q + 1]


@dataclass(frozen=True)
class Uncertainty:
    """How well each reported number is known; all by name, in the shapes of the coefficients.

    `standard_errors` are infinite where the images do not tell; `intervals` are those of 95 %, lower
    and upper end. `unit_errors` are the Cramer-Rao errors for noise of standard deviation 1, bounds
    left aside. `noise` is the standard deviation of the residual with `degrees` degrees of freedom,
    or what was given.

    Over all m numbers in a row, name after name: `covariance` [m, m], and `unit_root` [m, r], of which
    R R' is the covariance for noise 1, bounds left aside; both without the directions that the images
    do not tell. Those are the columns of `blind` [m, d]: how the numbers move along each. `reach` [m] is
    how far a number moves with a change of the images of norm 1, if it were the only one to move.
    """

    values: ByName
    standard_errors: ByName
    intervals: dict[str, Interval]
    unit_errors: ByName
    covariance: Float[np.ndarray, "m m"]
    unit_root: Float[np.ndarray, "m r"]
    blind: Float[np.ndarray, "m d"]
    reach: Float[np.ndarray, "m"]
    noise: float
    degrees: float

    @cached_property
    def numbers(self) -> tuple[str, ...]:
        """The name of each number: "kd[0]", "kd[1]", "specular.0.shininess"."""
        return tuple(
            name + (f"[{','.join(map(str, at))}]" if at else "")
            for name, value in self.values.items()
            for at in np.ndindex(value.shape)
        )

    @cached_property
    def correlations(self) -> Float[np.ndarray, "m m"]:
        """Of all numbers [m, m], in the order of `numbers`; NaN where the images do not tell one."""
        error = np.sqrt(np.diagonal(self.covariance))
        inverse = np.where(error > 0, 1 / np.where(error > 0, error, 1), 0)
        correlations = self.covariance * np.outer(inverse, inverse)
        np.fill_diagonal(correlations, 1.0)
        told = np.isfinite(np.concatenate([e.ravel() for e in self.standard_errors.values()]))
        return np.where(np.outer(told, told), np.clip(correlations, -1, 1), np.nan)


def propagate(
    at: Minimum,
    y: Float[np.ndarray, "m"],
    known: Bool[np.ndarray, "n"],
    observations: int,
    report: Report,
    *,
    bounds: tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]] | None = None,
    noise: float | None = None,
    gains: Gains | None = None,
    rounding: float | None = None,
    image_pull: Float[np.ndarray, "K n"] | None = None,
    ranges: Mapping[str, Interval] | None = None,
) -> Uncertainty:
    """From the information matrix at the minimum to the errors of `report(k, y)`.

    `known` marks, of k (channel after channel) and then of y, what is held; `bounds` are the lower
    and upper bounds of the same, infinite where there is none. `noise` is the standard deviation of
    an observation, by default that of the residual, sqrt(cost / degrees of freedom), whose own error
    the intervals allow for by Student's t. `gains`, where they are unknown too, are eliminated.
    `rounding` is that of what was observed, by default that of k. `image_pull` is J'r of each image,
    by which `_scatter` judges. `ranges` are the lowest and the highest value that a reported number can
    have, by name, where there is one: what is made of several unknowns, as a share of a sum, has none of
    their bounds, and its normal estimate is cut off there like that of an unknown at its own.

    `report` gives named arrays, of many k and y at once where these have leading axes. What
    shapes a lobe or a body has its interval on the logarithm, on which its estimate is nearer to normal.
    """
    values, rows = _derivatives(report, at.k.astype(float), y.astype(float))
    position = np.append(at.k.ravel(), y).astype(float)
    information, gradient = _assemble(np.asarray(at.information, np.float64), at.k.shape[1])
    if gains is not None:
        information = information - _told_by_gains(gains, at.k.shape[1])
    eps = float(np.finfo(at.k.dtype).eps) if rounding is None else rounding
    found = spectrum(information, ~known, eps)

    lower, upper = (np.full_like(position, edge) for edge in (-np.inf, np.inf))
    if bounds is not None:
        lower, upper = (np.asarray(edge, np.float64) for edge in bounds)
    side = np.where(position <= lower, -1, np.where(position >= upper, 1, 0))
    side = np.where(known | _is_blind(np.eye(len(known)), found), 0, side)

    degrees = float(max(observations - found.root.shape[1] + np.count_nonzero(side), 1))
    sigma = sqrt(max(float(at.cost), 0.0) / degrees) if noise is None else float(noise)
    covariance = found.root @ found.root.T
    bounded, pushed = _at_bounds(covariance, gradient * side, side != 0, sigma)

    unit_root = rows @ found.root
    unit_error = np.linalg.norm(unit_root, axis=1)
    blind = _is_blind(rows, found)
    estimate = np.concatenate([np.ravel(value) for value in values.values()])
    reported = rows @ bounded @ rows.T * sigma**2
    error = np.sqrt(np.maximum(np.diagonal(reported), 0))
    reach = np.full(len(error), quantile(degrees) if noise is None else NORMAL)
    if image_pull is not None and len(image_pull) >= FEWEST_IMAGES:
        scatter, explained = _scatter(rows @ covariance, image_pull), sigma * unit_error
        apart = ~blind & (explained > 0) & (scatter > DISAGREE * explained)
        apart &= ~_rests(rows, covariance, side != 0)
        wider = np.where(apart, scatter / np.where(apart, explained, 1), 1)
        reported, error = reported * np.outer(wider, wider), error * wider
        reach = np.where(apart, quantile(len(image_pull) - 1.0), reach)

    logarithmic = np.concatenate(
        [np.full(value.size, is_shape(name)) for name, value in values.items()]
    )
    unit = np.where(logarithmic, estimate, 1.0)
    offsets = _offsets(
        rows / unit[:, None],
        np.where(blind, np.inf, error / unit),
        np.where(known, np.nan, np.sqrt(np.diagonal(covariance))),
        (lower - position, upper - position),
        pushed,
        reach,
        _within(values, ranges or {}),
    )
    with np.errstate(over="ignore"):  # no number is too large for an end of a hopeless interval
        intervals = [
            np.where(logarithmic, estimate * np.exp(np.where(logarithmic, end, 0)), estimate + end)
            for end in offsets
        ]

    def by_name(numbers: np.ndarray) -> ByName:
        parts = np.split(numbers, np.cumsum([value.size for value in values.values()])[:-1])
        return {
            name: part.reshape(value.shape)
            for part, (name, value) in zip(parts, values.items(), strict=True)
        }

    ends_by_name = [by_name(end) for end in intervals]
    return Uncertainty(
        values=values,
        standard_errors=by_name(np.where(blind, np.inf, error)),
        intervals={name: (ends_by_name[0][name], ends_by_name[1][name]) for name in values},
        unit_errors=by_name(np.where(blind, np.inf, unit_error)),
        covariance=reported,
        unit_root=unit_root,
        blind=rows @ (found.null / found.scale[:, None]),
        reach=np.linalg.norm(rows / found.scale, axis=1),
        noise=sigma,
        degrees=degrees,
    )


def _scatter(
    influence: Float[np.ndarray, "m n"], pull: Float[np.ndarray, "K n"]
) -> Float[np.ndarray, "m"]:
    """The errors that the images themselves show: how far apart each would move a number.

    One counts as one observation of all, whatever its pixels have in common (Liang and Zeger 1986).
    Bounds are left aside.
    """
    count = len(pull)
    apart = np.linalg.norm(influence @ (pull - pull.mean(axis=0)).T, axis=1)
    return apart * sqrt(count / (count - 1))


def _rests(
    rows: Float[np.ndarray, "m n"],
    covariance: Float[np.ndarray, "n n"],
    active: Bool[np.ndarray, "n"],
) -> Bool[np.ndarray, "m"]:
    """Which numbers move almost only with unknowns that rest on a bound."""
    parts = np.abs(rows) * np.sqrt(np.diagonal(covariance))
    return parts[:, active].sum(axis=1) > ALONE * parts.sum(axis=1)


def _derivatives(
    report: Report, k: Float[np.ndarray, "C p"], y: Float[np.ndarray, "m"]
) -> tuple[ByName, Float[np.ndarray, "r n"]]:
    """What is reported, by name in order, and how all numbers move with k and y: central differences."""
    at = np.append(k.ravel(), y)
    # Powers of two, so that a number that is an unknown itself moves by exactly as much
    step = STEP * 2.0 ** np.ceil(np.log2(np.maximum(np.abs(at), LEAST)))
    points = at + np.concatenate([np.zeros((1, at.size)), np.diag(step), -np.diag(step)])
    found = report(points[:, : k.size].reshape(-1, *k.shape), points[:, k.size :])
    found = {name: found[name] for name in sorted(found)}
    values = {name: np.asarray(value[0]) for name, value in found.items()}
    rows = np.concatenate([x.reshape(len(points), -1) for x in found.values()], axis=1)[1:]
    ahead, behind = np.split(rows, 2)
    return values, ((ahead - behind) / (2 * step[:, None])).T


def _assemble(
    grams: Float[np.ndarray, "C s s"], p: int
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n"]]:
    """One matrix over all unknowns, the channels' k and the u that they share; and all J'r."""
    c, s, _ = grams.shape
    k, n = c * p, c * p + s - 1 - p
    information = np.zeros((n, n))
    for channel, gram in enumerate(grams):
        own = slice(channel * p, (channel + 1) * p)
        information[own, own] = gram[:p, :p]
        information[own, k:] = gram[:p, p:-1]
        information[k:, own] = gram[p:-1, :p]
    information[k:, k:] = grams[:, p:-1, p:-1].sum(axis=0)
    return information, np.concatenate([grams[:, :p, -1].ravel(), grams[:, p:-1, -1].sum(axis=0)])


def _told_by_gains(gains: Gains, p: int) -> Float[np.ndarray, "n n"]:
    """What unknown gains take from the information: they are eliminated, their mean kept at 1.

    With S = diag(square) and V the crossed products this is V'S^-1 V - s s'/(1'S^-1 1), s = V'S^-1 1.
    """
    crossed, square = (np.asarray(x, np.float64) for x in (gains.crossed, gains.square))
    v = np.concatenate(
        [crossed[:, :, :p].reshape(len(square), -1), crossed[:, :, p:].sum(axis=1)], axis=1
    )
    lit = square > 0
    v, inverse = v[lit], 1 / square[lit]
    common = inverse @ v
    return (v.T * inverse) @ v - np.outer(common, common) / max(inverse.sum(), 1e-300)


def _at_bounds(
    covariance: Float[np.ndarray, "n n"],
    outward: Float[np.ndarray, "n"],
    active: Bool[np.ndarray, "n"],
    sigma: float,
) -> tuple[Float[np.ndarray, "n n"], dict[int, tuple[float, float]]]:
    """The covariance for noise 1 under active bounds; and by unknown what pushes it, and its deviation.

    `outward` is the derivative of the fit towards the bound. The push is t of the module's text,
    the deviation that of the likelihood of this unknown with the others at their bounds.
    """
    at = np.flatnonzero(active)
    if not at.size:
        return covariance, {}
    own = np.sqrt(np.diagonal(covariance)[at])
    correlation = covariance[np.ix_(at, at)] / np.outer(own, own)
    deviation = own / np.sqrt(np.diagonal(np.linalg.pinv(correlation, hermitian=True)))
    push = np.maximum(outward[at], 0) * deviation
    beyond = push / sigma if sigma > 0 else np.where(push > 0, np.inf, 0.0)
    bounded = covariance.copy()
    for index, t in zip(at, beyond, strict=True):
        column = bounded[:, index].copy()
        if column[index] > 0:  # else those before it have fixed it
            bounded -= (1 - _mean_square(float(t))) * np.outer(column, column) / column[index]
    pushed = zip(beyond.tolist(), (sigma * deviation).tolist(), strict=True)
    return bounded, dict(zip(at.tolist(), pushed, strict=True))


def _mean_square(t: float) -> float:
    """E[a^2] of a normal variable of mean -t and variance 1, given that a >= 0."""
    if t > 20:  # far out the tail underflows, and what is left of the series is 37 / t^4
        return 2 / t**2 * (1 - 5 / t**2)
    hazard = sqrt(2 / pi) * exp(-t * t / 2) / erfc(t / sqrt(2))
    return 1 + t * t - t * hazard


def _is_blind(rows: Float[np.ndarray, "m n"], found: Spectrum) -> Bool[np.ndarray, "m"]:
    """Which numbers move along a direction that the images do not tell."""
    scaled = rows / found.scale
    size = np.linalg.norm(scaled, axis=1)
    along = np.abs(scaled @ found.null).max(axis=1, initial=0)
    return along > found.tolerance * np.maximum(size, 1e-300)


def _within(values: ByName, ranges: Mapping[str, Interval]) -> Float[np.ndarray, "2 m"]:
    """How far each number is from both ends of its own range; infinite where it has none."""
    ends = [
        np.broadcast_to(np.reshape(ranges[name], (2, -1)), (2, value.size)) - value.ravel()
        if name in ranges
        else np.broadcast_to(INFINITE, (2, value.size))
        for name, value in values.items()
    ]
    return np.concatenate(ends, axis=1)


def _offsets(
    rows: Float[np.ndarray, "m n"],
    error: Float[np.ndarray, "m"],
    spread: Float[np.ndarray, "n"],
    ends: tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]],
    pushed: Mapping[int, tuple[float, float]],
    reach: Float[np.ndarray, "m"],
    within: Float[np.ndarray, "2 m"],
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"]]:
    """Both ends of each number's interval, relative to its estimate: `reach` errors away from bounds.

    A number whose error comes almost all from one unknown has that unknown's bounds. `rows` are
    the derivatives of the numbers, `spread` the errors of the unknowns (NaN where known), `ends` their
    bounds relative to where they are, `pushed` what `_at_bounds` says of those that rest on one,
    `within` the numbers' own bounds, relative to the estimates.
    """
    blind = np.isinf(error)
    parts = np.abs(rows) * np.where(blind[:, None], ~np.isnan(spread), np.nan_to_num(spread))
    owner = parts.argmax(axis=1)
    alone = parts.max(axis=1) > ALONE * parts.sum(axis=1)
    slope = np.where(alone, rows[np.arange(len(rows)), owner], 1.0)
    lower, upper = np.where(alone, np.sort(np.stack(ends)[:, owner] * slope, axis=0), INFINITE)
    lower, upper = np.maximum(lower, within[0]), np.minimum(upper, within[1])
    # Of one at its bound: how many of its errors the bound keeps it from where it would be.
    beyond = np.full(len(rows), np.nan)
    for index, (push, deviation) in pushed.items():
        mine = alone & (owner == index) & ~blind
        beyond = np.where(mine, push, beyond)
        error = np.where(mine, deviation * np.abs(slope), error)

    low, high = -reach * error, reach * error
    told = (error > 0) & ~blind
    unit = np.where(told, reach / NORMAL * error, 1.0)
    for sign, bound, other in ((1, lower, upper), (-1, upper, lower)):
        nearer = told & np.isfinite(bound) & (np.abs(bound) <= np.abs(other))
        inside = np.where(nearer, np.abs(bound), 0) / unit
        x = np.where(np.isnan(beyond), inside, -beyond * NORMAL / reach)
        nearer &= x < 2 * NORMAL
        if nearer.any():
            near, far = (bound + sign * end * unit for end in bounded_interval(x))
            low = np.where(nearer, near if sign > 0 else far, low)
            high = np.where(nearer, far if sign > 0 else near, high)
    return np.maximum(low, np.minimum(lower, 0)), np.minimum(high, np.maximum(upper, 0))
