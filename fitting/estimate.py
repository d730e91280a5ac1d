"""The door to fitting: images, surfaces and lights in, a material with its errors out."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
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
from fitting.certificate import Certificate
from fitting.certificate import certify as prove
from fitting.clamp import CLEAR, may_show, with_clamp
from fitting.degeneracies import Seen, highlight_depths
from fitting.devices import Devices, check_same_input, mesh_over
from fitting.distances import Distances, lit_distances, share_nearer
from fitting.gauge import CONSTANTS, gauge_of, lengths, with_attenuation
from fitting.identify import Unidentified, unidentified
from fitting.inputs import Photograph, match, views
from fitting.likelihood import Likelihood, rounding
from fitting.limits import Bounds, Grid, Limits, ceiling_grid, limits
from fitting.model import Model, default_material, held_names, linear_names, model_of
from fitting.observation import Group, View, group_views, in_precision
from fitting.profile import Profile, profile
from fitting.project import Problem
from fitting.recovered import Recovery, clamped_within, recover
from fitting.residual import ImageResidual, evaluation, measure, ratio
from fitting.search import ALL, APART, Found, search
from fitting.suspects import SuspectImage, suspects
from fitting.uncertainty import propagate
from fitting.weights import Judge, SensorNoise, Tukey, Weighting

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
    - `bounds`: lower and upper by name, by default 0 and 1 for each k (None: unbounded), and 0.1 and
      100,000 for the shininess (None: these). They hold at every step. Beside the
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
    seen = views(photographs)
    start = default_material(p.scene for p in photographs) if material is None else material
    held = held_names(hold, start, constants)
    if material is None and held - set(constants):
        raise BadInput(
            f"hold names {min(held - set(constants))} and no material is given: its value is what is"
            " kept; give material="
        )
    dtype = seen[0].gbuffer.normal.x.dtype
    surfaces = list({id(p.gbuffer): p.gbuffer for p in photographs}.values())
    observed = [(p.image, p.scene, p.valid, p.clipped) for p in photographs]
    options = repr((attenuation, sorted(held), bounds, weighting, gains, type(solver)))
    check_same_input(mesh, options, surfaces, observed, start)
    groups, order = group_views(seen, mesh)
    distances = _distances(groups) if constants else None
    channel_count = photographs[0].image.shape[2]
    observations = sum(int((view.weight > 0).sum()) for view in seen) * channel_count
    model = model_of(start, held, channel_count)
    if attenuation is not None and distances is not None:
        gauge = gauge_of(
            attenuation,
            jnp.asarray(distances.reference, dtype),
            fixed := _held_law(attenuation, held, photographs, distances),
            scale_known=bool(held & set(linear_names(start)) - {"ka"}) or any(fixed),
        )
        model = replace(model, gauge=gauge)
    squares = np.array([_square(view) for view in seen])
    square = float(squares.sum())

    def attempt(model: Model, grid: Grid | None = None) -> _Attempt:
        limit = limits(model, held, start, bounds or {}, start_given=material is not None)
        limit = limit if grid is None else replace(limit, grid=grid)
        problem = _problem(model, limit, groups, square, dtype, weighting, gains)
        found = search(problem, *limit.searched(dtype), solver)
        searched = replace(problem.model, dependent=found.dependent).direction_count
        parameters = int((~limit.held).sum()) + searched + 1  # the noise
        parameters += sum(len(group.weight) for group in groups) - 1 if gains else 0
        cost = float(found.at.cost)
        likelihood = Likelihood.of(cost, rounding(square, dtype), parameters, observations)
        return _Attempt(limit, problem, found, likelihood)

    best = attempt(model)
    if distances is not None:
        best = _clamped(attempt, best, distances)
    limit, problem, found = best.limit, best.problem, best.found
    model = problem.model
    solved = replace(model, dependent=found.dependent)
    _, box = limit.searched(dtype)
    drawn = len(model.searched) if profiles else 0
    nearest = None if distances is None else jnp.asarray(distances.nearest, dtype)
    recovery = Recovery(solved, jnp.asarray(limit.natural_upper, dtype), nearest)
    recovered, law, coefficients = recover(recovery, found.at.k, found.u)
    gain = None if found.gains is None else np.asarray(found.gains, float)[np.argsort(order)]
    lit = [p.scene if law is None else _relit(p.scene, law) for p in photographs]
    if gain is not None:
        lit = [_brighter(scene, g) for scene, g in zip(lit, gain, strict=True)]
    values = {name: np.asarray(value) for name, value in coefficients.items()}
    free = {n: v for n, v in values.items() if n not in held}
    known = np.concatenate([limit.held.ravel(), solved.known])
    judge = found.judge
    scale = float(judge.scale) if judge is not None and judge.weighting.robust else None
    uncertainty = propagate(
        found.at,
        found.u,
        known,
        observations,
        recovery.coefficients,
        bounds=limit.edges,
        noise=scale,
        gains=found.at.gains,
    )
    left = np.maximum(np.asarray(found.at.image_cost), 0).astype(float)[np.argsort(order)]
    if weighting is None:
        measured = evaluation(photographs, left, squares)
    else:  # whatever weights it had, the figure is that of all unclipped pixels
        relit = [p._replace(scene=s) for p, s in zip(photographs, lit, strict=True)]
        measured = measure(recovered, relit)
    return Fit(
        material=recovered,
        scene=lit[0] if isinstance(scenes, Scene) and gain is None else tuple(lit),
        coefficients=values,
        standard_errors={n: e for n, e in uncertainty.standard_errors.items() if n in free},
        unidentified=unidentified(
            free,
            uncertainty,
            max(float(np.max(view.observed, initial=0.0)) for view in seen),
            scaled=model.gauge is not None and model.gauge.floating,
            gains=() if gain is None else tuple(f"gain.{k}" for k in range(len(gain))),
            seen=_seen(model, found, distances, groups),
        ),
        relative_residual=measured.relative_residual,
        fraction_excluded=measured.fraction_excluded,
        per_image=measured.per_image,
        noise=uncertainty.noise,
        converged=bool(found.converged),
        steps=int(found.steps),
        reference_distance=distances.reference if distances and "reference.l0" in values else None,
        intervals={n: i for n, i in uncertainty.intervals.items() if n in free},
        correlations=Correlations(uncertainty.numbers, uncertainty.correlations),
        basins=_basins(found, solved, float(squares.sum()), uncertainty.noise),
        suspect_images=suspects(measured.per_image),
        weighted_residual=None if weighting is None else ratio(left.sum(), squares.sum()),
        gains=gain,
        certificate=prove(problem, found, box) if certify else None,
        profiles=tuple(profile(problem, found, box, which=k) for k in range(drawn)),
        likelihood=best.likelihood,
    )


class _Attempt(NamedTuple):
    """One model searched: its limits, the problem, the minimum, and how likely that is."""

    limit: Limits
    problem: Problem
    found: Found
    likelihood: Likelihood


def _clamped(
    attempt: Callable[[Model, Grid], _Attempt], plain: _Attempt, distances: Distances
) -> _Attempt:
    """The fit with LIGHT-12's clamp, where the images show it at some points and not at others."""
    model, likelihood = with_clamp(plain.problem.model), plain.likelihood
    cost, dtype = float(plain.found.at.cost), plain.found.u.dtype
    if model is None or cost <= rounding(float(plain.problem.norm) ** 2, dtype):
        return plain
    noise = (cost / likelihood.observations) ** 0.5
    if not may_show(plain.problem, plain.found, distances, noise):
        return plain
    u = np.asarray(plain.found.u, float)
    clamped = attempt(model, ceiling_grid(model, u, distances.nearest, distances.farthest))
    within = clamped_within(clamped.problem.model, np.asarray(clamped.found.u))
    partly = distances.nearest < within < distances.farthest
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


def _basins(found: Found, model: Model, square: float, noise: float) -> tuple[Basin, ...]:
    """The other minima that were followed to their end."""
    u, costs = np.asarray(found.basins, float), np.asarray(found.costs, float)
    best = np.asarray(found.u, float)
    apart = np.abs(u - best).max(axis=-1, initial=0) > APART
    others = np.flatnonzero(np.isfinite(costs) & apart)
    return tuple(
        Basin(
            model.named(u[k]),
            ratio(max(costs[k], 0.0), square),
            bool(costs[k] - float(found.at.cost) <= INDISTINGUISHABLE * noise**2),
        )
        for k in others[np.argsort(costs[others])]
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


def _seen(model: Model, found: Found, distances: Distances | None, groups: Sequence[Group]) -> Seen:
    """What helps to say why something is not told."""
    plain = model.column_count - len(model.material.specular)
    information, k = np.asarray(found.at.information), np.asarray(found.at.k)
    depths = highlight_depths(information, k, plain, model.searched)
    if distances is None:
        return Seen(depths=depths)
    within = clamped_within(model, np.asarray(found.u))
    clamped = share_nearer(groups, within) if within > distances.nearest else 0.0
    return Seen(distances.nearest, distances.farthest, clamped, depths)


def _square(view: View) -> float:
    """|observed|^2 over the used pixels."""
    return float(np.einsum("pc,pc,p->", view.observed, view.observed, view.weight, dtype=float))


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
    distances: Distances,
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
        float(getattr(laws[0], name)) * distances.reference ** lengths(name)
        if f"attenuation.{name}" in held
        else None
        for name in constants
    )


def _distances(groups: Sequence[Group]) -> Distances:
    """How far the lit points lie from the lights whose attenuation is asked for."""
    for group in groups:
        points = any(isinstance(light, PointLight) for light in group.scenes.lights)
        if points and group.blocks.position is None:
            raise BadInput(
                "an attenuation is asked for, and the G-buffer has normals only, no positions"
            )
    distances = lit_distances(groups)
    if distances is None:
        raise BadInput("an attenuation is asked for, and no point light lights a used pixel")
    return distances


def _problem(
    model: Model,
    limit: Limits,
    groups: tuple[Group, ...],
    square: float,
    dtype: np.dtype,
    weighting: Weighting | None,
    gains: bool,
) -> Problem:
    edges = limit.lower, limit.upper, np.clip(0.0, limit.lower, limit.upper)
    numbers = np.asarray(square**0.5 or 1.0), np.int32(ALL)
    put = jax.device_put(in_precision((model, *edges, *numbers), dtype))
    model, lower, upper, reference, norm, blocks = put
    judge = None
    if weighting is not None:
        zero = jnp.zeros((), dtype)
        judge = Judge(weighting, jnp.zeros(model.size, dtype), reference, zero, zero)
    ones = jnp.ones(sum(len(group.weight) for group in groups), dtype) if gains else None
    return Problem(model, groups, lower, upper, reference, norm, blocks, judge, ones)
