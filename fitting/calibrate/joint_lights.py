"""Directions and strengths of lights refined together with the material, and the lamp that moved.

Every image has an unknown direction and strength of its one distant light; all share the material. The
two are found in turns, each given the other, until neither changes: the material by `fitting.fit`, with
the weight of outliers taken, and each light by Gauss and Newton with weights likewise. The mean strength
is 1: a common one cannot be told from k_d and k_s.

A lamp has moved where its direction has changed against the one that was given, beyond its standard
error, beyond a lamp's own inaccuracy, and beyond what the others changed by: all of these may have
changed a little where the surface is not quite what it was taken for.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.parallel import ParallelLight
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from diffshade.shading.render import render
from fitting.estimate import fit
from fitting.found import Fit
from fitting.limits import Bounds
from fitting.null_space import spectrum
from fitting.weights import CAUCHY, MAD, Tukey

__all__ = ["MovedLight", "RefinedLights", "moved_lights", "refine_lights", "tangents"]

ROUNDS = 12
STEPS = 8
"""Of a light, given the material."""
LONGEST = 0.2
"""Radians, and parts of a strength: what a light changes by in one step."""
ARRIVED = 2e-4
"""Radians, and parts of a strength: changes that matter no more."""

DEGREES = 2.0
"""By which a lamp has to have moved at the least ..."""
SPREADS = 3.5
"""... and by so many robust standard deviations of the changes of all ..."""
ERRORS = 5.0
"""... and of its own standard errors."""
FEWEST = 4
"""Lights among which one can stand out."""


@dataclass(frozen=True)
class MovedLight:
    """A light, by the number of its image, that is not where it was said to be, and by how much."""

    image: int
    degrees: float
    standard_error: float
    reason: str


@dataclass(frozen=True, eq=False)
class RefinedLights:
    """Lights as the photographs want them, the material that goes with them, and which have moved.

    `directions` are unit vectors, `strengths` those beside the given intensities, of mean 1.
    `standard_errors` of the directions are in degrees, across all of them; `strength_errors` are
    parts of the strength. `changes` are degrees from the directions that were given.
    `relative_residual` is that of the `fit`, `before` with the lights that were given.
    """

    directions: Float[np.ndarray, "K 3"]
    strengths: Float[np.ndarray, "K"]
    standard_errors: Float[np.ndarray, "K"]
    strength_errors: Float[np.ndarray, "K"]
    changes: Float[np.ndarray, "K"]
    moved: tuple[MovedLight, ...]
    fit: Fit
    scenes: tuple[Scene, ...]
    relative_residual: float
    before: float
    converged: bool


def refine_lights(
    images: Sequence[Float[np.ndarray, "H W C"]],
    gbuffer: GBuffer,
    scenes: Sequence[Scene],
    *,
    material: Material | None = None,
    bounds: Bounds | None = None,
    valid: Sequence[Bool[np.ndarray, "H W"]] | None = None,
    robust: str | Tukey | None = "tukey",
) -> RefinedLights:
    """The direction and the strength of the one parallel light of each image, with the material.

    Arguments are those of `fitting.fit`; each scene has one `ParallelLight`. The surface is known:
    a turn of it is one of all lights, and cannot be told from that. `robust` takes the weight from
    outliers, shadows and a highlight that the model does not have among them; None is least squares,
    which lets the highlight tell where a light is. Standard errors are those of
    Gauss and Newton, the other lights and the material held; where the residual is not noise they
    are too small. Raises `BadInput` for other lights, and as `fit` does.
    """
    given = np.stack([_direction(scene) for scene in scenes])
    found, strengths = given.copy(), np.ones(len(scenes))
    lit: tuple[Scene, ...] = tuple(scenes)
    converged, residuals = False, []
    for _ in range(ROUNDS):
        best = fit(
            images,
            gbuffer,
            lit,
            material=material,
            bounds=bounds,
            valid=valid,
            robust=robust,
        )
        residuals.append(best.relative_residual)
        before, last = found, strengths
        each = [
            _light(
                image,
                gbuffer,
                scene,
                best.material,
                None if valid is None else valid[k],
                robust=robust is not None,
            )
            for k, (image, scene) in enumerate(zip(images, lit, strict=True))
        ]
        found = np.stack([one[0] for one in each])
        strengths = strengths * np.array([one[1] for one in each])
        strengths = strengths / strengths.mean()
        lit = tuple(_lit(scene, l, g) for scene, l, g in zip(scenes, found, strengths, strict=True))
        step = max(_degrees(before, found).max() * np.pi / 180, np.abs(strengths / last - 1).max())
        if converged := bool(step < ARRIVED):
            break
    errors, changes = np.array([one[2] for one in each]), _degrees(given, found)
    return RefinedLights(
        directions=found,
        strengths=strengths,
        standard_errors=errors[:, 0],
        strength_errors=errors[:, 1],
        changes=changes,
        moved=moved_lights(given, found, errors[:, 0]),
        fit=best,
        scenes=lit,
        relative_residual=residuals[-1],
        before=residuals[0],
        converged=converged,
    )


def moved_lights(
    given: Float[np.ndarray, "K 3"],
    found: Float[np.ndarray, "K 3"],
    standard_errors: Float[np.ndarray, "K"],
) -> tuple[MovedLight, ...]:
    """The lights that moved, from unit vectors before and after, and standard errors in degrees.

    >>> given = np.eye(3)[[0, 1, 2, 0, 1]]
    >>> found = np.concatenate([given[:4], [[0.0, 0.8, 0.6]]])
    >>> [light.image for light in moved_lights(given, found, np.full(5, 0.1))]
    [4]
    """
    changes = _degrees(given, found)
    if len(changes) < FEWEST:
        return ()
    middle = np.median(changes)
    spread = MAD * np.median(np.abs(changes - middle))
    far = (changes > DEGREES) & (changes > middle + SPREADS * spread)
    far &= changes > ERRORS * standard_errors
    return tuple(
        MovedLight(
            int(k),
            float(changes[k]),
            float(standard_errors[k]),
            f"its light is {changes[k]:.1f} +- {standard_errors[k]:.2f} degrees from where it was"
            f" said to be, where that of the typical image is {middle:.1f}: the lamp has moved, or"
            " its direction is another image's",
        )
        for k in np.flatnonzero(far)
    )


def _degrees(a: Float[np.ndarray, "K 3"], b: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K"]:
    """Angles between unit vectors."""
    across = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.asarray(np.degrees(np.arctan2(across, (a * b).sum(axis=-1))))


def _direction(scene: Scene) -> Float[np.ndarray, "3"]:
    if len(scene.lights) != 1 or not isinstance(scene.lights[0], ParallelLight):
        raise BadInput("a scene has not one parallel light: only the direction of that is refined")
    if scene.lights[0].visible is not None:
        raise BadInput("a light has the shadows of where it was: refine it first, then ds.shadowed")
    direction = np.asarray(scene.lights[0].direction, float)
    return np.asarray(direction / np.linalg.norm(direction))


def _lit(scene: Scene, direction: Float[np.ndarray, "3"], strength: float) -> Scene:
    """The scene with its light there, and so many times as strong."""
    light: Any = scene.lights[0]
    dtype = light.direction.dtype
    return eqx.tree_at(
        lambda s: (s.lights[0].direction, s.lights[0].intensity),
        scene,
        (jnp.asarray(direction, dtype), light.intensity * jnp.asarray(strength, dtype)),
    )


def _light(
    image: Float[np.ndarray, "H W C"],
    gbuffer: GBuffer,
    scene: Scene,
    material: Material,
    valid: Bool[np.ndarray, "H W"] | None,
    *,
    robust: bool,
) -> tuple[Float[np.ndarray, "3"], float, Float[np.ndarray, "2"]]:
    """Direction, times the strength, and their standard errors (degrees, parts), the material given."""
    start = scene
    used = gbuffer.mask if valid is None else gbuffer.mask & valid
    eps = float(jnp.finfo(gbuffer.normal.x.dtype).eps)
    observed = np.asarray(image, float)[used]
    for _ in range(STEPS):
        l = _direction(scene)
        across = tangents(l)
        predicted, slopes = _slopes(
            gbuffer, scene, material, jnp.asarray(across, gbuffer.normal.x.dtype)
        )
        left = observed - np.asarray(predicted, float)[used]
        jacobian = np.asarray(slopes, float)[:, used].reshape(3, -1)
        # Of all channels of a pixel at once, as what disturbs one disturbs all
        scale = MAD * float(np.median(np.abs(left))) or float(np.finfo(np.float32).tiny)
        square = (left**2).mean(axis=-1, keepdims=True) / (CAUCHY * scale) ** 2
        each = 1 / (1 + square) if robust else np.ones_like(square)
        weight = np.broadcast_to(each, left.shape).reshape(-1)
        weighed = jacobian * weight
        hessian = weighed @ jacobian.T
        if not np.diagonal(hessian).all():
            raise BadInput("an image shows nothing of its light: leave it out")
        if spectrum(hessian, np.ones(3, bool), eps).null.size:
            raise BadInput(
                "an image does not tell where its light is, as its surface shows too few normals: leave"
                " the light as it is"
            )
        step = np.linalg.solve(hessian, weighed @ left.reshape(-1))
        step *= min(1.0, LONGEST / float(np.abs(step).max() or 1.0))
        scene = _lit(scene, l + step[:2] @ across, 1 + step[2])
        if np.abs(step).max() < ARRIVED / 10:
            break
    noise = np.sqrt((weight * left.reshape(-1) ** 2).sum() / weight.sum())
    # Of weighted least squares, whose weights are not those of the variances (Huber 1981)
    spread = np.linalg.inv(hessian)
    errors = noise * np.sqrt(np.diagonal(spread @ ((weighed * weight) @ jacobian.T) @ spread))
    strength = float(np.mean(scene.lights[0].intensity / start.lights[0].intensity))
    both = np.array([np.degrees(np.hypot(*errors[:2])), errors[2]])
    return _direction(scene), strength, both


def tangents(l: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2 3"]:
    """Two unit vectors across a direction, and across each other."""
    first = np.cross(l, np.eye(3)[np.abs(l).argmin()])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(l, first)])


@jax.jit
def _slopes(
    gbuffer: GBuffer, scene: Scene, material: Material, across: Float[Array, "2 3"]
) -> tuple[Float[Array, "H W C"], Float[Array, "3 H W C"]]:
    """The image, and its derivatives by the light's direction across itself, and by its strength."""

    def image(x: Float[Array, "3"]) -> Float[Array, "H W C"]:
        light: Any = scene.lights[0]
        unit = light.direction / jnp.linalg.norm(light.direction)
        there = unit + x[:2] @ across
        here = eqx.tree_at(
            lambda s: (s.lights[0].direction, s.lights[0].intensity),
            scene,
            (there, light.intensity * (1 + x[2])),
        )
        return render(gbuffer, here, material)

    value, push = jax.linearize(image, jnp.zeros(3, across.dtype))
    return value, jax.vmap(push)(jnp.eye(3, dtype=across.dtype))
