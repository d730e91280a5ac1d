"""The door to fitting: images, surfaces and lights in, a material with its errors out."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from diffshade.arrays import ArrayLike
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.attenuation import AbstractAttenuation, QuadraticAttenuation
from diffshade.light.point import PointLight
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from diffshade.vector import Vec3, dot, length
from fitting.gauge import with_attenuation
from fitting.identify import Unidentified, unidentified
from fitting.inputs import Photograph, match, views
from fitting.limits import Bounds, Limits, limits
from fitting.model import CONSTANTS, Model, coefficient, default_material, held_names, linear_names
from fitting.observation import View, group_views
from fitting.project import Problem
from fitting.recovered import Recovery
from fitting.residual import ImageResidual, measure
from fitting.search import search
from fitting.uncertainty import propagate

__all__ = ["Fit", "fit"]


@dataclass(frozen=True)
class Fit:
    """What `fit` found.

    `material` and `scene` are of the types that were given, a tuple of scenes where several were.
    `coefficients` and `standard_errors` hold arrays by name: "ka", "kd", "specular.0.ks",
    "specular.0.shininess"; "attenuation.c0" and so on where an attenuation was fitted, and with it
    what was measured first, "reference.l0" to "l2" and k f(d0) as "reference.kd", at the distance
    d0 = `reference_distance`, where 1/f(d) = l0 + l1 d/d0 + l2 (d/d0)^2. Standard errors are
    infinite where the images do not tell; `unidentified` names what is not to be trusted, and why.
    `noise` is the standard deviation of the residual. `relative_residual` is that of `evaluate`.
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


def fit(
    images: ArrayLike | Sequence[ArrayLike],
    gbuffer: GBuffer | Sequence[GBuffer],
    scenes: Scene | Sequence[Scene],
    *,
    material: Material | None = None,
    attenuation: type[AbstractAttenuation] | None = None,
    hold: Iterable[str] = (),
    robust: object = None,
    bounds: Bounds | None = None,
    valid: ArrayLike | Sequence[ArrayLike] | None = None,
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

    Raises `BadInput` for images, G-buffers, scenes and masks that do not fit together, for images
    that are not finite in a used pixel, and for unknown names.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(32, 32, 2.2))
    >>> scene = ds.Scene(lights=ds.ParallelLight((1, 1, 2)))
    >>> image = ds.render(g, scene, ds.Material(kd=0.6, specular=ds.Phong(0.3, 20)))
    >>> round(float(fit(image, g, scene).material.specular[0].shininess), 2)
    20.0
    """
    if robust is not None:
        raise BadInput(f"robust is {robust!r}: least squares, robust=None, is what there is")
    photographs = match(images, gbuffer, scenes, valid)
    seen = views(photographs)
    start = default_material(p.scene for p in photographs) if material is None else material
    held = held_names(hold, start, attenuated=attenuation is not None)
    if material is None and held - set(CONSTANTS):
        raise BadInput(
            f"hold names {min(held - set(CONSTANTS))} and no material is given: its value is what is"
            " kept; give material="
        )
    distances = None if attenuation is None else _distances(attenuation, seen)
    dtype = seen[0].gbuffer.normal.x.dtype
    constants = _held_law(held, photographs, distances)
    model = _model(start, held, photographs[0].image.shape[2], distances, constants, dtype)
    limit = limits(model, held, start, bounds or {}, start_given=material is not None)
    found = search(_problem(model, limit, seen), limit.nodes, *limit.box)

    nearest = None if distances is None else jnp.asarray(distances[1], dtype)
    recovery = Recovery(found.model, jnp.asarray(limit.natural_upper, dtype), nearest)
    recovered, law = recovery.material(found.at.k, found.u)
    scenes_out = tuple(
        p.scene if law is None else with_attenuation(p.scene, law) for p in photographs
    )
    relit = [p._replace(scene=s) for p, s in zip(photographs, scenes_out, strict=True)]
    measured = measure(recovered, relit)
    observations = sum(int((view.weight > 0).sum()) for view in seen) * model.channel_count
    known = np.concatenate([limit.held.ravel(), found.model.known])
    uncertainty = propagate(found.at, found.u, known, observations, recovery.coefficients)
    values = {n: np.asarray(v) for n, v in recovery.coefficients(found.at.k, found.u).items()}
    free = {n: v for n, v in values.items() if n not in held}
    brightest = max(float(np.max(view.observed, initial=0.0)) for view in seen)
    return Fit(
        material=recovered,
        scene=scenes_out[0] if isinstance(scenes, Scene) else scenes_out,
        coefficients=values,
        standard_errors={n: e for n, e in uncertainty.standard_errors.items() if n in free},
        unidentified=unidentified(
            free,
            uncertainty,
            brightest,
            scaled=law is not None and not model.scaled,
            clamped=recovery.exceeds_one(found.u),
        ),
        relative_residual=measured.relative_residual,
        fraction_excluded=measured.fraction_excluded,
        per_image=measured.per_image,
        noise=uncertainty.noise,
        converged=found.converged,
        steps=found.steps,
        reference_distance=None if distances is None else distances[0],
    )


def _model(
    start: Material,
    held: frozenset[str],
    channel_count: int,
    distances: tuple[float, float] | None,
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
        distance=None if distances is None else jnp.asarray(distances[0], dtype),
        scaled=distances is not None
        and (bool(held & set(linear_names(start)) - {"ka"}) or any(held_law)),
        held_law=held_law,
    )


def _held_law(
    held: frozenset[str], photographs: Sequence[Photograph], distances: tuple[float, float] | None
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
        float(value) * distances[0] ** power if name in held else None
        for power, (name, value) in enumerate(zip(CONSTANTS, constants, strict=True))
    )


def _distances(attenuation: type[AbstractAttenuation], seen: Sequence[View]) -> tuple[float, float]:
    """The geometric mean distance between lights and the points they light, and the least."""
    if attenuation is not QuadraticAttenuation:
        raise BadInput(
            f"attenuation is {attenuation!r}: give the type ds.QuadraticAttenuation to fit its"
            " constants, or None to take the scene's as known"
        )
    logarithms, nearest = [], np.inf
    for view in seen:
        normal, position = view.gbuffer.normal, view.gbuffer.position
        lights = [light for light in view.scene.lights if isinstance(light, PointLight)]
        if lights and position is None:
            raise BadInput(
                "an attenuation is asked for, and the G-buffer has normals only, no positions"
            )
        for light in lights:
            distance, facing = (np.asarray(x) for x in _towards(light, normal, position))
            lit = (facing > 0) & (distance > 0)
            if view.gbuffer.spread is None:  # else points are not pixels, and have no weight
                lit = lit & (view.weight > 0)
            if lit.any():
                logarithms.append(np.log(distance[lit]))
                nearest = min(nearest, float(distance[lit].min()))
    if not logarithms:
        raise BadInput("an attenuation is asked for, and no point light lights a used pixel")
    return float(np.exp(np.mean(np.concatenate(logarithms)))), nearest


@jax.jit
def _towards(light: PointLight, normal: Vec3, position: Vec3) -> tuple[Array, Array]:
    to_light = Vec3.from_array(light.position) - position
    return length(to_light), dot(normal, to_light)


def _problem(model: Model, limit: Limits, seen: Sequence[View]) -> Problem:
    dtype = seen[0].gbuffer.normal.x.dtype
    squares = sum(float(np.sum(view.weight * view.observed**2)) for view in seen)
    problem = Problem(
        model=model,
        groups=group_views(seen),
        lower=jnp.asarray(limit.lower, dtype),
        upper=jnp.asarray(limit.upper, dtype),
        norm=jnp.asarray(squares**0.5 or 1.0, dtype),
        block_share=jnp.ones((), dtype),
    )
    # One precision throughout, that of the surface, whatever images and lights came in.
    return jax.tree.map(
        lambda x: x.astype(dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x, problem
    )
