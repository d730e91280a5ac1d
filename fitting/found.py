"""What a fit found: coefficients with their errors, and everything that says how far to trust them."""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from diffshade.light.attenuation import AbstractAttenuation
from diffshade.light.point import PointLight
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from fitting.attempt import Attempt
from fitting.basins import APART
from fitting.certificate import Certificate
from fitting.degeneracies import Seen, highlight_depths
from fitting.distances import share_nearer
from fitting.identify import Unidentified, unidentified
from fitting.likelihood import Likelihood
from fitting.model import Model, sets_scale
from fitting.observed import Observed
from fitting.profile import Profile
from fitting.recovered import Recovery, clamped_within
from fitting.residual import Evaluation, ImageResidual, evaluation, measure, ratio
from fitting.suspects import SuspectImage, suspects
from fitting.uncertainty import Uncertainty, propagate

__all__ = ["Basin", "Correlations", "Fit"]

INDISTINGUISHABLE = 10.0
"""Of the noise's variance: a cost within so much of the best is no worse (likelihood ratio of e^-5)."""


@dataclass(frozen=True)
class Basin:
    """Another minimum: what was searched there by name, and what it leaves.

    `within_noise` says that the images cannot tell it from the one that was reported.
    """

    coefficients: Mapping[str, float]
    relative_residual: float
    within_noise: bool


@dataclass(frozen=True)
class Correlations:
    """Of the reported numbers, "kd[0]" for the first channel: a matrix; NaN where one is not told."""

    names: tuple[str, ...]
    matrix: Float[np.ndarray, "m m"]


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """What `fit` found. What takes time is computed when it is first asked for.

    `material` and `scene` are of the types that were given, a tuple of scenes where several were, or
    where each image has a gain.
    `coefficients` and `standard_errors` hold arrays by name: "ka", "kd", "specular.0.ks",
    "specular.0.shininess"; "attenuation.c0" and so on where an attenuation was fitted, and with a
    quadratic or a linear one what was measured first, "reference.l0" to "l2" and k f(d0) as
    "reference.kd", at the distance d0 = `reference_distance`, where 1/f(d) is in proportion to
    l0 + l1 d/d0 + l2 (d/d0)^2. Standard errors are infinite where the images do not tell;
    `unidentified` names what is not to be trusted, and why.
    `intervals` are those of 95 %, lower and upper end; `correlations` those of all numbers.
    `noise` is the standard deviation of an observation, or where a `SensorNoise` was given, of one in
    the dark. `relative_residual` is that of `evaluate`;
    beside it stands the `weighted_residual` of a fit that gave its observations weights. `basins`
    are other minima, `suspect_images` those that stand out. `gains` are the factors on the lights
    of each image, where they were asked for. `likelihood` is that of the images, with the number of
    free parameters and its `bic`, by which models compare (`compare`).
    """

    converged: bool
    steps: int
    relative_residual: float
    fraction_excluded: float
    per_image: tuple[ImageResidual, ...]
    likelihood: Likelihood
    weighted_residual: float | None
    gains: np.ndarray | None
    certificate: Certificate | None
    profiles: tuple[Profile, ...]
    reference_distance: float | None
    _best: Attempt = field(repr=False)
    _held: frozenset[str] = field(repr=False)
    _scenes: tuple[Scene, ...] = field(repr=False)
    _one_scene: bool = field(repr=False)
    _dtype: np.dtype = field(repr=False)
    _seen: Seen = field(repr=False)

    @staticmethod
    def of(
        best: Attempt,
        observed: Observed,
        held: frozenset[str],
        *,
        one_scene: bool,
        certificate: Certificate | None,
        profiles: tuple[Profile, ...],
    ) -> "Fit":
        """From the best minimum of all that was observed."""
        minimum, photographs = best.minimum, observed.photographs
        left, squares = observed.in_order(minimum.image_cost), observed.in_order(minimum.squares)
        shares = minimum.problem.model.gauge is not None and minimum.problem.model.gauge.has_shares
        plain = evaluation(photographs, left, squares)
        weighted = minimum.judge is not None
        found = Fit(
            converged=minimum.converged,
            steps=best.steps,
            relative_residual=plain.relative_residual,
            fraction_excluded=plain.fraction_excluded,
            per_image=plain.per_image,
            likelihood=best.likelihood,
            weighted_residual=ratio(left.sum(), squares.sum()) if weighted else None,
            gains=None if minimum.gains is None else observed.in_order(minimum.gains),
            certificate=certificate,
            profiles=profiles,
            reference_distance=observed.distance if shares else None,
            _best=best,
            _held=held,
            _scenes=tuple(photograph.scene for photograph in photographs),
            _one_scene=one_scene and minimum.gains is None,
            _dtype=observed.dtype,
            _seen=_seen(best, observed),
        )
        # Whatever weights it had, the figure is that of all unclipped pixels.
        return found._measured(found._measure(observed)) if weighted else found

    def _measure(self, observed: Observed) -> Evaluation:
        lit = zip(observed.photographs, self._lit, strict=True)
        return measure(self.material, [photo._replace(scene=scene) for photo, scene in lit])

    def _measured(self, figures: Evaluation) -> "Fit":
        return replace(
            self,
            relative_residual=figures.relative_residual,
            fraction_excluded=figures.fraction_excluded,
            per_image=figures.per_image,
        )

    def __repr__(self) -> str:
        numbers = {name: np.round(value, 6).tolist() for name, value in self.coefficients.items()}
        return (
            f"Fit({numbers}, relative_residual={self.relative_residual:.3g},"
            f" converged={self.converged})"
        )

    @cached_property
    def material(self) -> Material:
        """The recovered material."""
        minimum = self._best.minimum
        with self._precision():
            return self._recovery.material(minimum.k, minimum.u, self._dtype)

    @cached_property
    def scene(self) -> Any:
        """The scene, or all of them, with the recovered attenuation."""
        return self._lit[0] if self._one_scene else self._lit

    @cached_property
    def coefficients(self) -> Mapping[str, np.ndarray]:
        """Every coefficient by name, in float64."""
        minimum = self._best.minimum
        found = self._recovery.coefficients(minimum.k, minimum.u)
        return {name: np.asarray(found[name]) for name in sorted(found)}

    @property
    def standard_errors(self) -> Mapping[str, np.ndarray]:
        """The standard error of every coefficient that is not held."""
        return self._free(self._uncertainty.standard_errors)

    @property
    def intervals(self) -> Mapping[str, tuple[np.ndarray, np.ndarray]]:
        """Both ends of the 95 % interval of every coefficient that is not held."""
        return self._free(self._uncertainty.intervals)

    @cached_property
    def correlations(self) -> Correlations:
        """Of all numbers; of names that are one number the first."""
        tied = {n for names in self._best.minimum.problem.model.searched for n in names[1:]}
        names = self._uncertainty.numbers
        own = [i for i, name in enumerate(names) if name not in tied]
        matrix = self._uncertainty.correlations[np.ix_(own, own)]
        return Correlations(tuple(names[i] for i in own), matrix)

    @property
    def noise(self) -> float:
        """The standard deviation of an observation."""
        return self._uncertainty.noise

    @cached_property
    def unidentified(self) -> tuple[Unidentified, ...]:
        """What the images do not determine, and why."""
        minimum = self._best.minimum
        gauge = minimum.problem.model.gauge
        known = sets_scale(minimum.problem.model.material, self._held)
        count = 0 if self.gains is None or known else len(self.gains)
        gains = tuple(f"gain.{k}" for k in range(count))
        return unidentified(
            self._free(self._uncertainty.values),
            self._uncertainty,
            minimum.brightest,
            scaled=gauge is not None and gauge.floating,
            gains=gains,
            seen=self._seen,
        )

    @cached_property
    def basins(self) -> tuple[Basin, ...]:
        """The other minima that were followed to their end."""
        least, count = self._best.minimum, self.likelihood.observations
        apart = [m for m in self._best.others if np.abs(m.u - least.u).max(initial=0) > APART]
        return tuple(
            Basin(
                other.problem.model.named(other.u),
                ratio(other.cost, other.square),
                bool(other.left(count) - least.left(count) <= INDISTINGUISHABLE * self.noise**2),
            )
            for other in apart
        )

    @property
    def suspect_images(self) -> tuple[SuspectImage, ...]:
        """Images whose residual stands out from those of the others."""
        return suspects(self.per_image)

    def _free(self, by_name: Mapping[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in by_name.items() if name not in self._held}

    def _precision(self) -> AbstractContextManager[None]:
        """That of the fit, which whoever asks may not be in."""
        context: AbstractContextManager[None] = jax.enable_x64(self._dtype == np.float64)
        return context

    @cached_property
    def _recovery(self) -> Recovery:
        minimum = self._best.minimum
        return Recovery(minimum.problem.model, self._best.limit.natural_upper, minimum.nearest)

    @cached_property
    def _lit(self) -> tuple[Scene, ...]:
        """Every image's scene with the recovered attenuation and gain."""
        minimum = self._best.minimum
        with self._precision():
            law = self._recovery.law(minimum.k, minimum.u, self._dtype)
        scenes = self._scenes if law is None else tuple(_relit(s, law) for s in self._scenes)
        if self.gains is None:
            return scenes
        return tuple(_brighter(scene, g) for scene, g in zip(scenes, self.gains, strict=True))

    @cached_property
    def _uncertainty(self) -> Uncertainty:
        limit, minimum, recovery = self._best.limit, self._best.minimum, self._recovery
        model = minimum.problem.model
        edges = [
            np.append(linear, model.coordinates(of_u))
            for linear, of_u in zip((limit.lower, limit.upper), limit.box, strict=True)
        ]
        return propagate(
            replace(minimum.at, k=minimum.k, cost=np.asarray(minimum.cost)),
            model.coordinates(minimum.u),
            np.append(limit.held.ravel(), np.zeros(model.direction_count, bool)),
            self.likelihood.observations - (0 if self.gains is None else len(self.gains) - 1),
            lambda k, y: recovery.coefficients(k, model.whole(y)),
            bounds=(edges[0], edges[1]),
            noise=minimum.robust_noise,
            gains=minimum.at.gains,
            rounding=float(np.finfo(self._dtype).eps),
            image_pull=minimum.image_pull,
            ranges=recovery.ranges(limit.lower, limit.upper),
        )


def _seen(best: Attempt, observed: Observed) -> Seen:
    """What helps to say why something is not told."""
    minimum = best.minimum
    model, at = minimum.problem.model, minimum.at
    plain = model.column_count - len(model.material.specular)
    depths = highlight_depths(at.information, minimum.k, plain, _exponents(model))
    if model.gauge is None:
        return Seen(depths=depths)
    within = clamped_within(model, minimum.u)
    clamped = 0.0
    if within > minimum.nearest:
        clamped = share_nearer(observed.pages, model, within)
    return Seen(minimum.nearest, minimum.farthest, clamped, depths)


def _exponents(model: Model) -> dict[int, int]:
    """Which unknown is the shininess of each lobe that has one, unheld."""
    return {
        int(names[0].split(".")[1]): k
        for k, names in enumerate(model.searched)
        if names[0].endswith(".shininess")
    }


def _relit(scene: Scene, law: AbstractAttenuation) -> Scene:
    """The scene with an attenuation that is known to be valid: nothing is checked or converted."""
    if not any(isinstance(light, PointLight) for light in scene.lights):
        return scene  # with the lamp off, say
    return eqx.tree_at(
        lambda s: [x.attenuation for x in s.lights if isinstance(x, PointLight)],
        scene,
        [law for light in scene.lights if isinstance(light, PointLight)],
        is_leaf=lambda x: x is None,
    )


def _brighter(scene: Scene, gain: float) -> Scene:
    """The scene with the intensity of its lights times a gain."""
    lights = tuple(
        eqx.tree_at(
            lambda x: x.intensity, light, light.intensity * light.intensity.dtype.type(gain)
        )
        for light in scene.lights
    )
    return Scene(scene.ambient, lights)
