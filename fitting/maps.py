"""Many materials at once: one for every pixel or region, with maps of how far to trust them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Shaped

from diffshade.arrays import ArrayLike
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.reflectance.material import Material
from diffshade.reflectance.names import coefficient
from diffshade.scene import Scene
from fitting.blocks import Arrays, Folder, Progress, fingerprint, in_blocks
from fitting.inputs import match
from fitting.limits import Bounds
from fitting.map_planes import MapPlanes, map_names, width
from fitting.model import default_material
from fitting.pixel_maps import PixelWork, settings
from fitting.region_maps import RegionWork, region_labels
from fitting.residual import ratio

__all__ = ["Maps", "fit_maps"]

Planes = Mapping[str, Shaped[np.ndarray, "C P"]]


@dataclass(frozen=True)
class Maps:
    """What `fit_maps` found: planes [C, P] by name, over the P foreground pixels of `gbuffer`.

    The names are those of `Fit`: "ka", "kd", "specular.0.ks", [C, P], and "specular.0.shininess",
    [1, P]. `material` holds the same maps, and `ds.render` takes it as it is.

    - `standard_errors`: of Cramer and Rao, for the noise found at the pixel itself, `noise` [P];
      infinite where the images do not tell, or where no more was observed than is unknown.
    - `nominal_errors`: the same for noise of a thousandth of the images' maximum.
    - `identified`: which are known to 10 % for the larger of both noises. A k that is small beside
      the pixel's others is known by its absolute error. What is not identified has a value, so that
      it can be rendered, and it means nothing.
    - `converged` [P]: whether the search had arrived.
    - `residual` [P]: |observed - predicted| / |observed| of each pixel, 0 where nothing is observed;
      `relative_residual`: the same over all.
    """

    gbuffer: GBuffer
    material: Material
    coefficients: Planes
    standard_errors: Planes
    nominal_errors: Planes
    identified: Planes
    noise: Float[np.ndarray, "P"]
    converged: Bool[np.ndarray, "P"]
    residual: Float[np.ndarray, "P"]
    relative_residual: float

    def to_image(self, planes: str | Shaped[np.ndarray, "C P"]) -> Shaped[np.ndarray, "H W C"]:
        """A coefficient by name, or any planes of these maps, as an image; background is 0."""
        chosen = self.coefficients[planes] if isinstance(planes, str) else planes
        return np.asarray(self.gbuffer.to_image(tuple(jax.device_put(list(chosen)))))


def fit_maps(
    images: ArrayLike | Sequence[ArrayLike],
    gbuffer: GBuffer,
    scenes: Scene | Sequence[Scene],
    *,
    material: Material | None = None,
    valid: ArrayLike | Sequence[ArrayLike] | None = None,
    bounds: Bounds | None = None,
    regions: ArrayLike | None = None,
    steps: int | None = None,
    block: int = 65_536,
    progress: Progress | None = None,
    folder: Folder | None = None,
) -> Maps:
    """Recover a material for every pixel, or for every region, from images of one surface.

    At each pixel the sum over images and channels of |observed - predicted|^2 (LIGHT-13) is
    minimised: k_a, k_d and k_s of each channel exactly within their bounds, log n from a coarse grid.

    - `images`: K images of linear radiance [H, W, C] or [H, W]; `scenes`: one an image. The lights
      are known, attenuation included.
    - `material`: which terms there are, with exactly one lobe that has a shininess; its values do
      not matter, but for object colours. By default k_d and one Phong lobe, and k_a where a scene
      has ambient light.
    - `valid`: which pixels to use [H, W], one for all or one an image: leave out what is clipped.
    - `bounds`: as in `fit`: 0 to 1 for each k, 0.1 to 100,000 for the shininess.
    - `regions`: labels [H, W], whole numbers: all pixels of one label share one material, found by
      `fit` (and any number of lobes). Below 0: no region.
    - `steps`: None goes to the minimum by Optimistix; a number takes so many Gauss-Newton steps,
      which is two to three times as fast, and for 8 the same but for a few pixels (see `converged`).
    - `block`: pixels at one time; beyond the images and the maps, memory grows with this alone.
    - `progress`: called with how many blocks (or regions) are finished, and how many there are.
    - `folder`: where finished blocks are kept: the same call with the same folder goes on from them.

    Raises `BadInput` for images, scenes and masks that do not fit together, for images that are not
    finite in a used pixel, for a material without exactly one lobe, and for a folder that holds
    blocks of something else.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.2))
    >>> ring = [(x, y, 2) for x in (-1, 0, 1) for y in (-1, 0, 1)]
    >>> scenes = [ds.Scene(lights=ds.ParallelLight(direction)) for direction in ring]
    >>> truth = ds.Material(kd=0.6, specular=ds.Phong(0.3, 4))
    >>> maps = fit_maps([ds.render(g, scene, truth) for scene in scenes], g, scenes)
    >>> known = maps.identified["specular.0.shininess"]
    >>> bool(np.allclose(maps.coefficients["specular.0.shininess"][known], 4, rtol=1e-3))
    True
    """
    if gbuffer.spread is not None:
        raise BadInput(
            "this G-buffer is shaded once a face or a vertex, and maps are over pixels: use"
            " PhongShading()"
        )
    if block < 1 or (steps is not None and steps < 1):
        raise BadInput(f"block is {block} and steps is {steps}: give at least 1 (or steps=None)")
    photographs = match(images, gbuffer, scenes, valid)
    start = default_material(p.scene for p in photographs) if material is None else material
    if any(leaf.ndim > 1 for leaf in jax.tree.leaves(start)):
        raise BadInput("the material holds maps: give one number, or one a channel")
    brightest = max(photograph.brightest for photograph in photographs)
    work: PixelWork | RegionWork
    if regions is None:
        searched = settings(start, bounds or {}, steps)
        work = PixelWork(photographs, start, searched, block, brightest)
    else:
        labels = region_labels(regions, gbuffer)
        work = RegionWork(photographs, start, bounds, labels, brightest)

    def begin(i: int) -> Callable[[], Arrays]:
        wait = work.begin(i)
        return lambda: wait()._asdict()

    finished = in_blocks(
        len(work.pixels),
        begin,
        progress=progress,
        folder=folder,
        inputs=lambda: fingerprint(photographs, work.options),
    )
    planes = _in_place(work.pixels, [MapPlanes(**arrays) for arrays in finished])
    return _maps(gbuffer, start, photographs[0].channel_count, planes)


def _in_place(pixels: Sequence[np.ndarray], blocks: Sequence[MapPlanes]) -> MapPlanes:
    """The planes of all blocks, each pixel in its place."""
    order = np.argsort(np.concatenate(pixels))
    return MapPlanes(
        *(np.concatenate(planes, axis=-1)[..., order] for planes in zip(*blocks, strict=True))
    )


def _maps(gbuffer: GBuffer, material: Material, channel_count: int, planes: MapPlanes) -> Maps:
    names = map_names(material)
    ends = np.cumsum([width(name, channel_count) for name in names])[:-1]

    def by_name(numbers: Shaped[np.ndarray, "m P"]) -> Planes:
        return dict(zip(names, np.split(numbers, ends), strict=True))

    coefficients = by_name(planes.values)
    mapped = material
    for name, plane in coefficients.items():
        mapped = eqx.tree_at(lambda m: coefficient(m, name), mapped, jnp.asarray(plane))  # noqa: B023
    left, square = planes.left, planes.square
    share = np.where(square > 0, left / np.where(square > 0, square, 1), np.where(left > 0, inf, 0))
    return Maps(
        gbuffer=gbuffer,
        material=mapped,
        coefficients=coefficients,
        standard_errors=by_name(planes.standard_errors),
        nominal_errors=by_name(planes.nominal_errors),
        identified=by_name(planes.identified),
        noise=planes.noise,
        converged=planes.converged,
        residual=np.sqrt(share),
        relative_residual=ratio(float(left.sum()), float(square.sum())),
    )
