"""The door to fitting: images, surfaces and lights in, a material with its errors out."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from diffshade.arrays import ArrayLike
from diffshade.devices import Devices, mesh_over
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.attenuation import AbstractAttenuation, InverseSquare, Windowed
from diffshade.light.point import PointLight
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from fitting.attempt import Attempt, attempted, searched
from fitting.basins import Solver
from fitting.certificate import certify as prove
from fitting.clamp import CLEAR, may_show, with_clamp
from fitting.devices import check_same_input
from fitting.found import Fit
from fitting.gauge import CONSTANTS, PolynomialGauge, gauge_of, lengths, with_attenuation
from fitting.inputs import Photograph, match
from fitting.known_scale import scaled, unscaled
from fitting.likelihood import rounding
from fitting.limits import Bounds, Grid, Limits, ceiling_grid, limits
from fitting.model import Model, default_material, held_names, linear_names, model_of, sets_scale
from fitting.observed import Observed
from fitting.profile import profile
from fitting.recovered import clamped_within
from fitting.weights import SensorNoise, Tukey, Weighting

__all__ = ["fit"]


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
    solver: Solver | None = None,
    devices: Devices | None = None,
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
      "specular.shininess", "specular.alpha", "specular.fresnel.index", "body.index", or "specular.0.ks"
      for one lobe (the indices of one boundary are one number); and "attenuation.c0" and so on at their
      value in the scene's lights.
    - `bounds`: lower and upper by name, by default 0 and 1 for each k (None: unbounded), 0.1 and
      100,000 for the shininess, and for each other shape what `fitting.shapes` has (None: these).
      They hold at every step. Beside the constants of a quadratic or linear attenuation k_d and k_s
      have no scale of their own, and no upper bound, unless one of them or of the constants is held,
      or the clamp is seen.
    - `valid`: which pixels to use [H, W], one or one an image; by default all of the foreground.
    - `robust`: "tukey" (or `fitting.Tukey(c)`) takes the weight from outliers, such as shadows.
    - `clipped`: observations that a sensor clipped, [H, W] or [H, W, C], one or one an image: they
      say "at least", whatever `valid` says of them. The residual that is reported leaves them out.
    - `noise`: a `fitting.SensorNoise`, by which brighter observations may count less.
    - `gains`: whether the lights of each image have an unknown strength beside the scene's; the
      mean over the images is 1, for their common scale cannot be told from k_d and k_s.
    - `certify`: whether to prove that the minimum is global, where one shininess is all that is
      searched: `fit.certificate` says what was proven. It takes some ten passes over the data.
    - `profiles`: whether to compute the residual over each shape that is searched, for plots.
    - `solver`: any Optimistix least-squares solver in place of our own bounded one, to compare.
    - `devices`: JAX devices, or a mesh of them with one axis, to share the pixels of every page out
      over; by default one. They may be those of several processes joined by
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
    mesh = None if devices is None else mesh_over(devices)
    photographs = match(images, gbuffer, scenes, valid, clipped)
    weighting = _weighting(robust, noise, any(p.clipped is not None for p in photographs))
    windows = [getattr(x, "attenuation", None) for p in photographs for x in p.scene.lights]
    if attenuation is not None and any(isinstance(law, Windowed) for law in windows):
        raise BadInput(
            "a light has an attenuation with a window (Windowed), which a fit of its constants would"
            " drop: give attenuation=None, or lights without a reach"
        )
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
            scale_known=sets_scale(start, held) or any(fixed),
        )
        model = replace(model, gauge=gauge)

    def limited(model: Model, held: frozenset[str]) -> Limits:
        return limits(model, held, start, bounds or {}, start_given=material is not None)

    def attempt(model: Model, grid: Grid | None = None) -> Attempt:
        limit = limited(model, held)
        free = unscaled(model)
        if grid is None and free is not None:
            loose = limited(free, held - {n for n in linear_names(start) if n != "ka"})
            basins = searched(observed, free, loose, weighting, solver)
            basins = scaled(basins, model, limit)
        else:
            grid = limit.grid if grid is None else grid
            basins = searched(observed, model, replace(limit, grid=grid), weighting, solver)
        return attempted(observed, model, limit, basins, weighting, gains)

    best = _clamped(attempt, attempt(model), observed)
    box = best.limit.box
    drawn = len(model.searched) if profiles else 0
    return Fit.of(
        best,
        observed,
        held,
        one_scene=isinstance(scenes, Scene),
        certificate=prove(observed, best.minimum, box) if certify else None,
        profiles=tuple(profile(observed, best.minimum, box, which=k) for k in range(drawn)),
    )


def _clamped(
    attempt: Callable[[Model, Grid], Attempt], plain: Attempt, observed: Observed
) -> Attempt:
    """The fit with LIGHT-12's clamp, where the images show it at some points and not at others.

    Where the scale of the law is known the clamp is part of it, and only may begin elsewhere.
    """
    minimum, likelihood = plain.minimum, plain.likelihood
    gauge = minimum.problem.model.gauge
    known = isinstance(gauge, PolynomialGauge) and gauge.clamped
    model = minimum.problem.model if known else with_clamp(minimum.problem.model)
    if model is None or minimum.cost <= rounding(minimum.square, observed.dtype):
        return plain
    if not known and not may_show(minimum, observed):
        return plain
    nearest, farthest = minimum.nearest, minimum.farthest
    lobes = plain.limit.grid if known else minimum.u[: len(model.searched)].tolist()
    clamped = attempt(model, ceiling_grid(model, nearest, farthest, lobes))
    within = clamped_within(clamped.minimum.problem.model, clamped.minimum.u)
    shown = known or nearest < within < farthest
    clear = 0.0 if known else CLEAR
    return clamped if shown and clamped.likelihood.bic + clear < likelihood.bic else plain


def _weighting(
    robust: str | Tukey | None, noise: SensorNoise | None, clipped: bool
) -> Weighting | None:
    """What was asked for about noise; None where least squares is all."""
    if isinstance(robust, str):
        if robust != "tukey":
            raise BadInput(f'robust is {robust!r}: give "tukey", a fitting.Tukey, or None')
        robust = Tukey()
    if robust is None and noise is None and not clipped:
        return None
    return Weighting(robust, noise)


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
    for name in CONSTANTS[attenuation]:
        values = {float(getattr(law, name)) for law in laws}
        if f"attenuation.{name}" in held and len(values) > 1:
            raise BadInput(
                f"hold names attenuation.{name}, of which the lights have different values,"
                f" {min(values):g} to {max(values):g}: give all of them the one that is kept"
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
