"""A material of its own for every pixel: blocks of photographs in, values and errors out."""

from collections.abc import Callable
from math import inf, log

import jax
import numpy as np
from jaxtyping import Float

from diffshade.errors import BadInput
from diffshade.reflectance.material import Material
from fitting.identify import LEAST_SHARE, NOISE, TOLERANCE
from fitting.inputs import Photograph
from fitting.limits import REFLECTED, Bounds
from fitting.map_planes import MapPlanes, map_names
from fitting.model import full_names
from fitting.observation import in_precision
from fitting.pixel import CHUNK, PixelFit, Settings
from fitting.pixel_block import Block, fit_block, lamps
from fitting.shapes import SHAPES, is_shape

__all__ = ["PixelWork", "settings"]


class PixelWork:
    """Blocks of pixels, each with a material of its own."""

    def __init__(
        self,
        photographs: list[Photograph],
        material: Material,
        settings: Settings,
        block: int,
        brightest: float,
    ) -> None:
        self.gbuffer = photographs[0].gbuffer
        self.dtype = self.gbuffer.normal.x.dtype
        self.photographs, self.settings, self.brightest = photographs, settings, brightest
        count = self.gbuffer.pixel_count
        self.length = -(-min(block, count) // CHUNK) * CHUNK
        self.pixels = [
            np.arange(i, min(i + self.length, count)) for i in range(0, count, self.length)
        ]
        self.options = (settings, self.length, brightest, material)
        common = lamps([p.scene for p in photographs]), self.gbuffer.viewer, material
        self.lamps, self.viewer, self.material = jax.device_put(in_precision(common, self.dtype))
        index = self.gbuffer.index
        self.at = np.arange(count) if index is None else np.asarray(index)
        self.surface = jax.tree.map(np.asarray, (self.gbuffer.normal, self.gbuffer.position))

    def begin(self, i: int) -> Callable[[], MapPlanes]:
        """Start a block; the last one is filled up with pixels that are not used."""
        pixels = self.pixels[i]
        padded = np.resize(pixels, self.length)
        real = np.arange(self.length) < len(pixels)
        where = self.at[padded]

        def chunks(planes: np.ndarray) -> np.ndarray:
            cut = planes.reshape(*planes.shape[:-1], -1, CHUNK)
            return np.ascontiguousarray(np.moveaxis(cut, -2, 0))

        def joined(cut: np.ndarray) -> np.ndarray:
            return np.moveaxis(cut, 0, -2).reshape(*cut.shape[1:-1], -1)

        channel_count = self.photographs[0].channel_count
        shape = (channel_count, len(self.photographs), self.length)
        observed = np.empty(shape, self.dtype)
        weight = np.empty(shape[1:], self.dtype)
        for k, photograph in enumerate(self.photographs):
            used = photograph.used(where)
            observed[:, k] = photograph.observed(where, used)
            weight[k] = real if used is None else used & real
        observed *= weight
        normal, position = jax.tree.map(lambda plane: chunks(plane[padded]), self.surface)
        block = Block(normal, position, chunks(observed), chunks(weight))
        running = fit_block(block, self.lamps, self.viewer, self.material, self.settings)
        n = len(pixels)
        count = channel_count * weight.sum(0)[:n]
        square = np.einsum("ckp,ckp->p", observed, observed, dtype=float)[:n]

        def wait() -> MapPlanes:
            found = jax.tree.map(lambda x: joined(x)[..., :n], running())
            return _judged(found, count, square, self.brightest)

        return wait


def _judged(
    found: PixelFit,
    count: Float[np.ndarray, "n"],
    square: Float[np.ndarray, "n"],
    brightest: float,
) -> MapPlanes:
    """Values, errors and what is identified, from the fits of n pixels with `count` observations."""
    # Coefficient after coefficient, each channel by channel.
    k, k_error = (np.concatenate(list(zip(*x, strict=True))) for x in (found.k, found.k_error))
    n = np.exp(np.asarray(found.u))
    values = np.concatenate([k, n[None]])
    errors = np.concatenate([k_error, (n * found.u_error)[None]]).astype(float)
    degrees = count - found.unknowns
    noise = np.sqrt(found.cost / np.where(degrees > 0, degrees, 1))
    noise = np.where(degrees > 0, noise, inf).astype(values.dtype)
    # Where the noise cannot be estimated, the nominal one has to do.
    judged = np.maximum(NOISE * brightest, np.where(degrees > 0, noise, 0))
    size = np.maximum(np.abs(k), LEAST_SHARE * np.abs(k).max(axis=0))
    size = np.concatenate([size, n[None]])
    told = np.isfinite(errors)
    standard = np.where(told, noise * np.where(told, errors, 1), inf)
    known = found.converged & told & (np.where(told, errors, 0) * judged <= TOLERANCE * size)
    nominal = np.where(told, NOISE * brightest * np.where(told, errors, 1), inf)
    return MapPlanes(
        values=values,
        standard_errors=standard.astype(values.dtype),
        nominal_errors=nominal.astype(values.dtype),
        identified=np.asarray(known & (size > 0)),
        noise=noise,
        converged=np.asarray(found.converged),
        left=np.asarray(found.cost, float),
        square=square,
    )


def settings(material: Material, bounds: Bounds, steps: int | None) -> Settings:
    """The bounds of a pixel's coefficients, and how it is searched."""
    if len(material.specular) != 1 or not hasattr(material.specular[0], "shininess"):
        kinds = ", ".join(lobe.kind for lobe in material.specular) or "none"
        raise BadInput(
            f"the lobes of the material are {kinds}: give fit_maps one with a shininess, or regions,"
            " which may have any"
        )
    if material.body is not None or getattr(material.specular[0], "weight", None) is not None:
        raise BadInput(
            "the material has a body under a boundary, or a lobe with a weight: give fit_maps one"
            " without, or regions"
        )
    names = map_names(material)
    given = {full: pair for n, pair in bounds.items() for full in full_names(n, names, "bounds")}
    edges = {}
    for name in names:
        shininess = is_shape(name)
        default = SHAPES["shininess"].bounds if shininess else REFLECTED
        low, high = given.get(name, default)
        open_low, open_high = default if shininess else (-inf, inf)
        low = float(open_low if low is None else low)
        high = float(open_high if high is None else high)
        if not low <= high or (shininess and low <= 0):
            least = "0 < lower" if shininess else "lower"
            raise BadInput(f"bounds of {name} are {low:g} to {high:g}: give {least} <= upper")
        edges[name] = low, high
    low, high = edges.pop("specular.0.shininess")
    return Settings(tuple(edges.values()), (log(low), log(high)), steps)
