"""One material for every region, found by `fit` from the region's pixels alone."""

from collections.abc import Callable
from math import inf

import numpy as np
from jaxtyping import Int

from diffshade.arrays import ArrayLike
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.visible import map_visible
from diffshade.reflectance.material import Material
from diffshade.shading.render import render
from diffshade.vector import Vec3
from fitting.estimate import fit
from fitting.identify import LEAST_SHARE, NOISE, TOLERANCE
from fitting.inputs import Photograph
from fitting.limits import Bounds
from fitting.map_planes import MapPlanes, map_names, width
from fitting.model import linear_names
from fitting.shapes import is_shape

__all__ = ["RegionWork", "region_labels"]


class RegionWork:
    """Regions of pixels, each with one material, found by `fit` from its own pixels alone."""

    def __init__(
        self,
        photographs: list[Photograph],
        material: Material,
        bounds: Bounds | None,
        labels: Int[np.ndarray, "P"],
        brightest: float,
    ) -> None:
        self.photographs, self.material = photographs, material
        self.bounds, self.brightest = bounds, brightest
        index = photographs[0].gbuffer.index
        self.at = np.arange(len(labels)) if index is None else np.asarray(index)
        order = np.argsort(labels, kind="stable")
        first = np.flatnonzero(np.diff(labels[order], prepend=labels[order[:1]] - 1))
        self.pixels = np.split(order, first[1:])
        self.none = [bool(labels[pixels[0]] < 0) for pixels in self.pixels]
        pairs = sorted((bounds or {}).items())
        self.options = (labels, brightest, material, str(pairs).encode().hex())

    def begin(self, i: int) -> Callable[[], MapPlanes]:
        """Nothing is under way before it is waited for: `fit` does not return sooner."""
        return lambda: self._fit(self.pixels[i], self.none[i])

    def _fit(self, pixels: Int[np.ndarray, "n"], none: bool) -> MapPlanes:
        gbuffer = _part(self.photographs[0].gbuffer, pixels)
        where = self.at[pixels]
        channel_count = self.photographs[0].channel_count
        masks = [p.used(where) for p in self.photographs]
        each = zip(self.photographs, masks, strict=True)
        images = [p.observed(where, used).T[None] for p, used in each]
        everything = np.ones((1, len(where)), bool)
        valid = [everything if used is None else used[None] for used in masks]
        scenes = [map_visible(lambda plane: plane[pixels], p.scene) for p in self.photographs]
        square = sum(
            (np.sum(image.astype(float) ** 2, axis=(0, 2)) for image in images), np.zeros(())
        )
        if none or not any(mask.any() for mask in valid):
            return self._nothing(len(pixels), channel_count, square)
        found = fit(
            images, gbuffer, scenes, material=self.material, bounds=self.bounds, valid=valid
        )
        left = np.zeros(len(pixels))
        for image, mask, scene in zip(images, valid, scenes, strict=True):
            off = np.asarray(render(gbuffer, scene, found.material), float) - image
            left += np.sum(np.where(mask[..., None], off, 0) ** 2, axis=(0, 2))
        unknown = {name for item in found.unidentified for name in item.coefficients}
        unit = found._uncertainty.unit_errors
        largest = max(np.max(found.coefficients[name]) for name in linear_names(self.material))
        rows: dict[str, list[np.ndarray]] = {name: [] for name in MapPlanes._fields[:4]}
        for name in map_names(self.material):
            shape = (width(name, channel_count),)
            value, error, nominal = (
                np.broadcast_to(x[name], shape).astype(float)
                for x in (found.coefficients, found.standard_errors, unit)
            )
            nominal = np.where(np.isfinite(nominal), NOISE * self.brightest * nominal, inf)
            size = value if is_shape(name) else np.maximum(value, LEAST_SHARE * largest)
            known = (np.maximum(nominal, error) <= TOLERANCE * size) & (size > 0)
            rows["values"].append(value)
            rows["standard_errors"].append(error)
            rows["nominal_errors"].append(nominal)
            rows["identified"].append(known & (name not in unknown) & found.converged)
        dtype = gbuffer.normal.x.dtype
        spread = {
            name: np.repeat(np.concatenate(row)[:, None], len(pixels), axis=1)
            for name, row in rows.items()
        }
        return MapPlanes(
            **{n: x if x.dtype == bool else x.astype(dtype) for n, x in spread.items()},
            noise=np.full(len(pixels), found.noise, dtype),
            converged=np.full(len(pixels), found.converged),
            left=left,
            square=square,
        )

    def _nothing(self, n: int, channel_count: int, square: np.ndarray) -> MapPlanes:
        """Of pixels in no region, or of a region of which nothing is used: zeros, not identified."""
        dtype = self.photographs[0].gbuffer.normal.x.dtype
        m = sum(width(name, channel_count) for name in map_names(self.material))
        return MapPlanes(
            values=np.zeros((m, n), dtype),
            standard_errors=np.full((m, n), inf, dtype),
            nominal_errors=np.full((m, n), inf, dtype),
            identified=np.zeros((m, n), bool),
            noise=np.full(n, inf, dtype),
            converged=np.zeros(n, bool),
            left=square,
            square=square,
        )


def _part(gbuffer: GBuffer, pixels: Int[np.ndarray, "n"]) -> GBuffer:
    """Some of a G-buffer's points, as a picture one pixel high."""

    def chosen(vectors: Vec3 | None) -> Vec3 | None:
        return None if vectors is None else vectors[pixels]

    return GBuffer(
        shape=(1, len(pixels)),
        normal=gbuffer.normal[pixels],
        viewer=gbuffer.viewer,
        position=chosen(gbuffer.position),
    )


def region_labels(regions: ArrayLike, gbuffer: GBuffer) -> Int[np.ndarray, "P"]:
    """The labels of the foreground's pixels; every one below 0 is -1."""
    labels = np.asarray(regions)
    if labels.shape != gbuffer.shape or not np.issubdtype(labels.dtype, np.integer):
        raise BadInput(
            f"regions has shape {labels.shape} and type {labels.dtype}: give whole numbers, one a"
            f" pixel of the {gbuffer.shape} image"
        )
    return np.maximum(labels[gbuffer.mask].astype(np.int64), -1)
