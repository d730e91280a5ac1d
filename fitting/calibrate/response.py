"""The camera's response as a gamma, found from photographs of a known surface under known lights.

The encoded value of a radiance L is V = L^(1/g). Where the files do not say, g is one unknown beside the
material's: the k and u that make

    sum over images, pixels and channels of (V - (A(u) k)^(1/g))^2

least, in the space in which the sensor's noise is nearly even. Compared in linear space a large g would
always win, as it makes all values small. Brightness that is lost or gained by exposure or white balance
is none of g's: both belong into the lights' intensities, and are never guessed here.

A residual of several per cent is no noise. Pixels of one image err together, by its light; those of one
brightness do so in all images, by what the material lacks, which a gamma makes up for. The jackknife
tells both, over images and over bands of brightness, and the variances add.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from diffshade import guard
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.io.encoding import decode
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from fitting.calibrate.image_residuals import descended, grams, linearised, rounding
from fitting.calibrate.jackknife import FEWEST, covariance, half_width
from fitting.calibrate.sampled import sampled
from fitting.columns import Photo, predict, scenery
from fitting.estimate import fit
from fitting.limits import Bounds, limits
from fitting.model import Model, default_material, linear_names, model_of
from fitting.observation import in_precision, stacked

__all__ = ["Response", "fit_gamma"]

GAMMAS = (0.3, 4.0)
"""Between which g is sought."""
MOST = 2**16
"""Pixels times images that are looked at, a fair sample of them."""
BANDS = 16
"""Of brightness, each of as many pixels."""
MAX_STEPS = 100


@dataclass(frozen=True, eq=False)
class Response:
    """V = L^(1/gamma): gamma, its standard error and its 95 % interval, from so many images.

    Where the images do not tell gamma the error is infinite. The interval is cut off at the ends of
    what is sought, 0.3 and 4: one of all that tells nothing.
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
    images, surface, valid = sampled(encoded, gbuffer, valid, MOST)
    linear = [decode(image, start) for image in images]
    first = fit(linear, surface, scenes, material=given, bounds=bounds, valid=valid)
    model = model_of(in_precision(first.material, dtype), frozenset(), channels)
    used = np.concatenate(valid)
    values = np.concatenate(images).swapaxes(1, 2)
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
    there = linearised(residual, found)
    of_images = grams(there)
    left = of_images[2].sum()
    count = float(np.sum(seen.photos.weight)) * model.channel_count
    free = np.asarray((found > low_edge) & (found < high_edge))
    noise = float(np.sqrt(left / max(count - free.sum(), 1)))
    log_gamma = float(found[0])
    at_limit = not bool(free[0])
    error = np.inf
    if not at_limit:
        groupings = [
            (hessians[:, free][:, :, free], gradients[:, free])
            for hessians, gradients, _ in (of_images, grams(there, _bands(seen, there[0])))
        ]
        variances = np.diagonal(covariance(*groupings, noise=noise, eps=rounding(dtype, count)))
        error = float(np.sqrt(variances[0]))
    wide = half_width(error, min(len(encoded), BANDS) if len(encoded) >= FEWEST else BANDS)
    wide = min(wide, high - low)
    gamma = float(np.exp(log_gamma))
    norm = float(np.linalg.norm(values))
    return Response(
        gamma=gamma,
        standard_error=gamma * error,
        interval=(
            max(gamma * float(np.exp(-wide)), GAMMAS[0]),
            min(gamma * float(np.exp(wide)), GAMMAS[1]),
        ),
        relative_residual=float(np.sqrt(left)) / norm,
        images=len(encoded),
        converged=bool(converged),
        at_limit=at_limit,
    )


def _bands(seen: _Seen, residual: Float[Array, "K C P"]) -> Int[np.ndarray, "K P"]:
    """Which of the bands of about one brightness each pixel is in, in all images together."""
    weight = np.asarray(seen.photos.weight)
    predicted = np.asarray(seen.photos.observed) * weight[:, None] - np.asarray(residual)
    brightness = predicted.mean(axis=1)
    edges = np.quantile(brightness[weight > 0], np.linspace(0, 1, BANDS + 1)[1:-1])
    return np.digitize(brightness, edges)


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
