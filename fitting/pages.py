"""All the pixels of a capture, page by page: sums over them in float64, whatever the fit runs in.

A device holds one page at a time, or for good where the capture has no more than one for each stack.
Over several devices each has its part of every page, and the sums are added up; everything else is
small, and done by all of them alike. They see the same sums, to the last bit, and so take the same
steps: processors of one kind are asked for.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, wraps
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Float, PyTree

from diffshade.devices import AXIS, dealt, place
from diffshade.fusion import search_options
from diffshade.kept import Kept
from diffshade.light.point import PointLight
from diffshade.light.visible import visible_of
from diffshade.shading.one_light import Angles
from fitting.arrays import Array
from fitting.columns import Photo, Scenery, photos, scenery
from fitting.model import Model
from fitting.observation import Group, Stack
from fitting.project import gram
from fitting.weights import Judge

__all__ = ["Pages", "Sums", "in_double"]

Summed = Callable[..., tuple[PyTree, PyTree]]
"""From (group, gains, ...) to sums over its points for every image, and minima over all of it."""


class Sums(NamedTuple):
    """Of each image, in the order of the stacks, the Gram matrix and the |observed|^2 of used pixels.

    `nearest` and `farthest` are the distances of lit points from point lights with an attenuation,
    `brightest` is the largest observation.
    """

    each: Float[np.ndarray, "K C n n"]
    squares: Float[np.ndarray, "K"]
    nearest: float
    farthest: float
    brightest: float


class Pages:
    """The stacks of a capture on one device, or shared out over those of a mesh."""

    def __init__(self, stacks: tuple[Stack, ...], mesh: Mesh | None) -> None:
        self.stacks, self.mesh = stacks, mesh
        self._kept: list[Group] | None = None

    @property
    def additions(self) -> int:
        """The length of the longest chain of additions that a sum over everything may be."""
        devices = 1 if self.mesh is None else self.mesh.size
        images = sum(len(stack.photographs) for stack in self.stacks)
        pages = sum(-(-s.size // s.page_length(devices)) for s in self.stacks)
        return max(s.page_length(devices) for s in self.stacks) + pages + images

    def grams(
        self,
        model: Model,
        u: Float[np.ndarray, "q"],
        k: Float[np.ndarray, "C p"],
        gains: Float[np.ndarray, "K"] | None = None,
        judge: Judge | None = None,
    ) -> "Sums":
        """The Gram matrices of the rows [A, dA/du k, r] at u and k."""
        (each, squares), ends = self.total(_grams, gains, model, u, k, judge)
        return Sums(each, squares, float(ends[0]), -float(ends[1]), -float(ends[2]))

    def total(
        self, function: Summed, gains: Float[np.ndarray, "K"] | None, *arguments: Any
    ) -> tuple[Any, Any]:
        """`function` over all pages: sums image by image, and minima; NumPy arrays in float64."""
        sums: list[Any] = []
        least: Any = None
        first = 0
        with jax.enable_x64(True):
            for stack, pages in zip(self.stacks, self._pages(), strict=True):
                last = first + len(stack.photographs)
                own = None if gains is None else gains[first:last]
                of_stack: Any = None
                for page in pages:
                    found = _program(function, self.mesh)(page, own, *arguments)
                    here, low = jax.tree.map(lambda x: np.asarray(x.addressable_data(0)), found)
                    of_stack = _merged(np.add, of_stack, here)
                    least = _merged(np.minimum, least, low)
                sums.append(of_stack)
                first = last
        return jax.tree.map(lambda *parts: np.concatenate(parts), *sums), least

    def _pages(self) -> Iterator[Iterator[Group]]:
        if self._kept is not None:
            return iter([iter([group]) for group in self._kept])
        devices = 1 if self.mesh is None else self.mesh.size
        each = [map(self._placed, stack.pages(devices)) for stack in self.stacks]
        if all(stack.size <= stack.page_length(devices) for stack in self.stacks):
            self._kept = [next(pages) for pages in each]
            return self._pages()
        return iter(each)

    def _placed(self, group: Group) -> Group:
        return (
            jax.device_put(group) if self.mesh is None else place(group, self.mesh, _specs(group))
        )


def _merged(add: Any, so_far: Any, new: Any) -> Any:
    return new if so_far is None else jax.tree.map(add, so_far, new)


@cache
def _program(function: Summed, mesh: Mesh | None) -> Callable[..., Any]:
    """A function of a page in float64, compiled for the platform."""

    @wraps(function)
    def in_float64(group: Group, *arguments: Any) -> tuple[PyTree, PyTree]:
        return function(*in_double((group, *arguments)))

    if mesh is None:
        return Kept(in_float64, search_options)

    def shared(group: Group, *arguments: Any) -> tuple[PyTree, PyTree]:
        def part(group: Group, *arguments: Any) -> tuple[PyTree, PyTree]:
            sums, least = in_float64(group, *arguments)
            return lax.psum(sums, AXIS), lax.pmin(least, AXIS)

        whole = PartitionSpec()
        specs = (_specs(group), *(jax.tree.map(lambda _: whole, x) for x in arguments))
        return jax.shard_map(part, mesh=mesh, in_specs=specs, out_specs=whole)(group, *arguments)

    return jax.jit(shared, compiler_options=search_options())


def _specs(group: Group) -> Group:
    """How a group is dealt out: its points, which come last, over the devices."""

    def of_points(group: Group) -> list[Any]:
        surface = group.surface
        at_points = (surface.normal, surface.position, *visible_of(group.lights))
        shaded = at_points if surface.spread is None else (surface.spread,)
        parts = (group.observed, group.weight, group.clipped, *shaded)
        return [part for part in parts if part is not None]

    whole = jax.tree.map(lambda _: False, group)
    points = [jax.tree.map(lambda _: True, part) for part in of_points(group)]
    return dealt(group, eqx.tree_at(of_points, whole, points))


def in_double(tree: PyTree) -> PyTree:
    """The tree's floats in float64; in JAX's 64-bit mode."""

    def doubled(x: Any) -> Any:
        floating = jnp.issubdtype(jnp.result_type(x), jnp.floating)
        return jnp.asarray(x, jnp.float64) if floating else x

    return jax.tree.map(doubled, tree)


def _grams(
    group: Group,
    gains: Float[Array, "K"] | None,
    model: Model,
    u: Float[Array, "q"],
    k: Float[Array, "C p"],
    judge: Judge | None,
) -> tuple[tuple[Float[Array, "K C n n"], Float[Array, "K"]], Float[Array, "3"]]:
    """The Gram matrix and the square of every image; and `_ends`."""

    def of_image(photo: Photo) -> tuple[Array, Array, Array]:
        at = scenery(photo, group.surface, model.material)
        judged = None if judge is None else replace(judge, u=u, k=k)
        square = jnp.sum(photo.weight * jnp.sum(photo.observed**2, axis=0))
        return gram(model, u, k, at, judged), square, _ends(at)

    each, squares, ends = lax.map(of_image, photos(group, gains))
    return (each, squares), jnp.min(ends, axis=0)


def _ends(at: Scenery) -> Float[Array, "3"]:
    """The least distance from a point light to a used point that it lights, and minus the greatest;
    and minus the largest observation.
    """
    near, far = jnp.full((), jnp.inf), jnp.zeros(())
    for seen, kind in zip(at.angles, at.photo.lights, strict=True):
        if isinstance(kind, PointLight) and isinstance(seen, Angles) and seen.distance is not None:
            lit = (seen.n_dot_l > 0) & (seen.distance > 0)
            if seen.emission is not None:  # outside of a cone, or in a shadow
                lit = lit & (seen.emission > 0)
            if at.spread is None:  # else the points are not pixels, and have no weight
                lit = lit & (at.photo.weight > 0)[None]
            near = jnp.minimum(near, jnp.min(jnp.where(lit, seen.distance, jnp.inf)))
            far = jnp.maximum(far, jnp.max(jnp.where(lit, seen.distance, 0)))
    return jnp.stack([near, -far, -jnp.max(at.photo.observed, initial=0)])
