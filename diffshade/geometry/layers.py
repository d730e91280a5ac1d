"""The surfaces behind each pixel, sorted from the nearest to the farthest (depth peeling).

C. Everitt, Interactive order-independent transparency, 2001: the first layer is what each pixel sees,
the next what it would see without the first, and so on. Here a ray is followed through all objects at
once, so that each pixel's layers are in order whichever objects they are of, also where these pass
through each other.
"""

from collections.abc import Sequence
from contextlib import nullcontext

import jax
import numpy as np
from jaxtyping import Float, Int

from diffshade.arrays import is_concrete, is_outermost
from diffshade.buckets import joined, split
from diffshade.errors import BadInput
from diffshade.geometry.camera import AbstractCamera
from diffshade.geometry.gbuffer import GBuffer
from diffshade.geometry.surface import AbstractSurface, Visibility
from diffshade.geometry.view import gbuffer

__all__ = ["layers", "peel"]

Objects = AbstractSurface | Sequence[AbstractSurface]

SAME = 2.0**-40
"""Surfaces of two objects that are nearer coincide, as a part of the largest distance in the image:
what rounding does to distances in double precision."""


def peel(
    objects: Objects, camera: AbstractCamera, count: int | None = None
) -> tuple[tuple[Visibility, ...], ...]:
    """What each pixel sees, and what is behind it: a visibility a layer and object, nearest first.

    `result[k][i]` says which pixels have object i as their k-th surface from the front. There are as
    many layers as the pixel with most surfaces has, at most `count`, at least one, which may be empty.
    Decided on concrete values, never differentiated. Where surfaces of two objects coincide, those of
    the first are in front; triangles of one mesh that coincide, to single precision of its extent, are
    one surface.

    Raises `BadInput` for surfaces that cannot be seen, and on the tracers of an enclosing `jit` or
    `grad`: compute it outside.

    >>> from diffshade.geometry.camera import OrthographicCamera
    >>> from diffshade.geometry.sphere import Sphere
    >>> [near.index.size for (near,) in peel(Sphere(), OrthographicCamera(4, 4, 2.0))]
    [12, 12]
    """
    given = _objects(objects)
    if count is not None and count < 1:
        raise BadInput(f"count is {count}: give at least 1 layer, or None for all")
    if not is_concrete((given, camera)):
        raise BadInput(
            "layers were asked for inside jit, grad or vmap, where they cannot be decided: compute"
            " ds.peel(objects, camera) outside and pass it to ds.layers"
        )
    with nullcontext() if is_outermost() else jax.ensure_compile_time_eval():
        camera.check()
        crossed = [surface.crossings(camera, count) for surface in given]
        pixel = np.concatenate([np.asarray(seen.index) for seen, _ in crossed])
        distance = np.concatenate([distance for _, distance in crossed])
        owner = np.repeat(np.arange(len(given)), [distance.size for _, distance in crossed])
        rank = _ranks(pixel, distance, owner)
        total = max(int(rank.max(initial=-1)) + 1, 1)
        total = total if count is None else min(total, count)
        ranks = [rank[owner == i] for i in range(len(given))]
        return tuple(
            tuple(_of_layer(seen, of == k) for (seen, _), of in zip(crossed, ranks, strict=True))
            for k in range(total)
        )


def layers(
    objects: Objects,
    camera: AbstractCamera,
    count: int | None = None,
    *,
    visibility: Sequence[Sequence[Visibility]] | None = None,
) -> tuple[tuple[GBuffer, ...], ...]:
    """The G-buffers of what each pixel sees and what is behind it, a layer and object, nearest first.

    `result[k][i]` holds the pixels that have object i as their k-th surface from the front: every
    pixel of a layer is of one object, or of none. Of a sphere the far side is there too, and of a mesh
    each triangle from either side; the normal of a surface that is seen from inside is turned to the
    viewer. What an opaque object hides is among them too, for nothing here knows materials. The first
    layers alone are `result[:k]`. Points are shaded once a pixel.

    With `visibility`, what `peel` gives, it is jittable, and differentiable in the objects and the
    camera at fixed visibility. Raises `BadInput` as `peel` does.

    >>> from diffshade.geometry.camera import OrthographicCamera
    >>> from diffshade.geometry.sphere import Sphere
    >>> near, far = layers([Sphere()], OrthographicCamera(4, 4, 2.0))
    >>> float(near[0].position.z[0]) == -float(far[0].position.z[0])
    True
    """
    given = _objects(objects)
    seen = peel(given, camera, count) if visibility is None else visibility
    forms = {tuple(jax.tree.structure(of) for of in layer) for layer in seen}
    if len(forms) != 1 or len(seen[0]) != len(given):
        raise BadInput(
            f"the visibility is not that of layers of {len(given)} objects: give what ds.peel gives"
        )
    of_objects = [
        _gbuffers(surface, camera, parts)
        for surface, parts in zip(given, zip(*seen, strict=True), strict=True)
    ]
    return tuple(zip(*of_objects, strict=True))


def _gbuffers(
    surface: AbstractSurface, camera: AbstractCamera, parts: Sequence[Visibility]
) -> list[GBuffer]:
    """An object's G-buffers, layer by layer; what they hold is computed at once."""
    if len(parts) == 1:
        return [gbuffer(surface, camera, parts[0])]
    whole = gbuffer(surface, camera, jax.tree.map(joined, *parts))
    pixels = camera.width * camera.height
    counts = [seen.index.shape[0] for seen in parts]
    leaves, structure = jax.tree.flatten((whole.normal, whole.position, whole.slot))
    found = []
    for seen, *planes in zip(parts, *(split(leaf, counts) for leaf in leaves), strict=True):
        normal, position, slot = jax.tree.unflatten(structure, planes)
        index = None if seen.index.shape[0] == pixels else seen.index
        found.append(GBuffer(seen.shape, normal, whole.viewer, position, index, slot))
    return found


def _objects(objects: Objects) -> tuple[AbstractSurface, ...]:
    given = (objects,) if isinstance(objects, AbstractSurface) else tuple(objects)
    if not given:
        raise BadInput("no objects are given: give at least one surface")
    return given


def _ranks(
    pixel: Int[np.ndarray, "N"], distance: Float[np.ndarray, "N"], owner: Int[np.ndarray, "N"]
) -> Int[np.ndarray, "N"]:
    """Which crossing of its pixel each is, from the front."""
    order = np.lexsort((distance, pixel))
    next_pixel = np.diff(pixel[order]) > 0
    farther = np.diff(distance[order]) > SAME * np.abs(distance).max(initial=0)
    place = np.cumsum(np.concatenate([[0], next_pixel | farther])[: order.size])
    order = order[np.lexsort((distance[order], owner[order], place))]
    _, first, count = np.unique(pixel[order], return_index=True, return_counts=True)
    rank = np.empty(order.size, int)
    rank[order] = np.arange(order.size) - np.repeat(first, count)
    return rank


def _of_layer(seen: Visibility, chosen: np.ndarray) -> Visibility:
    """Some of the crossings, in the order of the pixels."""
    where = np.flatnonzero(chosen)
    where = where[np.argsort(np.asarray(seen.index)[where], kind="stable")]
    return jax.tree.map(lambda plane: jax.device_put(np.asarray(plane)[where]), seen)
