"""The door to fitting: images, surfaces and lights in, a material with its errors out."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Float

from diffshade.arrays import ArrayLike
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.attenuation import AbstractAttenuation, QuadraticAttenuation
from diffshade.light.point import PointLight
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from fitting.distances import Distances, lit_distances
from fitting.identify import Unidentified, unidentified
from fitting.inputs import Photograph, match, views
from fitting.limits import Bounds, Limits, limits
from fitting.model import CONSTANTS, Model, coefficient, default_material, held_names, linear_names
from fitting.observation import Group, View, group_views, in_precision
from fitting.project import Problem
from fitting.recovered import Recovery, recover
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
    "specular.0.shininess"; "attenuation.c0" and so on where an attenuation was fitted, and with it
    what was measured first, "reference.l0" to "l2" and k f(d0) as "reference.kd", at the distance
    d0 = `reference_distance`, where 1/f(d) = l0 + l1 d/d0 + l2 (d/d0)^2. Standard errors are
    infinite where the images do not tell; `unidentified` names what is not to be trusted, and why.
    `intervals` are those of 95 %, lower and upper end; `correlations` those of all numbers.
    `noise` is the standard deviation of an observation. `relative_residual` is that of `evaluate`;
    beside it stands the `weighted_residual` of a fit that gave its observations weights. `basins`
    are other minima, `suspect_images` those that stand out. `gains` are the factors on the lights
    of each image, where they were asked for.
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
    solver: optx.AbstractLeastSquaresSolver | None = None,
) -> Fit:
    """Recover a material's coefficients from one or many images of known surfaces and lights.

    Minimises the sum over images, pixels and channels of |observed - predicted|^2, predicted by
    LIGHT-13: the linear coefficients exactly, the shape of lobes and attenuation by Optimistix from
    a coarse grid, so that no start is needed.

    - `images`: linear radiance [H, W, C] or [H, W], one or a sequence; `gbuffer`: one for all, or
      one an image; `scenes`: one for all, or one an image.
    - `material`: which terms and lobes there are, a start for what is searched, and the values of
      what is held. By default diffuse, one Phong lobe, and ambient where a scene has ambient light.
    - `attenuation`: None takes the scene's as known; `ds.QuadraticAttenuation` (the type) asks for
      one set of constants shared by all point lights. It is fitted without LIGHT-12's clamp.
    - `hold`: names of coefficients kept at their value in `material`: "ka", "kd", "specular.ks",
      "specular.shininess", or "specular.0.ks" for one lobe; and "attenuation.c0", "c1", "c2" at their
      value in the scene's lights.
    - `bounds`: lower and upper by name, by default 0 and 1 for each k (None: unbounded), and 0.1 and
      100,000 for the shininess (None: these). They hold at every step. With a fitted attenuation
      k_d and k_s have no scale of their own, and no upper bound, unless one of them or of the
      constants is held.
    - `valid`: which pixels to use [H, W], one or one an image; by default all of the foreground.
    - `robust`: "tukey" (or `fitting.Tukey(c)`) takes the weight from outliers, such as shadows.
    - `clipped`: observations that a sensor clipped, [H, W] or [H, W, C], one or one an image: they
      say "at least", whatever `valid` says of them. The residual that is reported leaves them out.
    - `noise`: a `fitting.SensorNoise`, by which brighter observations may count less.
    - `gains`: whether the lights of each image have an unknown strength beside the scene's; the
      mean over the images is 1, for their common scale cannot be told from k_d and k_s.
    - `solver`: any Optimistix least-squares solver in place of our own bounded one, to compare.

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
    photographs = match(images, gbuffer, scenes, valid, clipped)
    seen = views(photographs)
    start = default_material(p.scene for p in photographs) if material is None else material
    held = held_names(hold, start, attenuated=attenuation is not None)
    if material is None and held - set(CONSTANTS):
        raise BadInput(
            f"hold names {min(held - set(CONSTANTS))} and no material is given: its value is what is"
            " kept; give material="
        )
    dtype = seen[0].gbuffer.normal.x.dtype
    groups, order = group_views(seen)
    distances = None if attenuation is None else _distances(attenuation, groups)
    constants = _held_law(held, photographs, distances)
    channel_count = photographs[0].image.shape[2]
    model = _model(start, held, channel_count, distances, constants, dtype)
    limit = limits(model, held, start, bounds or {}, start_given=material is not None)
    squares = np.array([_square(view) for view in seen])
    problem = _problem(model, limit, groups, float(squares.sum()), dtype, weighting, gains)
    found = search(problem, *limit.searched(dtype), solver)

    solved = replace(problem.model, dependent=found.dependent)
    nearest = None if distances is None else jnp.asarray(distances.nearest, dtype)
    recovery = Recovery(solved, jnp.asarray(limit.natural_upper, dtype), nearest)
    recovered, law, coefficients = recover(recovery, found.at.k, found.u)
    gain = None if found.gains is None else np.asarray(found.gains, float)[np.argsort(order)]
    lit = [p.scene if law is None else _relit(p.scene, law) for p in photographs]
    if gain is not None:
        lit = [_brighter(scene, g) for scene, g in zip(lit, gain, strict=True)]
    values = {name: np.asarray(value) for name, value in coefficients.items()}
    free = {n: v for n, v in values.items() if n not in held}
    observations = sum(int((view.weight > 0).sum()) for view in seen) * channel_count
    known = np.concatenate([limit.held.ravel(), solved.known])
    scale = None if found.judge is None or weighting.robust is None else float(found.judge.scale)
    uncertainty = propagate(
        found.at,
        found.u,
        known,
        observations,
        recovery.coefficients,
        bounds=limit.edges,
        noise=scale,
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
            scaled=law is not None and not model.scaled,
            clamped=recovery.exceeds_one(np.asarray(found.u)),
        ),
        relative_residual=measured.relative_residual,
        fraction_excluded=measured.fraction_excluded,
        per_image=measured.per_image,
        noise=uncertainty.noise,
        converged=bool(found.converged),
        steps=int(found.steps),
        reference_distance=None if distances is None else distances.reference,
        intervals={n: i for n, i in uncertainty.intervals.items() if n in free},
        correlations=Correlations(uncertainty.numbers, uncertainty.correlations),
        basins=_basins(found, solved, float(squares.sum()), uncertainty.noise),
        suspect_images=suspects(measured.per_image),
        weighted_residual=None if weighting is None else ratio(left.sum(), squares.sum()),
        gains=gain,
    )


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


def _square(view: View) -> float:
    """|observed|^2 over the used pixels."""
    return float(np.einsum("pc,pc,p->", view.observed, view.observed, view.weight, dtype=float))


def _relit(scene: Scene, law: QuadraticAttenuation) -> Scene:
    """The scene with an attenuation that is known to be valid: nothing is checked or converted."""
    return eqx.tree_at(
        lambda s: [x.attenuation for x in s.lights if isinstance(x, PointLight)],
        scene,
        [law for light in scene.lights if isinstance(light, PointLight)],
        is_leaf=lambda x: x is None,
    )


def _model(
    start: Material,
    held: frozenset[str],
    channel_count: int,
    distances: Distances | None,
    held_law: tuple[float | None, ...],
    dtype: jnp.dtype,
) -> Model:
    if any(leaf.ndim > 1 for leaf in jax.tree.leaves(start)):
        raise BadInput("the material holds maps: give fit one number, or one a channel")
    searched = tuple(j for j in range(len(start.specular)) if f"specular.{j}.shininess" not in held)
    if any(coefficient(start, f"specular.{j}.shininess").ndim for j in searched):
        raise BadInput(
            "the shininess has one number a channel: fit searches one for all, or hold it"
        )
    return Model(
        material=start,
        searched=searched,
        channel_count=channel_count,
        distance=None if distances is None else jnp.asarray(distances.reference, dtype),
        scaled=distances is not None
        and (bool(held & set(linear_names(start)) - {"ka"}) or any(held_law)),
        held_law=held_law,
    )


def _held_law(
    held: frozenset[str], photographs: Sequence[Photograph], distances: Distances | None
) -> tuple[float | None, ...]:
    """l0, l1, l2 of the constants that are held, at the value that the scene's lights give them."""
    if distances is None or not held & set(CONSTANTS):
        return (None, None, None)
    laws = [
        light.attenuation
        for photograph in photographs
        for light in photograph.scene.lights
        if isinstance(light, PointLight) and isinstance(light.attenuation, QuadraticAttenuation)
    ]
    if not laws:
        raise BadInput(
            f"hold names {min(held & set(CONSTANTS))}, and no light of the scene has a"
            " QuadraticAttenuation, whose value is what is kept"
        )
    constants = (laws[0].c0, laws[0].c1, laws[0].c2)
    return tuple(
        float(value) * distances.reference**power if name in held else None
        for power, (name, value) in enumerate(zip(CONSTANTS, constants, strict=True))
    )


def _distances(attenuation: type[AbstractAttenuation], groups: Sequence[Group]) -> Distances:
    """How far the lit points lie from the lights whose attenuation is asked for."""
    if attenuation is not QuadraticAttenuation:
        raise BadInput(
            f"attenuation is {attenuation!r}: give the type ds.QuadraticAttenuation to fit its"
            " constants, or None to take the scene's as known"
        )
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
