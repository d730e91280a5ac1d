"""Images, surfaces and scenes as a caller gives them, checked and matched one to one."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from diffshade.arrays import ArrayLike, is_concrete
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.scene import Scene
from fitting.observation import View

__all__ = ["Photograph", "match", "traced_views", "views"]


class Photograph(NamedTuple):
    """One image with its surface, its lights, and which of its pixels are used."""

    image: Float[np.ndarray, "H W C"]
    gbuffer: GBuffer
    scene: Scene
    valid: Bool[np.ndarray, "H W"]
    clipped: Bool[np.ndarray, "H W C"] | None = None

    @property
    def unclipped(self) -> Bool[np.ndarray, "H W"]:
        """The used pixels whose value is what was there, in every channel."""
        return self.valid if self.clipped is None else self.valid & ~self.clipped.any(-1)


def match(
    images: ArrayLike | Sequence[ArrayLike],
    gbuffer: GBuffer | Sequence[GBuffer],
    scenes: Scene | Sequence[Scene],
    valid: ArrayLike | Sequence[ArrayLike] | None,
    clipped: ArrayLike | Sequence[ArrayLike] | None = None,
) -> list[Photograph]:
    """One photograph for every image; what is given once serves all."""
    pictures = [np.asarray(picture) for picture in _images(images)]
    count = len(pictures)
    surfaces = _one_each(gbuffer, GBuffer, count, "G-buffers")
    lights = _one_each(scenes, Scene, count, "scenes")
    masks = _masks(valid, count, "valid masks", (2,))
    limits = _masks(clipped, count, "masks of clipped pixels", (2, 3))
    photographs = [
        _photograph(k, *each)
        for k, each in enumerate(zip(pictures, surfaces, lights, masks, limits, strict=True))
    ]
    if not any(p.valid.any() for p in photographs):
        raise BadInput("no pixel is left to fit: every one is masked out, clipped or background")
    return photographs


def views(photographs: Sequence[Photograph]) -> list[View]:
    """The foreground of the photographs, as planes."""
    return [_view(photograph) for photograph in photographs]


def traced_views(
    images: ArrayLike | Sequence[ArrayLike],
    gbuffer: GBuffer | Sequence[GBuffer],
    scenes: Scene | Sequence[Scene],
    valid: ArrayLike | Sequence[ArrayLike] | None,
) -> list[View]:
    """What `views(match(...))` gives, of arrays that may be traced: their values are not looked at."""
    pictures = _images(images)
    count = len(pictures)
    surfaces = _one_each(gbuffer, GBuffer, count, "G-buffers")
    lights = _one_each(scenes, Scene, count, "scenes")
    masks = _masks(valid, count, "valid masks", (2,))
    return [
        _traced_view(k, *each)
        for k, each in enumerate(zip(pictures, surfaces, lights, masks, strict=True))
    ]


def _traced_view(k: int, image: Any, gbuffer: GBuffer, scene: Scene, valid: Any) -> View:
    _check_sizes(k, image, gbuffer, valid)
    dtype = gbuffer.normal.x.dtype
    xp: Any = np if is_concrete((valid, gbuffer.index)) else jnp

    def foreground(plane: Any) -> Any:
        flat = plane.reshape(-1, *plane.shape[2:])
        return flat if gbuffer.index is None else flat[xp.asarray(gbuffer.index)]

    inside = np.ones(gbuffer.shape, bool) if valid is None else xp.asarray(valid, bool)
    used = foreground(xp.asarray(inside))
    # Whatever lies outside the mask, NaN included, must not reach a derivative either.
    observed = jnp.where(used[:, None], foreground(jnp.asarray(image, dtype)), 0)
    return View(gbuffer, scene, observed, used.astype(dtype))


def _view(photograph: Photograph) -> View:
    image, gbuffer, scene, valid, clipped = photograph
    inside = gbuffer.mask
    weight = valid[inside].astype(image.dtype)
    return View(gbuffer, scene, image[inside], weight, None if clipped is None else clipped[inside])


def _images(images: Any) -> list[Any]:
    single = hasattr(images, "ndim")
    several = [images] if single else list(images)
    pictures = [np.asarray(each) if is_concrete(each) else each for each in several]
    if not pictures:
        raise BadInput("no images are given: give at least one")
    for k, picture in enumerate(pictures):
        if picture.ndim not in (2, 3) or not jnp.issubdtype(picture.dtype, jnp.floating):
            raise BadInput(
                f"image {k} has shape {picture.shape} and type {picture.dtype}: give linear radiance"
                " as floats, [H, W] or [H, W, C]"
            )
    pictures = [p[..., None] if p.ndim == 2 else p for p in pictures]
    if len(channels := {p.shape[2] for p in pictures}) > 1:
        raise BadInput(f"the images have {sorted(channels)} channels: give all the same number")
    return pictures


def _one_each(given: Any, kind: type, count: int, what: str) -> list[Any]:
    if isinstance(given, kind):
        return [given] * count
    several = list(given)
    if len(several) != count:
        raise BadInput(
            f"{len(several)} {what} for {count} images: give one for all, or one an image"
        )
    return several


def _masks(given: Any, count: int, what: str, dimensions: tuple[int, ...]) -> list[Any]:
    """One an image, from one for all, one an image, or none."""
    if given is None:
        return [None] * count
    if getattr(given, "ndim", None) in dimensions and (count == 1 or given.ndim == 2):
        return [given] * count
    several = list(given)
    if len(several) != count:
        raise BadInput(f"{len(several)} {what} for {count} images: give one, or one an image")
    return several


def _photograph(
    k: int, image: np.ndarray, gbuffer: GBuffer, scene: Scene, valid: Any, clipped: Any
) -> Photograph:
    _check_sizes(k, image, gbuffer, valid)
    inside = gbuffer.mask
    if valid is not None:
        inside = inside & np.asarray(valid, bool)
    limits = None
    if clipped is not None:
        limits = np.asarray(clipped, bool)
        if limits.shape not in (image.shape, image.shape[:2]):
            raise BadInput(
                f"the mask of clipped pixels of image {k} has shape {limits.shape}, the image"
                f" {image.shape}: give [H, W] or [H, W, C]"
            )
        limits = np.broadcast_to(limits.reshape(*limits.shape[:2], -1), image.shape)
        limits = limits & gbuffer.mask[..., None]
        inside = inside | limits.any(-1)
    if not np.isfinite(image[inside]).all():
        raise BadInput(
            f"image {k} holds NaN or infinity in a used pixel: leave those out by `valid`"
        )
    return Photograph(np.where(inside[..., None], image, 0), gbuffer, scene, inside, limits)


def _check_sizes(k: int, image: Any, gbuffer: GBuffer, valid: Any) -> None:
    if image.shape[:2] != gbuffer.shape:
        raise BadInput(
            f"image {k} is {image.shape[:2]} pixels and its G-buffer {gbuffer.shape}: sizes must match"
        )
    if valid is not None and np.shape(valid) != gbuffer.shape:
        raise BadInput(
            f"the valid mask of image {k} is {np.shape(valid)} pixels, the image"
            f" {gbuffer.shape}: sizes must match"
        )
