"""Images, surfaces and scenes as a caller gives them, checked and matched one to one."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from diffshade.arrays import ArrayLike
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.scene import Scene
from fitting.observation import View

__all__ = ["Photograph", "match", "views"]


class Photograph(NamedTuple):
    """One image with its surface, its lights, and which of its pixels are used."""

    image: Float[np.ndarray, "H W C"]
    gbuffer: GBuffer
    scene: Scene
    valid: Bool[np.ndarray, "H W"]


def match(
    images: ArrayLike | Sequence[ArrayLike],
    gbuffer: GBuffer | Sequence[GBuffer],
    scenes: Scene | Sequence[Scene],
    valid: ArrayLike | Sequence[ArrayLike] | None,
) -> list[Photograph]:
    """One photograph for every image; what is given once serves all."""
    pictures = _images(images)
    count = len(pictures)
    surfaces = _one_each(gbuffer, GBuffer, count, "G-buffers")
    lights = _one_each(scenes, Scene, count, "scenes")
    masks: list[Any]
    if valid is None:
        masks = [None] * count
    elif getattr(valid, "ndim", None) == 2:
        masks = [valid] * count
    else:
        masks = list(valid)  # type: ignore[arg-type]
        if len(masks) != count:
            raise BadInput(
                f"{len(masks)} valid masks for {count} images: give one, or one an image"
            )
    photographs = [
        _photograph(k, *each)
        for k, each in enumerate(zip(pictures, surfaces, lights, masks, strict=True))
    ]
    if len(channels := {p.image.shape[2] for p in photographs}) > 1:
        raise BadInput(f"the images have {sorted(channels)} channels: give all the same number")
    if not any(p.valid.any() for p in photographs):
        raise BadInput("no pixel is left to fit: every one is masked out, clipped or background")
    return photographs


def views(photographs: Sequence[Photograph]) -> list[View]:
    """The foreground of the photographs, as planes."""
    return [
        View(p.gbuffer, p.scene, p.image[p.gbuffer.mask].T, p.valid[p.gbuffer.mask].astype(float))
        for p in photographs
    ]


def _images(images: Any) -> list[np.ndarray]:
    single = hasattr(images, "ndim")
    pictures = [np.asarray(images)] if single else [np.asarray(image) for image in images]
    if not pictures:
        raise BadInput("no images are given: give at least one")
    for k, picture in enumerate(pictures):
        if picture.ndim not in (2, 3) or not np.issubdtype(picture.dtype, np.floating):
            raise BadInput(
                f"image {k} has shape {picture.shape} and type {picture.dtype}: give linear radiance"
                " as floats, [H, W] or [H, W, C]"
            )
    return [p[..., None] if p.ndim == 2 else p for p in pictures]


def _one_each(given: Any, kind: type, count: int, what: str) -> list[Any]:
    if isinstance(given, kind):
        return [given] * count
    several = list(given)
    if len(several) != count:
        raise BadInput(
            f"{len(several)} {what} for {count} images: give one for all, or one an image"
        )
    return several


def _photograph(
    k: int, image: np.ndarray, gbuffer: GBuffer, scene: Scene, valid: Any
) -> Photograph:
    if image.shape[:2] != gbuffer.shape:
        raise BadInput(
            f"image {k} is {image.shape[:2]} pixels and its G-buffer {gbuffer.shape}: sizes must match"
        )
    inside = gbuffer.mask
    if valid is not None:
        mask = np.asarray(valid, bool)
        if mask.shape != gbuffer.shape:
            raise BadInput(
                f"the valid mask of image {k} is {mask.shape} pixels, the image"
                f" {gbuffer.shape}: sizes must match"
            )
        inside = inside & mask
    if not np.isfinite(image[inside]).all():
        raise BadInput(
            f"image {k} holds NaN or infinity in a used pixel: leave those out by `valid`"
        )
    return Photograph(np.where(inside[..., None], image, 0), gbuffer, scene, inside)
