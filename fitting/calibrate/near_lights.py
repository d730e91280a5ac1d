"""Near lamps, the ball that they light and its material, all refined together.

One mirror ball tells the ray on which a lamp stands, and not how far along it. The shading of a second
ball does: its highlight and its terminator see the lamp from somewhere else, and the light falls off
across it. Linear coefficients k, shapes u, the ball's place and the lamps are found together by

    min over theta of |I - A(ball, lamps, u) k|^2 + s^2 sum of (theta / sigma)^2,

the second sum being over what outline and rays are known to beforehand, by Levenberg's and Marquardt's
method on the normal equations, which are those of a few unknowns.

Errors are those of the estimate as it is (Huber 1967): with H = J'J + s^2 P, P = diag(sigma^-2),

    cov = H^-1 (M + s^2 s^2 P) H^-1,    M = sum over b of g_b g_b' + e^2 sum over j of c_j c_j'.

M is what the images' errors add to J'r. The pixels of a block of 16 x 16 are one observation, g_b (Liang
and Zeger 1986): JPEG codes such a block as a whole, and a model that is not quite right errs over a
neighbourhood. And codes of 8 bits are off: rounding, of Y, C_b and C_r above all, moves all pixels of one
colour alike by a fifth of a code, which no number of pixels averages away; c_j is what one code at
level j of a channel would add, e = 0.2. The noise s^2 = tr((J'J)^-1 M) / n is what pixels that knew
nothing of each other would have, to tell no more than these do: the residual's own would let the shading
outvote the rays.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from diffshade.errors import BadInput
from diffshade.geometry.camera import PerspectiveCamera
from diffshade.geometry.gbuffer import GBuffer
from diffshade.geometry.sphere import Sphere
from diffshade.geometry.surface import Visibility
from diffshade.geometry.view import gbuffer, visibility
from diffshade.io.encoding import decode
from diffshade.light.point import PointLight
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from fitting.calibrate.joint_lights import tangents
from fitting.calibrate.lit_ball import (
    OF_LAMP,
    OUTLINE,
    LitBall,
    moves_of,
    well_inside,
)
from fitting.calibrate.lit_ball_minimum import Minimum, descended
from fitting.columns import Photo
from fitting.estimate import fit
from fitting.limits import Bounds, limits
from fitting.model import default_material, linear_names, model_of
from fitting.observation import in_precision, stacked
from fitting.recovered import Recovery

__all__ = ["NearLights", "refine_near_lights"]

BLOCK = 16
"""Pixels along the side of what counts as one observation."""
FARTHEST = 0.04
"""Of the outline's radius, by which it may move."""
TURN, STRETCH = 0.3, 1.5
"""How far a ray may turn (radians), and a lamp move along it (the logarithm of its distance)."""
LEVELS = np.linspace(0, 1, 1021)
"""Codes, as parts of the largest, between which the curve of an encoding is straight enough."""


@dataclass(frozen=True, eq=False)
class NearLights:
    """Where the lamps are, the ball, the material, and how well all of that is known.

    `positions` and their `standard_errors` are NaN where an image has no lamp; `scenes` are those
    given with the lamps there, `gbuffer` is that of the ball at its place. `coefficients` are by
    name as those of `fitting.fit`, `intervals` those of 95 % with the places unknown too.
    `covariance` is that of the numbers `names`, of a shape that of its logarithm; infinite on the
    diagonal where the images do not tell. Intervals reach `reach` standard errors to each side.
    """

    positions: Float[np.ndarray, "K 3"]
    standard_errors: Float[np.ndarray, "K 3"]
    sphere: Sphere
    gbuffer: GBuffer
    scenes: tuple[Scene, ...]
    material: Material
    coefficients: dict[str, np.ndarray]
    intervals: dict[str, tuple[np.ndarray, np.ndarray]]
    names: tuple[str, ...]
    covariance: Float[np.ndarray, "m m"]
    reach: float
    relative_residual: float
    converged: bool

    def ratio(self, above: str, below: str) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """Of two linear coefficients in each channel, and its 95 % interval.

        What is common to all of them, such as an unknown exposure, cancels.
        """
        a, b = self.coefficients[above], self.coefficients[below]
        rows = np.zeros((len(a), len(self.names)))
        for channel, row in enumerate(rows):
            row[self.names.index(f"{above}[{channel}]")] = 1 / a[channel]
            row[self.names.index(f"{below}[{channel}]")] = -1 / b[channel]
        wide = np.exp(self.reach * np.sqrt(np.einsum("ci,ij,cj->c", rows, self.covariance, rows)))
        return a / b, (a / b / wide, a / b * wide)


def refine_near_lights(
    images: Sequence[Float[np.ndarray, "H W C"]],
    sphere: Sphere,
    camera: PerspectiveCamera,
    scenes: Sequence[Scene],
    *,
    points: Float[np.ndarray, "K 3"] | None = None,
    directions: Float[np.ndarray, "K 3"] | None = None,
    degrees: float | int = 0.3,
    outline: float | int = 0.2,
    material: Material | None = None,
    bounds: Bounds | None = None,
    valid: Sequence[Bool[np.ndarray, "H W"]] | None = None,
    encoding: str | float | None = None,
) -> NearLights:
    """The place of the lamp of each image, with the place of the ball that it lights and its material.

    `images` are linear; they, `material`, `bounds` and `valid` are those of `fitting.fit`. A scene has
    one `PointLight`, at a place to start from, or no light; the lamp is one lamp that was moved, so that
    its intensity is the scenes' own, but for one factor. `sphere` is the ball, of known radius, at the
    place that `sphere_of_circle` gives it; its outline is known to `outline` pixels (the standard
    deviation of each of centre and radius; 0: exactly). `points` and `directions` are the rays on which
    `mirrored` has the lamps, known to `degrees`; a scene's position then tells only the distance to
    start from. Rows of images without a lamp are not looked at. Without rays nothing is known of the
    lamps beforehand. `encoding` says what 8-bit files the images were decoded from ("srgb", "linear" or
    a gamma), whose rounding the intervals then allow for; None: from none.

    An exposure that is unknown is a factor on every k, as is the lamp's intensity on k_d and k_s: open
    the `bounds` above, and read `ratio`, in which it cancels, or divide by what a gray card tells.
    Errors of the mirror ball's outline turn all rays alike, which is not allowed for.

    Raises `BadInput` for other lights, a ball of which no pixel is seen, and as `fit` does.

    >>> import diffshade as ds
    >>> ball, camera = ds.Sphere((0, 0, -6)), ds.PerspectiveCamera(48, 48, 0.4, (0, 0, 0), (0, 0, -1))
    >>> surface, matte = ds.gbuffer(ball, camera), ds.Material(kd=0.5)
    >>> law = ds.InverseSquare()
    >>> true, start = (ds.Scene(lights=ds.PointLight(x, 9.0, law)) for x in ((2, 1, -3), (2, 2, -3)))
    >>> image = np.asarray(ds.render(surface, true, matte))
    >>> found = refine_near_lights([image], ball, camera, [start], outline=0, material=matte)
    >>> found.positions.round(2).tolist()
    [[2.0, 1.0, -3.0]]
    """
    lamps = [_lamp(scene) for scene in scenes]
    if not any(lamps):
        raise BadInput("no scene has a lamp: there is no position to refine")
    if (points is None) != (directions is None):
        raise BadInput("points and directions make rays together: give both, or neither")
    start, rays, distances = _rays(lamps, sphere, points, directions)
    places = start + distances[:, None] * rays[:, 0]
    moved = _moved(scenes, places)

    plain = default_material(scenes) if material is None else material
    surface = gbuffer(sphere, camera, pixels := well_inside(sphere, camera))
    first = fit(images, surface, moved, material=plain, bounds=bounds, valid=valid)
    dtype = np.dtype(surface.normal.x.dtype)
    model = model_of(in_precision(first.material, dtype), frozenset(), images[0].shape[2])
    moves, radius = moves_of(sphere, camera)
    block, blocks = _blocks(pixels)
    photos = _photos(images, pixels, moved, valid, dtype)
    levels = None if encoding is None else decode(LEVELS, encoding)
    given = moves, start, rays, distances, levels
    exact = LitBall(pixels.index, block, photos, model, camera, sphere, *given, blocks)
    seen = in_precision(exact, dtype)
    limit = limits(model, frozenset(), plain, bounds or {}, start_given=False)
    off = FARTHEST * radius if outline else 0.0
    of_lamps = np.array([[TURN, TURN, STRETCH] if lamp else [0.0] * 3 for lamp in lamps]).ravel()
    u = np.log([float(first.coefficients[names[0]]) for names in model.searched])
    k = np.stack([first.coefficients[name] for name in linear_names(model.material)], axis=-1)
    theta = np.concatenate([k.ravel(), [0.0] * OUTLINE, u, 0 * of_lamps])
    box = tuple(
        np.concatenate([linear.ravel(), [sign * off] * OUTLINE, of_u, sign * of_lamps])
        for sign, linear, of_u in zip((-1, 1), (limit.lower, limit.upper), limit.box, strict=True)
    )
    ray = np.inf if directions is None else np.radians(degrees)
    sigma = np.full(theta.size, np.inf)
    sigma[seen.linear : seen.linear + OUTLINE] = outline or np.inf
    sigma[seen.shared :].reshape(-1, OF_LAMP)[:, :2] = ray
    return _found(seen, scenes, descended(seen, theta, box, sigma))


def _rays(
    lamps: Sequence[PointLight | None],
    sphere: Sphere,
    points: Float[np.ndarray, "K 3"] | None,
    directions: Float[np.ndarray, "K 3"] | None,
) -> tuple[Float[np.ndarray, "K 3"], Float[np.ndarray, "K 3 3"], Float[np.ndarray, "K"]]:
    """Where rays start, their directions and two across each, and how far along it a lamp starts.

    Those of the first lamp stand for one that an image has not.
    """
    here = [k for k, lamp in enumerate(lamps) if lamp is not None]
    own = [k if lamp is not None else here[0] for k, lamp in enumerate(lamps)]
    at = np.array([np.asarray(lamps[k].position, float) for k in own])  # type: ignore[union-attr]
    start = np.asarray(sphere.center, float) + 0 * at if points is None else points[own]
    away = at - start
    l = away if directions is None else directions[own]
    l = l / np.linalg.norm(l, axis=-1, keepdims=True)
    rays = np.stack([[one, *tangents(one)] for one in l])
    return start, rays, np.linalg.norm(away, axis=-1)


def _lamp(scene: Scene) -> PointLight | None:
    """The one lamp of a scene, if it has one."""
    if not scene.lights:
        return None
    if len(scene.lights) > 1 or not isinstance(scene.lights[0], PointLight):
        raise BadInput("a scene has more than one point light, or another: give one, or none")
    return scene.lights[0]


def _moved(scenes: Sequence[Scene], places: Float[np.ndarray, "K 3"]) -> tuple[Scene, ...]:
    """The scenes with their lamps at those places."""

    def moved(scene: Scene, place: Float[np.ndarray, "3"]) -> Scene:
        if not scene.lights:
            return scene
        light: Any = scene.lights[0]
        there = jnp.asarray(place, light.position.dtype)
        return eqx.tree_at(lambda s: s.lights[0].position, scene, there)

    return tuple(moved(scene, place) for scene, place in zip(scenes, places, strict=True))


def _blocks(pixels: Visibility) -> tuple[Int[np.ndarray, "P"], int]:
    """Of each pixel the number of its block, and how many there are."""
    row, column = np.divmod(np.asarray(pixels.index), pixels.shape[1])
    block = np.unique(row // BLOCK * pixels.shape[1] + column // BLOCK, return_inverse=True)[1]
    return block.astype(np.int32), int(block.max()) + 1


def _photos(
    images: Sequence[Float[np.ndarray, "H W C"]],
    pixels: Visibility,
    scenes: Sequence[Scene],
    valid: Sequence[Bool[np.ndarray, "H W"]] | None,
    dtype: np.dtype,
) -> Photo:
    """What the photographs show at the pixels; without a lamp there is one of intensity 0."""
    index = np.asarray(pixels.index)
    lamp: Any = next(scene.lights[0] for scene in scenes if scene.lights)
    off = eqx.tree_at(lambda light: light.intensity, lamp, 0 * lamp.intensity)
    alike = [scene if scene.lights else Scene(scene.ambient, off) for scene in scenes]
    ambient, lights = stacked([in_precision(s, dtype) for s in alike], np, fitted_law=False)
    used = np.ones((len(images), len(index)), bool)
    if valid is not None:
        used = np.stack([np.asarray(v).reshape(-1)[index] for v in valid])
    channels = images[0].shape[2]
    values = np.stack([np.asarray(image).reshape(-1, channels)[index].T for image in images])
    values = np.where(used[:, None], values, 0)
    photos = Photo(ambient, lights, values.astype(dtype), used.astype(dtype), None, None)
    return jax.tree.map(jnp.asarray, photos)


def _found(seen: LitBall, scenes: Sequence[Scene], at: Minimum) -> NearLights:
    """The unknowns as what they stand for."""
    theta, dtype = at.theta, seen.distances.dtype
    k, u = np.asarray(seen.k(theta)), np.asarray(seen.u(theta))
    linear, shapes = linear_names(seen.model.material), seen.model.searched
    error = np.sqrt(np.diagonal(at.covariance))
    wide = at.reach * error[: k.size].reshape(k.shape)
    intervals = {n: (k[:, i] - wide[:, i], k[:, i] + wide[:, i]) for i, n in enumerate(linear)}
    for value, reach, names in zip(u, at.reach * seen.u(error), shapes, strict=True):
        ends = np.exp(value - reach), np.exp(value + reach)
        intervals |= dict.fromkeys(names, ends)
    numbers = [f"{name}[{c}]" for c in range(len(k)) for name in linear]
    own = np.r_[: k.size, k.size + OUTLINE : seen.shared]

    traced = jnp.asarray(theta, dtype)
    slope = np.asarray(jax.jacfwd(seen.positions)(traced), float)
    dark = np.array([not scene.lights for scene in scenes])
    positions = np.asarray(seen.positions(traced), float)
    finite = np.where(np.isfinite(at.covariance), at.covariance, 0)
    errors = np.sqrt(np.einsum("kim,mn,kin->ki", slope, finite, slope))
    sphere = seen.sphere(traced)
    recovery = Recovery(seen.model, np.full(k.shape, np.inf), 0.0)
    observed = float(jnp.sum((seen.photos.observed * seen.photos.weight[:, None]) ** 2))
    return NearLights(
        positions=np.where(dark[:, None], np.nan, positions),
        standard_errors=np.where(dark[:, None], np.nan, errors),
        sphere=sphere,
        gbuffer=gbuffer(sphere, seen.camera, visibility(sphere, seen.camera)),
        scenes=_moved(scenes, positions),
        material=recovery.material(k, u, dtype),
        coefficients={n: np.asarray(v) for n, v in recovery.coefficients(k, u).items()},
        intervals=intervals,
        names=(*numbers, *(names[0] for names in shapes)),
        covariance=at.covariance[np.ix_(own, own)],
        reach=at.reach,
        relative_residual=float(np.sqrt(at.square / observed)),
        converged=at.converged,
    )
