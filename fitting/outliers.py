"""Outliers in a sample: how strong the noise is beside them, and the sample without them."""

from dataclasses import replace

import jax
import jax.numpy as jnp
from jaxtyping import Float

from fitting.arrays import Array
from fitting.columns import Images, Scenery, images_of, predict
from fitting.model import Model
from fitting.observation import Group
from fitting.pages import in_double
from fitting.weights import Weighting, robust_scale

__all__ = ["noise", "without_outliers"]


@jax.jit
def noise(
    model: Model,
    sample: tuple[Group, ...],
    weighting: Weighting,
    u: Float[Array, "q"],
    k: Float[Array, "C p"],
    gains: Float[Array, "K"] | None,
) -> Float[Array, ""]:
    """The noise level at u and k, whatever outliers there are, from a fair sample of all images.

    In JAX's 64-bit mode it is summed in float64.
    """
    model, sample = in_double((model, sample))
    fair = tuple(group.part(slice(0, group.fair)) for group in sample)
    return _noise(model, images_of(fair, model.material, gains), weighting, u, k)


@jax.jit
def without_outliers(
    model: Model,
    sample: tuple[Group, ...],
    weighting: Weighting,
    u: Float[Array, "q"],
    k: Float[Array, "C p"],
) -> tuple[Group, ...]:
    """The sample with the weights that its points have at u and k."""
    images = images_of(sample, model.material)
    scale = _noise(model, images, weighting, u, k)

    def of_image(at: Scenery) -> Float[Array, "P"]:
        predicted = jnp.stack(predict(model.columns(u, at), k))
        weights = weighting.weights(predicted, at.photo.observed, scale, jnp.zeros((), bool))
        return at.photo.weight * weights[0]

    each = zip(sample, images.each(of_image), strict=True)
    return tuple(replace(group, weight=weight) for group, weight in each)


def _noise(
    model: Model, images: Images, weighting: Weighting, u: Float[Array, "q"], k: Float[Array, "C p"]
) -> Float[Array, ""]:
    def of_image(at: Scenery) -> tuple[Array, Array]:
        photo = at.photo
        predicted = jnp.stack(predict(model.columns(u, at), k))
        residual = weighting.standardised(predicted, photo.observed)
        known = jnp.broadcast_to(photo.weight[None] > 0, residual.shape)
        return residual, known if photo.clipped is None else known & ~photo.clipped

    residuals, used = zip(*images.each(of_image), strict=True)
    return robust_scale(
        jnp.concatenate([r.ravel() for r in residuals]), jnp.concatenate([m.ravel() for m in used])
    )
