"""The circle of a ball's outline refined by its shading.

A mask says where the ball ends to some tenths of a pixel at best. The shading says more: highlights and
terminators lie where the normals put them. Centre and radius are unknowns of the image beside the
material's own,

    min over (cx, cy, radius, u) of |I - A(cx, cy, radius, u) k|^2,    k the best linear coefficients,

with A through the G-buffer of the sphere, and derivatives through all of it (variable projection: Golub
and Pereyra 1973). It is as right as the lights and the material are: a wrong tilt of all lights, or a
reflectance that the model lacks, moves the radius, which `standard_errors` can tell only as far as images
disagree.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from diffshade.errors import BadInput
from diffshade.geometry.camera import OrthographicCamera
from diffshade.geometry.sphere import Sphere
from diffshade.geometry.surface import Visibility
from diffshade.geometry.view import gbuffer as gbuffer_of
from diffshade.io.circle import Circle, ball_gbuffer
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from fitting.calibrate.image_residuals import descended, grams, linearised, rounding
from fitting.calibrate.jackknife import covariance
from fitting.columns import Photo, predict, scenery
from fitting.estimate import fit
from fitting.found import Fit
from fitting.limits import Bounds, limits
from fitting.linear import bounded_least_squares
from fitting.model import Model, default_material, model_of
from fitting.observation import in_precision, stacked
from fitting.project import gram_of

__all__ = ["RefinedCircle", "refine_circle"]

RIMS = (0.9, 0.98)
"""Of the radius: pixels beyond are not looked at, first as the circle may be too large, then as they are
partly background."""
MOST = 2**19
"""Pixels times images that are looked at, a fair sample of them."""
FARTHEST = 0.05
"""Of the radius, by which a circle may be refined."""
MAX_STEPS = 64


@dataclass(frozen=True, eq=False)
class RefinedCircle:
    """What shading makes of a circle: the circle, and by how much each number is uncertain, in pixels.

    The latter is infinite where the shading does not tell the number. `start` is what was given.
    `relative_residual` is that of the pixels that were looked at, `before` with the circle that was
    given. Where `at_limit`, the circle ran 5 % of the radius away, and is not to be trusted.
    """

    circle: Circle
    standard_errors: Circle
    start: Circle
    relative_residual: float
    before: float
    converged: bool
    at_limit: bool


class _Seen(eqx.Module):
    """Photographs at some pixels: numbers of these in the image, and what was observed there."""

    index: Array
    photos: Photo
    model: Model
    lower: Array
    upper: Array
    shape: tuple[int, int] = eqx.field(static=True)


def refine_circle(
    images: Sequence[Float[np.ndarray, "H W C"]],
    circle: Circle,
    scenes: Sequence[Scene],
    *,
    mask: Bool[np.ndarray, "H W"] | None = None,
    valid: Sequence[Bool[np.ndarray, "H W"]] | None = None,
    material: Material | None = None,
    bounds: Bounds | None = None,
) -> RefinedCircle:
    """Centre and radius of a ball seen from afar, from linear images of it under known lights.

    `images`, `scenes`, `valid`, `material` and `bounds` are those of `fitting.fit`, the scenes of one
    structure. `circle` is where to start, within 5 % of the radius. Pixels beyond 0.9 of its radius
    are left out at first, in the end those beyond 0.98 of the refined one. Raises
    `BadInput` as `fit` does.

    >>> import diffshade as ds
    >>> start, true = Circle(20, 20, 15), Circle(20.2, 19.9, 15.3)
    >>> scene = ds.Scene(lights=ds.ParallelLight((1, 1, 2)))
    >>> matte = ds.Material(kd=0.6)
    >>> image = np.asarray(ds.render(ball_gbuffer(true, (40, 40)), scene, matte))
    >>> found = refine_circle([image], start, [scene], material=matte)
    >>> [round(x, 2) for x in found.circle]
    [20.2, 19.9, 15.3]
    """
    shape = images[0].shape[:2]
    start = default_material(scenes) if material is None else material
    keep = _kept(shape, circle, mask, RIMS[0])
    first = _fitted(images, circle, keep, scenes, valid, start, bounds)
    around_it = _kept(shape, circle, mask, 1 + FARTHEST)
    seen = _seen(images, around_it, scenes, valid, start, bounds, first)
    u = np.log([float(first.coefficients[names[0]]) for names in seen.model.searched])
    scale = circle.radius
    around = np.array([circle.cx, circle.cy, circle.radius])
    center = jnp.asarray(around, seen.lower.dtype)
    y = jnp.asarray(np.concatenate([np.zeros(3), u]), seen.lower.dtype)
    box = limits(seen.model, frozenset(), start, bounds or {}, start_given=False).box
    far = np.full(3, FARTHEST * scale)
    edges = [np.concatenate([e, b]) for e, b in zip((-far, far), box, strict=True)]
    lower, upper = (jnp.asarray(edge, y.dtype) for edge in edges)
    at_first = y
    for rim in RIMS:
        there = Circle(*(around + np.asarray(y[:3], float)).tolist())
        looked_at = _looked_at(seen, _kept(shape, there, mask, rim))
        residual = eqx.Partial(_residual, looked_at, center)
        y, converged = descended(residual, y, lower, upper, MAX_STEPS)
    hessians, gradients, left = grams(linearised(residual, y))
    before = grams(linearised(residual, at_first))[2]
    count = float(np.sum(looked_at.photos.weight)) * looked_at.model.channel_count
    norm = float(jnp.linalg.norm(looked_at.photos.observed * looked_at.photos.weight[:, None]))
    noise = float(np.sqrt(left.sum() / max(count - y.size, 1)))
    eps = rounding(np.dtype(y.dtype), count)
    spread = covariance((hessians, gradients), noise=noise, eps=eps)
    errors = np.sqrt(np.diagonal(spread)[:3])
    moved = np.asarray(y[:3], float)
    return RefinedCircle(
        circle=Circle(*(around + moved).tolist()),
        standard_errors=Circle(*errors.tolist()),
        start=circle,
        relative_residual=float(np.sqrt(left.sum())) / norm,
        before=float(np.sqrt(before.sum())) / norm,
        converged=bool(converged),
        at_limit=bool((np.abs(moved) >= 0.999 * far).any()),
    )


def _kept(
    shape: tuple[int, int], circle: Circle, mask: Bool[np.ndarray, "H W"] | None, rim: float
) -> Bool[np.ndarray, "H W"]:
    """The pixels within so many radii."""
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    inside = np.hypot(x - circle.cx, y - circle.cy) < rim * circle.radius
    kept: Bool[np.ndarray, "H W"] = inside if mask is None else inside & mask
    if not kept.any():
        raise BadInput(f"{tuple(circle)} has no pixel inside the mask and the image: correct it")
    return kept


def _fitted(
    images: Sequence[np.ndarray],
    circle: Circle,
    keep: Bool[np.ndarray, "H W"],
    scenes: Sequence[Scene],
    valid: Sequence[np.ndarray] | None,
    material: Material,
    bounds: Bounds | None,
) -> Fit:
    """The material at the circle that is given, which a search may start from."""
    surface = ball_gbuffer(circle, (keep.shape[0], keep.shape[1]), keep)
    return fit(images, surface, scenes, material=material, bounds=bounds, valid=valid)


def _seen(
    images: Sequence[np.ndarray],
    keep: Bool[np.ndarray, "H W"],
    scenes: Sequence[Scene],
    valid: Sequence[np.ndarray] | None,
    material: Material,
    bounds: Bounds | None,
    first: Fit,
) -> _Seen:
    """What the refinement may look at."""
    channels = images[0].shape[2]
    index = np.flatnonzero(keep)
    index = index[:: max(len(index) * len(images) // MOST, 1)].astype(np.int32)
    dtype = np.dtype(jnp.asarray(0.0).dtype)
    used = np.stack([np.ones(len(index), bool)] * len(images))
    if valid is not None:
        used = np.stack([np.asarray(v).reshape(-1)[index] for v in valid])
    values = np.stack([np.asarray(image).reshape(-1, channels)[index].T for image in images])
    values = np.where(used[:, None], values, 0)
    ambient, lights = stacked([in_precision(s, dtype) for s in scenes], np, fitted_law=False)
    photos = Photo(ambient, lights, values.astype(dtype), used.astype(dtype), None, None)
    model = model_of(in_precision(first.material, dtype), frozenset(), channels)
    limit = limits(model, frozenset(), material, bounds or {}, start_given=False)
    low, high = (jnp.asarray(edge, dtype) for edge in (limit.lower, limit.upper))
    return _Seen(jnp.asarray(index), photos, model, low, high, (keep.shape[0], keep.shape[1]))


def _looked_at(seen: _Seen, keep: Bool[np.ndarray, "H W"]) -> _Seen:
    """The same with weight on some of the pixels only, so that it compiles once."""
    inside = keep.reshape(-1)[np.asarray(seen.index)]
    weight = np.asarray(seen.photos.weight) * inside.astype(np.asarray(seen.photos.weight).dtype)
    return eqx.tree_at(lambda s: s.photos.weight, seen, weight)


def _residual(
    seen: _Seen, center: Float[Array, "3"], y: Float[Array, "m"]
) -> Float[Array, "K C P"]:
    """What is left of every image at a circle, `y[:3]` pixels from `center`, and shapes `y[3:]`."""
    height, width = seen.shape
    cx, cy, radius = center + y[:3]
    ball = Sphere(jnp.stack([cx - width / 2, height / 2 - cy, 0 * cx]), radius)
    camera = OrthographicCamera(width, height, jnp.asarray(width, y.dtype))
    surface = gbuffer_of(ball, camera, Visibility(seen.shape, seen.index))

    def columns(photo: Photo) -> tuple[tuple[Array, ...], ...]:
        return seen.model.columns(y[3:], scenery(photo, surface, seen.model.material))

    each = jax.vmap(columns)(seen.photos)
    rows = [*each, tuple(jnp.moveaxis(seen.photos.observed, 1, 0))]
    count = seen.model.channel_count
    flat = [tuple(plane.reshape(-1) for plane in row) for row in rows]
    gram = gram_of(flat, count, seen.photos.weight.reshape(1, -1))
    k, _ = bounded_least_squares(gram[:, :-1, :-1], gram[:, :-1, -1], seen.lower, seen.upper)
    predicted = jnp.stack(predict(each, k), axis=1)
    return (seen.photos.observed - predicted) * seen.photos.weight[:, None]
