"""Photographs as data: what was observed, where, under which lights, with what weight.

Images that share a G-buffer and whose scenes have one structure lie in one stack, so that a capture of
a hundred photographs compiles once. What a device gets of a stack is a `Group`: some of its points in
all of its images. A page is a group of consecutive points, as many as a device is to hold at one time, so
that memory beyond the photographs does not grow with their number; a sample is a group of few points
from everywhere. Both have the lengths of buckets, so that captures of many sizes share a few compiled
programs.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, PyTree

from diffshade.arrays import is_concrete
from diffshade.buckets import bucket
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.attenuation import InverseSquare
from diffshade.light.base import AbstractLight
from diffshade.light.visible import map_visible
from diffshade.scene import Scene
from diffshade.vector import Vec3
from fitting.arrays import Array
from fitting.gauge import lit_by
from fitting.inputs import Photograph, Pixels, Traced

__all__ = ["Group", "Stack", "in_precision", "stacked", "stacks", "traced_groups"]

PAGE = 2**17
"""Points times lights or channels, whichever are more, that a device works on at one time."""
SAMPLE = 1024
"""Points of a fair sample, and as many again of the brightest."""
SAMPLES = 2**18
"""Points times images of a sample, at the most."""
FEWEST = 64
"""Points of a sample, whatever the number of images."""


class Group(eqx.Module):
    """K images of one structure at P points of a surface; the first `fair` points are a fair sample.

    `lights` are those of each kind, every leaf [K, L, ...]. `surface` is a G-buffer of P pixels, all
    of them foreground.
    """

    surface: GBuffer
    ambient: Float[Array, "K ..."] | None
    lights: tuple[AbstractLight, ...]
    observed: Float[Array, "K C P"]
    weight: Float[Array, "K P"]
    clipped: Bool[Array, "K C P"] | None = None
    fair: int = eqx.field(static=True, default=0)

    @property
    def image_count(self) -> int:
        """K"""
        return self.weight.shape[0]

    def part(self, points: slice) -> "Group":
        """The same at some of the points."""
        surface = _points(self.surface, points)
        clipped = None if self.clipped is None else self.clipped[..., points]
        observed, weight = self.observed[..., points], self.weight[..., points]
        lights = self.lights
        if self.surface.spread is None:
            lights = map_visible(lambda plane: plane[..., points], lights)
        return Group(surface, self.ambient, lights, observed, weight, clipped)


@dataclass(frozen=True, eq=False)
class Stack:
    """Photographs of one surface whose scenes have one structure, and the points that any of them uses.

    `points` says where these lie in the G-buffer's planes; None: they are all of its points.
    """

    photographs: tuple[Photograph, ...]
    ambient: Float[np.ndarray, "K ..."] | None
    lights: tuple[AbstractLight, ...]
    points: Int[np.ndarray, "N"] | None

    @property
    def gbuffer(self) -> GBuffer:
        """The surface that all of them show."""
        return self.photographs[0].gbuffer

    @property
    def size(self) -> int:
        """How many points are used."""
        return self.gbuffer.pixel_count if self.points is None else len(self.points)

    @property
    def light_count(self) -> int:
        """How many lights an image has."""
        return sum(kind.intensity.shape[1] for kind in self.lights)

    def page_length(self, devices: int) -> int:
        """How many points a page has that splits evenly over so many devices."""
        widest = max(self.light_count, self.photographs[0].channel_count, 1)
        most = max(PAGE // widest, FEWEST) * devices
        return -(-bucket(min(self.size, most)) // devices) * devices

    def pages(self, devices: int) -> Iterator[Group]:
        """All points, page by page."""
        length = self.page_length(devices)
        for first in range(0, self.size, length):
            yield self.group(slice(first, min(first + length, self.size)), length)

    def sample(self, *, bright: bool) -> Group:
        """Points from everywhere, at equal distances; then, asked for, the brightest of every image,
        or of as many as there is room for.

        A highlight may be so small that no fair sample meets it.
        """
        count = len(self.photographs)
        most = max(min(SAMPLE, SAMPLES // (2 * count)), FEWEST)
        if self.size <= 2 * most:
            length = min(_room(self.size), bucket(2 * most))
            return self.group(slice(0, self.size), length, fair=length)
        even = np.arange(most) * self.size // most
        several = np.linspace(0, count - 1, min(count, most)).astype(int).tolist() if bright else []
        brightest = [self._brightest(k, max(most // count, 1)) for k in several]
        chosen = np.concatenate([even, *brightest])
        return self.group(chosen, bucket(len(chosen)), fair=most)

    def _brightest(self, k: int, count: int) -> Int[np.ndarray, "n"]:
        """The brightest point of image k in each of `count` runs of points."""
        photograph, length = self.photographs[k], self.size // count
        found = []
        several = max(PAGE // length, 1)
        for run in range(0, count, several):
            runs = min(several, count - run)
            at = self._at(slice(run * length, (run + runs) * length))
            values = photograph.observed(at, photograph.used(at))
            if photograph.clipped is not None:  # says little of how bright it is
                values = np.where(photograph.clipped_at(at), 0, values)
            brightness = values.sum(axis=0).reshape(runs, length)
            found.append((run + np.arange(runs)) * length + brightness.argmax(axis=1))
        return np.concatenate(found)

    def _at(self, chosen: Pixels) -> Pixels:
        """Where chosen points lie in the rows of an image."""
        index = chosen if self.points is None else self.points[chosen]
        return index if self.gbuffer.index is None else np.asarray(self.gbuffer.index)[index]

    def group(self, chosen: Pixels, length: int, *, fair: int = 0) -> Group:
        """The chosen points, filled up to a length with points that do not count."""
        gbuffer, at = self.gbuffer, self._at(chosen)
        dtype = np.dtype(gbuffer.normal.x.dtype)
        index = chosen if self.points is None else self.points[chosen]
        n = chosen.stop - chosen.start if isinstance(chosen, slice) else len(chosen)
        shape = len(self.photographs), self.photographs[0].channel_count, length
        observed, weight = np.zeros(shape, dtype), np.zeros((shape[0], length), dtype)
        clipped = None
        if any(photograph.clipped is not None for photograph in self.photographs):
            clipped = np.zeros(shape, bool)
        for k, photograph in enumerate(self.photographs):
            used = photograph.used(at)
            observed[k, :, :n] = photograph.observed(at, used)
            weight[k, :n] = 1 if used is None else used
            if clipped is not None and photograph.clipped is not None:
                clipped[k, :, :n] = photograph.clipped_at(at)

        def filled(plane: np.ndarray) -> np.ndarray:
            # With a real point, at which everything is finite
            out = np.empty((*plane.shape[:-1], length), plane.dtype)
            out[..., :n] = plane[..., index]
            out[..., n:] = out[..., :1]
            return out

        surface = _of_points(gbuffer, length, filled)
        lights = self.lights if gbuffer.spread is not None else map_visible(filled, self.lights)
        return Group(surface, self.ambient, lights, observed, weight, clipped, fair)


def _room(count: int) -> int:
    """The least of 64, 256, 1024, ... that holds `count`.

    A search compiles for seconds and runs for milliseconds, of which points take few: a sample of a
    small image has fewer lengths than a page.
    """
    return max(FEWEST, 1 << -2 * (-(count - 1).bit_length() // 2))


def stacks(
    photographs: Sequence[Photograph], *, fitted_law: bool
) -> tuple[tuple[Stack, ...], tuple[int, ...]]:
    """The photographs in stacks, and the number of each in the order of the stacks.

    With a `fitted_law` the attenuation of point lights is one that is searched.
    """
    together: dict[object, list[Photograph]] = {}
    for photograph in photographs:
        leaves, structure = jax.tree.flatten(photograph.scene)
        shapes = tuple(leaf.shape for leaf in leaves)
        key = id(photograph.gbuffer), structure, shapes
        together.setdefault(key, []).append(photograph)
    found = tuple(_stack(members, fitted_law) for members in together.values())
    return found, tuple(p.number for members in together.values() for p in members)


def _stack(photographs: list[Photograph], fitted_law: bool) -> Stack:
    gbuffer, points = photographs[0].gbuffer, None
    at = slice(0, gbuffer.pixel_count) if gbuffer.index is None else np.asarray(gbuffer.index)
    each = [photograph.used(at) for photograph in photographs]
    masks = [mask for mask in each if mask is not None]
    if len(masks) == len(each):
        anywhere = np.logical_or.reduce(masks)
        if not anywhere.all():  # where none is used, one stands for it that does not count
            points = (
                np.flatnonzero(anywhere).astype(np.int32) if anywhere.any() else np.zeros(1, int)
            )
    dtype = gbuffer.normal.x.dtype
    scenes = [in_precision(photograph.scene, dtype) for photograph in photographs]
    return Stack(tuple(photographs), *stacked(scenes, np, fitted_law=fitted_law), points)


def stacked(
    scenes: Sequence[Scene], xp: Any, *, fitted_law: bool
) -> tuple[Float[Array, "K ..."] | None, tuple[AbstractLight, ...]]:
    """The ambient light [K, ...] of scenes of one structure, and their lights kind by kind [K, L, ...].

    In place of the attenuation of point lights, where that is fitted, stands one without constants.
    """
    ambient = None if scenes[0].ambient is None else xp.stack([s.ambient for s in scenes])
    kinds: dict[object, list[int]] = {}
    for j, light in enumerate(scenes[0].lights):
        leaves, structure = jax.tree.flatten(light)
        kinds.setdefault((structure, *(leaf.shape for leaf in leaves)), []).append(j)

    def of_kind(members: list[int]) -> AbstractLight:
        each = [[scene.lights[j] for j in members] for scene in scenes]
        images = [jax.tree.map(lambda *leaves: xp.stack(leaves), *lights) for lights in each]
        kind = jax.tree.map(lambda *leaves: xp.stack(leaves), *images)
        return lit_by(kind, InverseSquare()) if fitted_law else kind

    return ambient, tuple(of_kind(members) for members in kinds.values())


def traced_groups(views: Sequence[Traced]) -> tuple[Group, ...]:
    """The views in groups, of all their points: what may be traced is not looked at."""
    together: dict[object, list[Traced]] = {}
    for view in views:
        leaves, structure = jax.tree.flatten(view.scene)
        shapes = tuple(leaf.shape for leaf in leaves)
        together.setdefault((id(view.gbuffer), structure, shapes), []).append(view)
    return tuple(_traced_group(members) for members in together.values())


def _traced_group(views: list[Traced]) -> Group:
    gbuffer = views[0].gbuffer
    dtype = gbuffer.normal.x.dtype
    size = views[0].weight.shape[0]
    scenes = [in_precision(view.scene, dtype) for view in views]
    return Group(
        _of_points(gbuffer, size, jnp.asarray),
        *stacked(scenes, jnp, fitted_law=False),
        jnp.stack([view.observed for view in views]),
        jnp.stack([view.weight for view in views]),
    )


def in_precision(tree: PyTree, dtype: np.dtype) -> PyTree:
    """The tree's floats as arrays of one type, NumPy's where they are not traced."""

    def converted(x: Any) -> Any:
        if not jnp.issubdtype(x.dtype, jnp.floating):
            return x
        return np.asarray(x, dtype) if is_concrete(x) else jnp.asarray(x, dtype)

    return jax.tree.map(converted, tree)


def _of_points(gbuffer: GBuffer, length: int, chosen: Any) -> GBuffer:
    """A G-buffer of `length` points, its planes made by `chosen` from what lies at every pixel."""
    dtype = gbuffer.normal.x.dtype
    spread = gbuffer.spread
    if spread is None:
        normal, position = jax.tree.map(
            lambda plane: chosen(np.asarray(plane) if is_concrete(plane) else plane),
            (gbuffer.normal, gbuffer.position),
        )
    else:  # faces or vertices are all shaded, and spread over the pixels that are chosen
        normal, position = gbuffer.normal, gbuffer.position
        spread = jax.tree.map(
            lambda leaf: chosen(np.asarray(leaf) if is_concrete(leaf) else leaf), spread
        )
    return GBuffer(
        shape=(1, length),
        normal=normal,
        viewer=in_precision(gbuffer.viewer, dtype),
        position=position,
        spread=spread,
    )


def _points(surface: GBuffer, points: slice) -> GBuffer:
    """Some points of a surface that is all foreground."""
    pick = lambda tree: jax.tree.map(lambda leaf: leaf[..., points], tree)  # noqa: E731
    length = len(range(*points.indices(surface.pixel_count)))
    if surface.spread is not None:
        return replace(surface, shape=(1, length), spread=pick(surface.spread))
    normal: Vec3 = pick(surface.normal)
    return replace(surface, shape=(1, length), normal=normal, position=pick(surface.position))
