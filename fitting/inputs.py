"""Images, surfaces and scenes as a caller gives them, checked and matched one to one."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from diffshade.arrays import ArrayLike, is_concrete
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.visible import check_visible
from diffshade.scene import Scene

__all__ = ["Photograph", "Pixels", "Traced", "match", "traced"]

Pixels = Int[np.ndarray, "n"] | slice
"""Places in the rows of an image, one after the other."""


class Photograph(NamedTuple):
    """One image with its surface, its lights, and which of its pixels are used.

    `given` are the pixels that the caller allows (None: all), `clipped` the observations that a sensor
    clipped, which are used as "at least" whatever `given` says. The image is the caller's own array.
    """

    number: int
    image: Float[np.ndarray, "H W C"]
    gbuffer: GBuffer
    scene: Scene
    given: Bool[np.ndarray, "H W"] | None = None
    clipped: Bool[np.ndarray, "H W C"] | None = None

    @property
    def channel_count(self) -> int:
        """How many channels the image has."""
        return self.image.shape[2]

    @property
    def valid(self) -> Bool[np.ndarray, "H W"]:
        """The used pixels: of the foreground, allowed or clipped."""
        foreground = self.gbuffer.mask
        if self.given is None:
            return foreground
        allowed = self.given if self.clipped is None else self.given | self.clipped.any(-1)
        return foreground & allowed

    @property
    def unclipped(self) -> Bool[np.ndarray, "H W"]:
        """The used pixels whose value is what was there, in every channel."""
        return self.valid if self.clipped is None else self.valid & ~self.clipped.any(-1)

    @property
    def unclipped_count(self) -> int:
        """How many pixels are used and unclipped."""
        if self.given is None and self.clipped is None:
            return self.gbuffer.pixel_count
        return int(self.unclipped.sum())

    @property
    def brightest(self) -> float:
        """The largest observation of a used pixel."""
        return float(np.max(self.image, where=self.valid[..., None], initial=0.0))

    def check(self) -> None:
        """Raise `BadInput` where what was observed in a used pixel is not finite."""
        at = slice(None) if self.gbuffer.index is None else np.asarray(self.gbuffer.index)
        self.observed(at, self.used(at))

    def used(self, at: Pixels) -> Bool[np.ndarray, "n"] | None:
        """Which of the foreground pixels `at` are used; None for all of them."""
        if self.given is None:
            return None
        allowed = self.given.reshape(-1)[at]
        return allowed if self.clipped is None else allowed | self.clipped_at(at).any(0)

    def clipped_at(self, at: Pixels) -> Bool[np.ndarray, "C n"]:
        """Which observations of the pixels `at` are clipped."""
        assert self.clipped is not None
        return self.clipped.reshape(-1, self.channel_count)[at].T

    def observed(self, at: Pixels, used: Bool[np.ndarray, "n"] | None) -> Float[np.ndarray, "C n"]:
        """The radiance at the foreground pixels `at`, 0 where they are not used.

        Raises `BadInput` where it is not finite in a used pixel.
        """
        values = self.image.reshape(-1, self.channel_count)[at].T
        if used is not None:
            values = np.where(used, values, 0)
        # A sum is not finite where a part is not; a sum of huge numbers may not be either.
        if not np.isfinite(values.sum()) and not np.isfinite(values).all():
            raise BadInput(
                f"image {self.number} holds NaN or infinity in a used pixel: leave those out by"
                " `valid`"
            )
        return values


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
    if not any(p.gbuffer.pixel_count and (p.given is None or p.valid.any()) for p in photographs):
        raise BadInput("no pixel is left to fit: every one is masked out, clipped or background")
    return photographs


class Traced(NamedTuple):
    """One image whose values may be traced: of the foreground, and a weight each (0: not used)."""

    gbuffer: GBuffer
    scene: Scene
    observed: Float[Array, "C P"]
    weight: Float[Array, "P"]


def traced(
    images: ArrayLike | Sequence[ArrayLike],
    gbuffer: GBuffer | Sequence[GBuffer],
    scenes: Scene | Sequence[Scene],
    valid: ArrayLike | Sequence[ArrayLike] | None,
) -> list[Traced]:
    """What `match` gives, of arrays that may be traced: their values are not looked at."""
    pictures = _images(images)
    count = len(pictures)
    surfaces = _one_each(gbuffer, GBuffer, count, "G-buffers")
    lights = _one_each(scenes, Scene, count, "scenes")
    masks = _masks(valid, count, "valid masks", (2,))
    return [
        _traced(k, *each)
        for k, each in enumerate(zip(pictures, surfaces, lights, masks, strict=True))
    ]


def _traced(k: int, image: Any, gbuffer: GBuffer, scene: Scene, valid: Any) -> Traced:
    _check_sizes(k, image, gbuffer, scene, valid)
    dtype = gbuffer.normal.x.dtype
    at = slice(None) if gbuffer.index is None else jnp.asarray(gbuffer.index)
    observed = jnp.asarray(image, dtype).reshape(-1, image.shape[2])[at].T
    if valid is None:
        return Traced(gbuffer, scene, observed, jnp.ones(observed.shape[1], dtype))
    used = jnp.asarray(valid, bool).reshape(-1)[at]
    # Whatever lies outside the mask, NaN included, must not reach a derivative either.
    return Traced(gbuffer, scene, jnp.where(used, observed, 0), used.astype(dtype))


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
    _check_sizes(k, image, gbuffer, scene, valid)
    given = None if valid is None else np.asarray(valid, bool)
    if clipped is None:
        return Photograph(k, image, gbuffer, scene, given)
    limits = np.asarray(clipped, bool)
    if limits.shape not in (image.shape, image.shape[:2]):
        raise BadInput(
            f"the mask of clipped pixels of image {k} has shape {limits.shape}, the image"
            f" {image.shape}: give [H, W] or [H, W, C]"
        )
    if not limits.any():
        return Photograph(k, image, gbuffer, scene, given)
    limits = np.broadcast_to(limits.reshape(*limits.shape[:2], -1), image.shape)
    return Photograph(k, image, gbuffer, scene, given, limits)


def _check_sizes(k: int, image: Any, gbuffer: GBuffer, scene: Scene, valid: Any) -> None:
    check_visible(scene.lights, gbuffer.point_count)
    if image.shape[:2] != gbuffer.shape:
        raise BadInput(
            f"image {k} is {image.shape[:2]} pixels and its G-buffer {gbuffer.shape}: sizes must match"
        )
    if valid is not None and np.shape(valid) != gbuffer.shape:
        raise BadInput(
            f"the valid mask of image {k} is {np.shape(valid)} pixels, the image"
            f" {gbuffer.shape}: sizes must match"
        )
