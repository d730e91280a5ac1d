"""The last steps, on all pixels and in float64: from a minimum of a sample to that of everything.

The sums over all pixels come page by page, and what is left of them is small: Gauss and Newton's steps
under the bounds, damped only where one went uphill (Levenberg and Marquardt). One is enough where the
sample told almost all, as it does where there is no noise. Weights and gains that follow the solution are
taken anew at each step, and folded into it.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from fitting.basins import Box
from fitting.linear import damped_step
from fitting.observed import Observed
from fitting.outliers import noise
from fitting.pages import Sums
from fitting.project import Linearised, Problem, linearise, raw_square
from fitting.weights import Judge, Weighting, is_robust

__all__ = ["Minimum", "polish"]

Unknowns = Float[np.ndarray, "q"]
Linear = Float[np.ndarray, "C p"]

MAX_STEPS = 64
MIN_ROUNDS, MAX_ROUNDS = 5, 60
"""Of weights and gains that follow the solution."""
SLIGHT = 0.01
"""Of a standard error: a step that is no longer matters to nobody."""
TRUSTED = 0.1
"""A step of y: a longer one may lead astray however slight it is, and is judged by where it led."""
UPHILL = 2.0
"""Times what is left at the best: weights that follow may change it so much."""
LEAST_STEP = 0.2
"""The share of a step that is taken at the least, however far it would overshoot."""
SHORT = {np.dtype(np.float32): 3e-4, np.dtype(np.float64): 3e-6}
"""A step of y: what is left after it is its square, which is nothing in either precision."""


@dataclass(frozen=True, eq=False)
class Minimum:
    """The minimum over all pixels: u and k, and the fit around it, with what depends on what.

    `cost` is what is left of the `square` of all that was observed, `image_cost` and `squares` those
    of each image in the order of the stacks; `image_pull` is J'r of each in k and y, whose sum is 0
    where no bound is in the way. `nearest` and `farthest` are the distances of lit points
    from point lights with an attenuation; `brightest` is the largest observation.
    """

    problem: Problem
    u: Unknowns
    k: Linear
    at: Linearised
    image_cost: Float[np.ndarray, "K"]
    image_pull: Float[np.ndarray, "K n"]
    squares: Float[np.ndarray, "K"]
    nearest: float
    farthest: float
    brightest: float
    steps: int
    converged: bool
    judge: Judge | None = None
    gains: Float[np.ndarray, "K"] | None = None

    @property
    def cost(self) -> float:
        """What is left of all images."""
        return float(self.image_cost.sum())

    @property
    def robust_noise(self) -> float | None:
        """The noise beside the outliers, where these lost their weight."""
        judge = self.judge
        return float(judge.scale) if judge is not None and is_robust(judge.weighting) else None

    def left(self, observations: int) -> float:
        """What is left, by which minima compare; infinite where that is no number.

        Where each has outliers of its own it is the noise beside them that tells.
        """
        noise = self.robust_noise
        left = self.cost if noise is None else observations * noise**2
        return left if np.isfinite(left) else np.inf

    @property
    def square(self) -> float:
        """|I|^2 of all that was observed."""
        return float(self.squares.sum())


class _Place(NamedTuple):
    """Where all pixels were summed, and what they said there."""

    problem: Problem
    u: Unknowns
    k: Linear
    sums: Sums
    at: Linearised

    def after(self, dy: Float[np.ndarray, "m"], box: Box) -> tuple[Unknowns, Linear]:
        """u and k after a step of y."""
        model = self.problem.model
        u = np.clip(model.whole(model.coordinates(self.u) + dy), *box)
        k = self.at.k + self.at.slope @ dy
        return u, np.clip(k, self.problem.lower, self.problem.upper)

    def before_bounds(self, dy: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m"]:
        """The step, cut where a free linear coefficient meets its bound: beyond, its slope is another."""
        k, change = self.at.k, self.at.slope @ dy
        moving = change != 0
        room = np.where(change > 0, self.problem.upper - k, self.problem.lower - k)
        shares = np.divide(room, change, out=np.ones_like(change), where=moving)
        return dy * np.clip(np.min(shares, initial=1), 0, 1)

    def image_cost(self, u: Unknowns, k: Linear) -> Float[np.ndarray, "K"]:
        """What is left of each image at u and k near by: the squares of a linear model's residuals."""
        change = self._change(u, k)
        return np.maximum(np.einsum("ci,kcij,cj->k", change, self.sums.each, change), 0)

    def image_pull(self, u: Unknowns, k: Linear) -> Float[np.ndarray, "K n"]:
        """J'r of each image, in k and then in y: minus half the gradient of what is left of it."""
        pull = np.einsum("kcij,cj->kci", self.sums.each, self._change(u, k))[..., :-1]
        p = k.shape[1]
        of_y = self.problem.model.pushed(pull[..., p:].sum(axis=1))
        return np.concatenate([pull[..., :p].reshape(len(pull), -1), of_y], axis=1)

    def _change(self, u: Unknowns, k: Linear) -> Float[np.ndarray, "C n"]:
        """By which the rows [A, dA/du k, r] make the residual at u and k."""
        change = np.ones((len(k), self.sums.each.shape[-1]))
        change[:, : k.shape[1]], change[:, k.shape[1] : -1] = self.k - k, self.u - u
        return change


class _Taken(NamedTuple):
    """A step that was asked for, what was taken of it, and by which coordinates."""

    dependent: Any
    asked: Float[np.ndarray, "m"]
    taken: Float[np.ndarray, "m"]


def polish(
    problem: Problem,
    observed: Observed,
    box: Box,
    u: Unknowns,
    k: Linear,
    weighting: Weighting | None = None,
    gains: Float[np.ndarray, "K"] | None = None,
) -> Minimum:
    """From u and k to the minimum near them, under weights and with gains where they are asked for."""
    follows = weighting is not None or gains is not None
    judge = None if weighting is None else Judge(weighting, u, k, np.ones(()), np.zeros(()))
    robust = is_robust(weighting)  # each round has its own scale
    slack = UPHILL if follows else 1 + 1e-12
    best: _Place | None = None
    damping, last = 0.0, False
    taken: _Taken | None = None
    for step in range(MAX_ROUNDS if follows else MAX_STEPS):
        here = _summed(problem, observed, u, k, gains, judge)
        if best is None or robust or here.at.cost <= best.at.cost * slack:
            best, damping = here, damping / 10
        else:
            damping = max(10 * damping, 1e-3)
        dy = _step(best, observed, box, damping)
        last = _is_last(best, observed, dy) and (not follows or step >= MIN_ROUNDS)
        if follows:
            dy, taken = _relaxed(best, dy, taken)
        if last and np.any(np.abs(dy) > SHORT[observed.dtype]):
            dy = best.before_bounds(dy)
        u, k = best.after(dy, box)
        if gains is not None:
            assert best.at.gains is not None
            last &= bool(np.max(np.abs(best.at.gains.best - gains)) <= SHORT[observed.dtype])
            gains = np.asarray(best.at.gains.best)
        if judge is not None:
            judge = _judged(judge, best.problem, observed, u, k, gains)
        if last:
            break
    assert best is not None
    left, sums = best.image_cost(u, k), best.sums
    return Minimum(
        problem=best.problem,
        u=u,
        k=k,
        at=best.at,
        image_cost=left,
        image_pull=best.image_pull(u, k),
        squares=sums.squares,
        nearest=sums.nearest,
        farthest=sums.farthest,
        brightest=sums.brightest,
        steps=step + 1,
        converged=last and bool(np.isfinite(left).all()),
        judge=judge,
        gains=gains,
    )


def _summed(
    problem: Problem,
    observed: Observed,
    u: Unknowns,
    k: Linear,
    gains: Float[np.ndarray, "K"] | None,
    judge: Judge | None,
) -> _Place:
    model = problem.model.depending_on(u)
    problem, u = replace(problem, model=model), model.whole(model.coordinates(u))
    sums = observed.pages.grams(model, u, k, gains, judge)
    return _Place(problem, u, k, sums, linearise(problem, sums.each, k, gains))


def _alive(at: Linearised, observed: Observed) -> np.ndarray:
    """The coordinates that the data tell by more than their own rounding."""
    rounding = 30 * max(float(np.finfo(np.float64).eps), float(np.finfo(observed.dtype).eps) ** 2)
    return np.flatnonzero(np.diagonal(at.hessian) > rounding * raw_square(at))


def _step(place: _Place, observed: Observed, box: Box, damping: float) -> Float[np.ndarray, "m"]:
    """To the minimum of the model around a place, within the box."""
    alive, model = _alive(place.at, observed), place.problem.model
    y, lower, upper = (model.coordinates(x)[alive] for x in (place.u, *box))
    dy = np.zeros_like(place.at.gradient)
    hessian = place.at.hessian[np.ix_(alive, alive)]
    dy[alive] = damped_step(hessian, place.at.gradient[alive], damping, lower - y, upper - y)
    return dy


def _is_last(place: _Place, observed: Observed, dy: Float[np.ndarray, "m"]) -> bool:
    """Whether a step is so short, absolutely or beside its standard error, that none need follow."""
    alive = _alive(place.at, observed)
    hessian = place.at.hessian[np.ix_(alive, alive)]
    unit = 1 / np.sqrt(np.diagonal(hessian))
    variance = np.diagonal(np.linalg.pinv(hessian * np.outer(unit, unit), hermitian=True)) * unit**2
    noise = float(place.at.cost) / max(observed.count, 1)
    slight = np.minimum(SLIGHT * np.sqrt(np.maximum(variance, 0) * noise), TRUSTED)
    enough = np.maximum(SHORT[observed.dtype], slight)
    return bool(np.all(np.abs(dy[alive]) <= enough))


def _relaxed(
    place: _Place, dy: Float[np.ndarray, "m"], last: _Taken | None
) -> tuple[Float[np.ndarray, "m"], _Taken]:
    """The step, shortened where it goes back and forth: weights that follow it overshoot.

    How much the step asked for has changed along the last one says where none would be asked for.
    """
    unit, share = np.sqrt(np.maximum(np.diagonal(place.at.hessian), 0)), 1.0
    if last is not None and last.dependent == place.problem.model.dependent:
        along = last.taken * unit
        change = ((dy - last.asked) * unit) @ along
        share = float(np.clip(-(along @ along) / change, LEAST_STEP, 1)) if change < 0 else 1.0
    return share * dy, _Taken(place.problem.model.dependent, dy, share * dy)


def _judged(
    judge: Judge,
    problem: Problem,
    observed: Observed,
    u: Unknowns,
    k: Linear,
    gains: Float[np.ndarray, "K"] | None,
) -> Judge:
    """A judge at u and k, who knows the noise there."""
    scale = judge.scale
    if is_robust(judge.weighting):
        with jax.enable_x64(True):
            scale = np.asarray(noise(problem.model, observed.sample, judge.weighting, u, k, gains))
    return Judge(judge.weighting, u, k, scale, judge.round + 1)
