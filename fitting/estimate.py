"""The door to fitting: images, surfaces and lights in, a material with its errors out."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import equinox as eqx
import numpy as np
import optimistix as optx
from jaxtyping import Float

from diffshade.arrays import ArrayLike
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.attenuation import AbstractAttenuation, InverseSquare
from diffshade.light.point import PointLight
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from fitting.attempt import Attempt, attempted
from fitting.certificate import Certificate
from fitting.certificate import certify as prove
from fitting.clamp import CLEAR, may_show, with_clamp
from fitting.degeneracies import Seen, highlight_depths
from fitting.devices import Devices, check_same_input, mesh_over
from fitting.distances import share_nearer
from fitting.gauge import CONSTANTS, gauge_of, lengths, with_attenuation
from fitting.identify import Unidentified, unidentified
from fitting.inputs import Photograph, match
from fitting.likelihood import Likelihood, rounding
from fitting.limits import Bounds, Grid, ceiling_grid, limits
from fitting.model import Model, default_material, held_names, linear_names, model_of
from fitting.observed import Observed
from fitting.polish import Minimum
from fitting.profile import Profile, profile
from fitting.recovered import Recovery, clamped_within
from fitting.residual import ImageResidual, evaluation, measure, ratio
from fitting.search import APART
from fitting.suspects import SuspectImage, suspects
from fitting.uncertainty import propagate
from fitting.weights import SensorNoise, Tukey, Weighting

__all__ = ["Basin", "Correlations", "Fit", "fit"]

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


@dataclass(frozen=True)
class Fit:
    """What `fit` found.

    `material` and `scene` are of the types that were given, a tuple of scenes where several were.
    `coefficients` and `standard_errors` hold arrays by name: "ka", "kd", "specular.0.ks",
    "specular.0.shininess"; "attenuation.c0" and so on where an attenuation was fitted, and with a
    quadratic or a linear one what was measured first, "reference.l0" to "l2" and k f(d0) as
    "reference.kd", at the distance d0 = `reference_distance`, where 1/f(d) is in proportion to
    l0 + l1 d/d0 + l2 (d/d0)^2. Standard errors are infinite where the images do not tell;
    `unidentified` names what is not to be trusted, and why.
    `intervals` are those of 95 %, lower and upper end; `correlations` those of all numbers.
    `noise` is the standard deviation of an observation. `relative_residual` is that of `evaluate`;
    beside it stands the `weighted_residual` of a fit that gave its observations weights. `basins`
    are other minima, `suspect_images` those that stand out. `gains` are the factors on the lights
    of each image, where they were asked for. `likelihood` is that of the images, with the number of
    free parameters and its `bic`, by which models compare (`compare`).
    """

    material: Material
    scene: Any
    coefficients: Mapping[str, np.ndarray]
    standard_errors: Mapping[str, np.ndarray]
    unidentified: tuple[Unidentified, ...]
    relative_residual: float
    fraction_excluded: float
    per_image: tuple[ImageResidual, ...]
    noise: float
    converged: bool
    steps: int
    reference_distance: float | None = None
    intervals: Mapping[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    correlations: Correlations | None = None
    basins: tuple[Basin, ...] = ()
    suspect_images: tuple[SuspectImage, ...] = ()
    weighted_residual: float | None = None
    gains: np.ndarray | None = None
    certificate: Certificate | None = None
    profiles: tuple[Profile, ...] = ()
    likelihood: Likelihood | None = None


def fit(
    images: ArrayLike | Sequence[ArrayLike],
    gbuffer: GBuffer | Sequence[GBuffer],
    scenes: Scene | Sequence[Scene],
    *,
    material: Material | None = None,
    attenuation: type[AbstractAttenuation] | None = None,
    hold: Iterable[str] = (),
    robust: str | Tukey | None = None,
    bounds: Bounds | None = None,
    valid: ArrayLike | Sequence[ArrayLike] | None = None,
    clipped: ArrayLike | Sequence[ArrayLike] | None = None,
    noise: SensorNoise | None = None,
    gains: bool = False,
    certify: bool = False,
    profiles: bool = False,
    solver: optx.AbstractLeastSquaresSolver | None = None,
    devices: Devices = None,
) -> Fit:
    """Recover a material's coefficients from one or many images of known surfaces and lights.

    Minimises the sum over images, pixels and channels of |observed - predicted|^2, predicted by
    LIGHT-13: the linear coefficients exactly, the shape of lobes and attenuation by Optimistix from
    a coarse grid, so that no start is needed.

    - `images`: linear radiance [H, W, C] or [H, W], one or a sequence; `gbuffer`: one for all, or
      one an image; `scenes`: one for all, or one an image.
    - `material`: which terms and lobes there are, a start for what is searched, and the values of
      what is held. By default diffuse, one Phong lobe, and ambient where a scene has ambient light.
    - `attenuation`: None takes the scene's as known; a type asks for one set of constants shared by
      all point lights: `ds.QuadraticAttenuation`, `ds.LinearAttenuation`, `ds.ExponentialAttenuation`;
      or for `ds.InverseSquare`, which has none. A quadratic law is clamped at 1 (LIGHT-12) where that
      is seen or its scale is known; where it is seen at some points and not at others it sets the
      scale of the constants, k_d and k_s.
    - `hold`: names of coefficients kept at their value in `material`: "ka", "kd", "specular.ks",
      "specular.shininess", or "specular.0.ks" for one lobe; and "attenuation.c0" and so on at their
      value in the scene's lights.
    - `bounds`: lower and upper by name, by default 0 and 1 for k_a and k_d, 0 for k_s (None: unbounded),
      and 0.1 and 100,000 for the shininess (None: these). They hold at every step. Beside the
      constants of a quadratic or linear attenuation k_d and k_s have no scale of their own, and no
      upper bound, unless one of them or of the constants is held, or the clamp is seen.
    - `valid`: which pixels to use [H, W], one or one an image; by default all of the foreground.
    - `robust`: "tukey" (or `fitting.Tukey(c)`) takes the weight from outliers, such as shadows.
    - `clipped`: observations that a sensor clipped, [H, W] or [H, W, C], one or one an image: they
      say "at least", whatever `valid` says of them. The residual that is reported leaves them out.
    - `noise`: a `fitting.SensorNoise`, by which brighter observations may count less.
    - `gains`: whether the lights of each image have an unknown strength beside the scene's; the
      mean over the images is 1, for their common scale cannot be told from k_d and k_s.
    - `certify`: whether to prove that the minimum is global, where one shininess is all that is
      searched: `fit.certificate` says what was proven. It takes some hundred passes over the data.
    - `profiles`: whether to compute the residual over each lobe's shininess, for plots.
    - `solver`: any Optimistix least-squares solver in place of our own bounded one, to compare.
    - `devices`: JAX devices, or a mesh of them with one axis, to share the pixels out over in blocks
      of 4096; by default one. They may be those of several processes joined by
      `jax.distributed.initialize`: all of these call `fit` with the same input, and have the result.

    Raises `BadInput` for images, G-buffers, scenes and masks that do not fit together, for images
    that are not finite in a used pixel, and for unknown names.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(32, 32, 2.2))
    >>> scene = ds.Scene(lights=ds.ParallelLight((1, 1, 2)))
    >>> image = ds.render(g, scene, ds.Material(kd=0.6, specular=ds.Phong(0.3, 20)))
    >>> round(float(fit(image, g, scene).material.specular[0].shininess), 2)
    20.0
    """
    weighting = _weighting(robust, noise, clipped)
    mesh = mesh_over(devices)
    photographs = match(images, gbuffer, scenes, valid, clipped)
    if attenuation is InverseSquare:
        law = InverseSquare()
        photographs = [p._replace(scene=with_attenuation(p.scene, law)) for p in photographs]
    constants = _constants(attenuation)
    start = default_material(p.scene for p in photographs) if material is None else material
    held = held_names(hold, start, constants)
    if material is None and held - set(constants):
        raise BadInput(
            f"hold names {min(held - set(constants))} and no material is given: its value is what is"
            " kept; give material="
        )
    options = repr((attenuation, sorted(held), bounds, weighting, gains, type(solver)))
    check_same_input(mesh, options, photographs, start)
    observed = Observed(photographs, mesh, fitted_law=bool(constants), fair=robust is not None)
    model = model_of(start, held, observed.channel_count)
    if attenuation is not None and constants:
        distance = _reference_distance(observed)
        gauge = gauge_of(
            attenuation,
            np.asarray(distance, observed.dtype),
            fixed := _held_law(attenuation, held, photographs, distance),
            scale_known=bool(held & set(linear_names(start)) - {"ka"}) or any(fixed),
        )
        model = replace(model, gauge=gauge)

    def attempt(model: Model, grid: Grid | None = None) -> Attempt:
        limit = limits(model, held, start, bounds or {}, start_given=material is not None)
        limit = limit if grid is None else replace(limit, grid=grid)
        return attempted(observed, model, limit, weighting, gains, solver)

    best = _clamped(attempt, attempt(model), observed)
    found = _fit(best, observed, held, weighting, one_scene=isinstance(scenes, Scene) and not gains)
    box = best.limit.box
    drawn = len(model.searched) if profiles else 0
    return replace(
        found,
        certificate=prove(observed, best.minimum, box) if certify else None,
        profiles=tuple(profile(observed, best.minimum, box, which=k) for k in range(drawn)),
    )


def _fit(
    best: Attempt,
    observed: Observed,
    held: frozenset[str],
    weighting: Weighting | None,
    *,
    one_scene: bool,
) -> Fit:
    """What was found, in the words of the caller."""
    limit, minimum = best.limit, best.minimum
    model, dtype, photographs = minimum.problem.model, observed.dtype, observed.photographs
    recovery = Recovery(model, limit.natural_upper, minimum.nearest)
    law = recovery.law(minimum.k, minimum.u, dtype)
    material = recovery.material(minimum.k, minimum.u, dtype)
    gains = None if minimum.gains is None else observed.in_order(minimum.gains)
    lit = [p.scene if law is None else _relit(p.scene, law) for p in photographs]
    if gains is not None:
        lit = [_brighter(scene, g) for scene, g in zip(lit, gains, strict=True)]

    judge = minimum.judge
    robust = judge is not None and judge.weighting.robust is not None
    edges = [
        np.append(linear, model.coordinates(of_u))
        for linear, of_u in zip((limit.lower, limit.upper), limit.box, strict=True)
    ]
    uncertainty = propagate(
        replace(minimum.at, k=minimum.k, cost=np.asarray(minimum.cost)),
        model.coordinates(minimum.u),
        np.append(limit.held.ravel(), np.zeros(model.direction_count, bool)),
        observed.count,
        lambda k, y: recovery.coefficients(k, model.whole(y)),
        bounds=(edges[0], edges[1]),
        noise=float(judge.scale) if judge is not None and robust else None,
        gains=minimum.at.gains,
        rounding=float(np.finfo(dtype).eps),
    )
    values = uncertainty.values
    free = {n: v for n, v in values.items() if n not in held}
    left, squares = observed.in_order(minimum.image_cost), observed.in_order(minimum.squares)
    if weighting is None:
        measured = evaluation(photographs, left, squares)
    else:  # whatever weights it had, the figure is that of all unclipped pixels
        measured = measure(
            material, [p._replace(scene=s) for p, s in zip(photographs, lit, strict=True)]
        )
    fitted_law = model.gauge is not None
    return Fit(
        material=material,
        scene=lit[0] if one_scene else tuple(lit),
        coefficients=values,
        standard_errors={n: e for n, e in uncertainty.standard_errors.items() if n in free},
        unidentified=unidentified(
            free,
            uncertainty,
            minimum.brightest,
            scaled=model.gauge is not None and model.gauge.floating,
            gains=() if gains is None else tuple(f"gain.{k}" for k in range(len(gains))),
            seen=_seen(minimum, observed),
        ),
        relative_residual=measured.relative_residual,
        fraction_excluded=measured.fraction_excluded,
        per_image=measured.per_image,
        noise=uncertainty.noise,
        converged=minimum.converged,
        steps=best.steps,
        reference_distance=observed.distance if fitted_law and "reference.l0" in values else None,
        intervals={n: i for n, i in uncertainty.intervals.items() if n in free},
        correlations=Correlations(uncertainty.numbers, uncertainty.correlations),
        basins=_basins(best, uncertainty.noise),
        suspect_images=suspects(measured.per_image),
        weighted_residual=None if weighting is None else ratio(left.sum(), squares.sum()),
        gains=gains,
        likelihood=best.likelihood,
    )


def _clamped(
    attempt: Callable[[Model, Grid], Attempt], plain: Attempt, observed: Observed
) -> Attempt:
    """The fit with LIGHT-12's clamp, where the images show it at some points and not at others."""
    minimum, likelihood = plain.minimum, plain.likelihood
    model = with_clamp(minimum.problem.model)
    if model is None or minimum.cost <= rounding(minimum.square, observed.dtype):
        return plain
    if not may_show(minimum, observed):
        return plain
    nearest, farthest = minimum.nearest, minimum.farthest
    clamped = attempt(model, ceiling_grid(model, minimum.u, nearest, farthest))
    within = clamped_within(clamped.minimum.problem.model, clamped.minimum.u)
    partly = nearest < within < farthest
    return clamped if partly and clamped.likelihood.bic + CLEAR < likelihood.bic else plain


def _weighting(
    robust: str | Tukey | None, noise: SensorNoise | None, clipped: object
) -> Weighting | None:
    """What was asked for about noise; None where least squares is all."""
    if isinstance(robust, str):
        if robust != "tukey":
            raise BadInput(f'robust is {robust!r}: give "tukey", a fitting.Tukey, or None')
        robust = Tukey()
    if robust is None and noise is None and clipped is None:
        return None
    return Weighting(robust, noise)


def _basins(best: Attempt, noise: float) -> tuple[Basin, ...]:
    """The other minima that were followed to their end."""
    least = best.minimum
    apart = [m for m in best.others if np.abs(m.u - least.u).max(initial=0) > APART]
    return tuple(
        Basin(
            other.problem.model.named(other.u),
            ratio(other.cost, other.square),
            bool(other.cost - least.cost <= INDISTINGUISHABLE * noise**2),
        )
        for other in apart
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


def _seen(minimum: Minimum, observed: Observed) -> Seen:
    """What helps to say why something is not told."""
    model, at = minimum.problem.model, minimum.at
    plain = model.column_count - len(model.material.specular)
    depths = highlight_depths(at.information, minimum.k, plain, model.searched)
    if model.gauge is None:
        return Seen(depths=depths)
    within = clamped_within(model, minimum.u)
    clamped = 0.0
    if within > minimum.nearest:
        clamped = share_nearer(observed.pages, model, within)
    return Seen(minimum.nearest, minimum.farthest, clamped, depths)


def _relit(scene: Scene, law: AbstractAttenuation) -> Scene:
    """The scene with an attenuation that is known to be valid: nothing is checked or converted."""
    return eqx.tree_at(
        lambda s: [x.attenuation for x in s.lights if isinstance(x, PointLight)],
        scene,
        [law for light in scene.lights if isinstance(light, PointLight)],
        is_leaf=lambda x: x is None,
    )


def _constants(attenuation: type[AbstractAttenuation] | None) -> tuple[str, ...]:
    """The names of what is unknown of a law that is asked for."""
    if attenuation is None:
        return ()
    if not isinstance(attenuation, type) or attenuation not in CONSTANTS:
        types = ", ".join(f"ds.{law.__name__}" for law in CONSTANTS)
        raise BadInput(
            f"attenuation is {attenuation!r}: give one of the types {types} to fit it, or None to"
            " take the scene's as known"
        )
    return tuple(f"attenuation.{name}" for name in CONSTANTS[attenuation])


def _held_law(
    attenuation: type[AbstractAttenuation],
    held: frozenset[str],
    photographs: Sequence[Photograph],
    distance: float,
) -> tuple[float | None, ...]:
    """Those constants of the law that are held, at the value that the scene's lights give them."""
    constants = CONSTANTS[attenuation]
    named = held & set(_constants(attenuation))
    if not named:
        return (None,) * len(constants)
    laws = [
        light.attenuation
        for photograph in photographs
        for light in photograph.scene.lights
        if isinstance(light, PointLight) and isinstance(light.attenuation, attenuation)
    ]
    if not laws:
        raise BadInput(
            f"hold names {min(named)}, and no light of the scene has a {attenuation.__name__},"
            " whose value is what is kept"
        )
    return tuple(
        float(getattr(laws[0], name)) * distance ** lengths(name)
        if f"attenuation.{name}" in held
        else None
        for name in constants
    )


def _reference_distance(observed: Observed) -> float:
    """How far the lit points lie from the lights whose attenuation is asked for."""
    for stack in observed.stacks:
        points = any(isinstance(kind, PointLight) for kind in stack.lights)
        if points and stack.gbuffer.position is None:
            raise BadInput(
                "an attenuation is asked for, and the G-buffer has normals only, no positions"
            )
    if observed.distance is None:
        raise BadInput("an attenuation is asked for, and no point light lights a used pixel")
    return observed.distance
