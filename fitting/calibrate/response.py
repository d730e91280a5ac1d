"""The camera's response as a gamma, found from photographs of a known surface under known lights.

The encoded value of a radiance L is V = L^(1/g). Where the files do not say, g is one unknown beside the
material's: the k and u that make

    sum over images, pixels and channels of (V - (A(u) k)^(1/g))^2

least, in the space in which the sensor's noise is nearly even. Compared in linear space a large g would
always win, as it makes all values small. Its interval is by how the images disagree (the jackknife), as a
residual of several per cent is no noise. Brightness that is lost or gained by exposure or white balance
is none of g's: both belong into the lights' intensities, and are never guessed here.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from diffshade import guard
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.io.encoding import decode
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from fitting.calibrate.image_residuals import descended, grams
from fitting.calibrate.jackknife import covariance, half_width
from fitting.columns import Photo, predict, scenery
from fitting.estimate import fit
from fitting.limits import Bounds, limits
from fitting.model import Model, default_material, linear_names, model_of
from fitting.observation import in_precision, stacked

__all__ = ["Response", "fit_gamma"]

GAMMAS = (0.3, 4.0)
"""Between which g is sought."""
MOST = 2**18
"""Pixels times images that are looked at, a fair sample of them."""
MAX_STEPS = 100


@dataclass(frozen=True, eq=False)
class Response:
    """V = L^(1/gamma): gamma, its standard error and its 95 % interval, from so many images.

    `relative_residual` is that of the encoded values. `at_limit` says that gamma ran to the end of what
    is sought, and is not told.
    """

    gamma: float
    standard_error: float
    interval: tuple[float, float]
    relative_residual: float
    images: int
    converged: bool
    at_limit: bool


class _Seen(eqx.Module):
    photos: Photo
    surface: GBuffer
    model: Model


def fit_gamma(
    encoded: Sequence[Float[np.ndarray, "H W C"]],
    gbuffer: GBuffer,
    scenes: Sequence[Scene],
    *,
    material: Material | None = None,
    bounds: Bounds | None = None,
    valid: Sequence[Bool[np.ndarray, "H W"]] | None = None,
    start: float = 2.2,
) -> Response:
    """The gamma of photographs as encoded, full scale 1, of a known surface under known lights.

    Arguments are those of `fitting.fit`, the scenes of one structure; leave out what is clipped
    (`valid`). A gamma is told by how brightness falls over a surface: of one light and a matte
    material that is a few degrees of freedom, and a wrong model turns into a wrong gamma. Raises
    `BadInput` as `fit` does.
    """
    dtype = np.dtype(jnp.asarray(0.0).dtype)
    channels = encoded[0].shape[2]
    given = default_material(scenes) if material is None else material
    linear = [decode(image, start) for image in encoded]
    first = fit(linear, gbuffer, scenes, material=given, bounds=bounds, valid=valid)
    model = model_of(in_precision(first.material, dtype), frozenset(), channels)
    if gbuffer.spread is not None:
        raise BadInput("the G-buffer is shaded by faces or vertices: give one of its pixels")
    every = max(gbuffer.pixel_count * len(encoded) // MOST, 1)
    normal, position = jax.tree.map(
        lambda plane: plane[::every], (gbuffer.normal, gbuffer.position)
    )
    surface = GBuffer((1, normal.x.shape[0]), normal, gbuffer.viewer, position)
    at = np.flatnonzero(gbuffer.mask)[::every]
    used = np.ones((len(encoded), len(at)), bool)
    if valid is not None:
        used = np.stack([np.asarray(v).reshape(-1)[at] for v in valid])
    values = np.stack([np.asarray(image).reshape(-1, channels)[at].T for image in encoded])
    values = np.where(used[:, None], values, 0)
    if (values < 0).any():
        raise BadInput("an image holds values below 0, which no gamma encodes: leave those out")
    ambient, lights = stacked([in_precision(s, dtype) for s in scenes], np, fitted_law=False)
    photos = Photo(ambient, lights, values.astype(dtype), used.astype(dtype), None, None)
    seen = _Seen(photos, surface, model)
    limit = limits(model, frozenset(), given, bounds or {}, start_given=False)
    k = np.stack(
        [
            np.broadcast_to(first.coefficients[name], channels)
            for name in linear_names(model.material)
        ],
        axis=-1,
    )
    u = [float(np.log(first.coefficients[names[0]])) for names in model.searched]
    theta = np.concatenate([[np.log(start)], u, k.reshape(-1)])
    low, high = (np.log(g) for g in GAMMAS)
    lower = np.concatenate([[low], limit.box[0], limit.lower.reshape(-1)])
    upper = np.concatenate([[high], limit.box[1], limit.upper.reshape(-1)])
    start_at, low_edge, high_edge = (jnp.asarray(x, dtype) for x in (theta, lower, upper))
    residual = eqx.Partial(_residual, seen)
    found, converged = descended(residual, start_at, low_edge, high_edge, MAX_STEPS)
    hessians, gradients, left = (np.asarray(x, float) for x in grams(residual, found))
    count = float(np.sum(seen.photos.weight)) * model.channel_count
    free = np.asarray((found > low_edge) & (found < high_edge))
    noise = float(np.sqrt(left.sum() / max(count - free.sum(), 1)))
    log_gamma = float(found[0])
    at_limit = not bool(free[0])
    error = np.inf
    if not at_limit:
        chosen = hessians[:, free][:, :, free]
        error = float(np.sqrt(covariance(chosen, gradients[:, free], noise)[0, 0]))
    wide = half_width(error, len(encoded)) if np.isfinite(error) else np.inf
    gamma = float(np.exp(log_gamma))
    norm = float(np.linalg.norm(values))
    return Response(
        gamma=gamma,
        standard_error=gamma * error,
        interval=(float(np.exp(log_gamma - wide)), float(np.exp(log_gamma + wide))),
        relative_residual=float(np.sqrt(left.sum())) / norm,
        images=len(encoded),
        converged=bool(converged),
        at_limit=at_limit,
    )


def _residual(seen: _Seen, theta: Float[Array, "m"]) -> Float[Array, "K C P"]:
    """V - (A k)^(1/g) of every image."""
    model, count = seen.model, len(seen.model.searched)
    gamma, u = jnp.exp(theta[0]), theta[1 : 1 + count]
    k = theta[1 + count :].reshape(model.channel_count, model.column_count)

    def of_image(photo: Photo) -> Float[Array, "C P"]:
        predicted = predict(model.columns(u, scenery(photo, seen.surface, model.material)), k)
        encoded = jnp.stack([guard.power(plane, 1 / gamma) for plane in predicted])
        return (photo.observed - encoded) * photo.weight[None]

    return jax.vmap(of_image)(seen.photos)
