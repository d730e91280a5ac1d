"""Whether the minimum that was found is global: a proof, or the reason why there is none.

With one shininess left to search the residual is a function of one variable. Its whole range is cut
into intervals; each is bounded from below (`lower_bound`) and cut again where the bound does not tell
enough, until no interval can hold anything better: branch and bound (Land and Doig 1960).
"""

from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float

from diffshade.errors import BadInput
from diffshade.light.environment import EnvironmentLight
from fitting.lower_bound import bound
from fitting.observed import Observed
from fitting.polish import Minimum

__all__ = ["Certificate", "certify"]

BATCH = 16
"""Intervals that are bounded in one pass over the data."""
SHARP = 1 / 8
"""An end of the interval is known to this share of its length."""

Pieces = Float[np.ndarray, "_ 2"]


@dataclass(frozen=True)
class Certificate:
    """Whether no shininess within its bounds leaves less than the one found, and which come near.

    `proven`: at every shininess, with the best linear coefficients within their bounds, the relative
    residual is no less than at the one that was found, less `tolerance`. Outside of `interval` it is
    more than at the one found by `tolerance`: this is proven too, and the interval a little longer
    than it need be. It is None where nothing was bounded. `evaluations` counts intervals of shininess
    that were bounded; `reason` says in words what is proven, or why nothing is.

    The residual is the one that was minimised: weighted as in the fit, and relative to the norm of
    what was observed, weighted alike. Rounding is counted: what is proven is proven of the data as they
    lie in memory. `shininess` is the range that all this is about: the bounds of the search.
    """

    proven: bool
    tolerance: float
    shininess: tuple[float, float] | None
    interval: tuple[float, float] | None
    evaluations: int
    reason: str


def certify(
    observed: Observed,
    minimum: Minimum,
    box: tuple[Float[np.ndarray, "q"], Float[np.ndarray, "q"]],
    *,
    tolerance: float = 1e-4,
    most_evaluations: int = 1024,
) -> Certificate:
    """Prove that the minimum over u in its box is global, or say that it is not proven.

    `tolerance` is in units of the relative residual; below about 1e-5 rounding leaves no proof of an
    exact fit. After `most_evaluations` intervals the search ends without one. All is summed in
    float64 whatever the fit ran in, block by block: no memory a pixel. Raises `BadInput` for a
    tolerance that is not above 0.
    """
    if not tolerance > 0:
        raise BadInput(f"tolerance is {tolerance!r}: give a number above 0, as 1e-4")
    reason = _beyond(observed, minimum)
    if reason:
        return Certificate(False, tolerance, None, None, 0, reason)
    if not minimum.problem.model.searched:
        reason = "No shape is searched, and all else is linear."
        return Certificate(True, tolerance, None, None, 0, reason)
    return _Proof(observed, minimum, box, tolerance, most_evaluations).certificate()


def _beyond(observed: Observed, minimum: Minimum) -> str | None:
    """What a proof does not reach, in words."""
    problem = minimum.problem
    model = problem.model
    if model.direction_count > len(model.searched):
        return "The attenuation is searched as well."
    if minimum.gains is not None:
        return "The gains of the lights are searched as well."
    if len(model.searched) > 1:
        return f"{len(model.searched)} shapes are searched: {', '.join(n for n, *_ in model.searched)}."
    if not np.isfinite(minimum.u).all():
        return "No minimum was found."
    for name in (name for names in model.searched for name in names):
        falls = name.startswith("specular.") and name.endswith(".shininess")
        if not falls or not model.material.specular[int(name.split(".")[1])].convex:
            return f"What the images show does not fall convexly with {name}."
    if (problem.lower < 0).any():
        return "A linear coefficient may be negative: bound it by 0 from below."
    scenes = [photograph.scene for photograph in observed.photographs]
    lights = [light for scene in scenes for light in scene.lights]
    if any(isinstance(light, EnvironmentLight) for light in lights):
        return "What a lobe mirrors of an environment does not fall convexly with its shininess."
    factors = (
        (model.material.od, model.material.os),
        [scene.ambient for scene in scenes],
        [(light.intensity, light.visible, getattr(light, "attenuation", None)) for light in lights],
    )
    if any((np.asarray(factor) < 0).any() for factor in jax.tree.leaves(factors)):
        return "A light or an object colour is negative."
    return None


class _Proof:
    """The intervals of log n, sorted into what is still open and what may come near the minimum."""

    def __init__(
        self,
        observed: Observed,
        minimum: Minimum,
        box: tuple[Float[np.ndarray, "q"], Float[np.ndarray, "q"]],
        tolerance: float,
        most: int,
    ) -> None:
        self.observed, self.minimum = observed, minimum
        self.tolerance, self.most = tolerance, most
        self.box = float(box[0][0]), float(box[1][0])
        self.u = minimum.u
        self.evaluations = 1
        at_found = np.exp(np.full((BATCH, 2), self.u[0]))
        here = bound(observed, minimum, at_found, np.inf)
        self.norm = float(here.norm)
        self.residual = float(here.above[0]) / (self.norm or 1.0)

    def certificate(self) -> Certificate:
        """Cut until nothing is open, or something better is found, or the evaluations are used up."""
        open_, near = _cut(np.array([self.box]), BATCH), np.empty((0, 2))
        while len(open_) and self.evaluations < self.most:
            below, above = self._bounded(open_)
            if (above < self.residual - self.tolerance).any():
                at = int(np.nanargmin(above))
                return self._certificate(
                    False,
                    np.concatenate([open_, near]),
                    f"Shininess {np.exp(open_[at, 0]):.4g} leaves a relative residual of"
                    f" {above[at]:.4g}, less than the {self.residual:.4g} at the one found.",
                )
            clear = below >= self.residual - self.tolerance
            near = np.concatenate([near, open_[clear & (below <= self._threshold)]])
            open_ = _cut(open_[~clear], BATCH)
        if len(open_):
            reason = f"Undecided after {self.evaluations} evaluations."
            return self._certificate(False, np.concatenate([open_, near]), reason)
        near = self._sharpened(near)
        low, high = self._ends(near)
        weights = ", at the weights of the solution" if self.minimum.judge is not None else ""
        return self._certificate(
            True,
            near,
            f"Only {low:.4g} to {high:.4g} may come within {self.tolerance:.2g} of the relative"
            f" residual {self.residual:.4g} that was found{weights}.",
        )

    def _sharpened(self, near: Pieces) -> Pieces:
        """The ends cut until they are short beside the whole."""
        while len(near) and self.evaluations < self.most:
            ends = np.isin(near, [near.min(), near.max()]).any(axis=1)
            long = ends & (np.ptp(near, axis=1) > SHARP * np.ptp(near))
            if not long.any():
                break
            pieces = _cut(near[long], BATCH)
            below, _ = self._bounded(pieces)
            near = np.concatenate([near[~long], pieces[~(below > self._threshold)]])
        return near

    @property
    def _threshold(self) -> float:
        return self.residual + self.tolerance

    def _bounded(self, pieces: Pieces) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the relative residual: of no more than it is in each piece, and at its start."""
        self.evaluations += len(pieces)
        threshold = self._threshold * self.norm
        rounds = []
        for first in range(0, len(pieces), BATCH):
            some = pieces[first : first + BATCH]
            filled = np.concatenate([some, np.repeat(some[-1:], BATCH - len(some), axis=0)])
            bounded = bound(self.observed, self.minimum, np.exp(filled), threshold)
            rounds.append(np.stack([bounded.below, bounded.above])[:, : len(some)])
        below, above = np.concatenate(rounds, axis=1) / (self.norm or 1.0)
        return below, above

    def _certificate(self, proven: bool, near: Pieces, reason: str) -> Certificate:
        range_ = float(np.exp(self.box[0])), float(np.exp(self.box[1]))
        ends = self._ends(near)
        return Certificate(proven, self.tolerance, range_, ends, self.evaluations, reason)

    def _ends(self, near: Pieces) -> tuple[float, float]:
        """The least and the largest shininess of all of them, and of the one found."""
        u = np.append(near, self.u[0])
        return float(np.exp(u.min())), float(np.exp(u.max()))


def _cut(pieces: Pieces, count: int) -> Pieces:
    """Each in two, or in as many as fill a batch."""
    if not len(pieces):
        return pieces
    parts = max(2, count // len(pieces))
    edges = np.linspace(pieces[:, 0], pieces[:, 1], parts + 1, axis=1)
    return np.stack([edges[:, :-1], edges[:, 1:]], axis=-1).reshape(-1, 2)
