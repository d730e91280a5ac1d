"""Shadows: what share of each light each point of a G-buffer sees, by rays, computed once.

A point sees a point light, a spot or a parallel light or it does not. A light with extent is a sum of
elements, and of each element a point sees a share: of the nodes of a finer rule, by what they emit, each
given to the element that is nearest to it. The shares are planes that lights carry. Nothing of them is
differentiated: like the visibility of pixels they are decided on values, and are right as long as
surfaces and lights stay where they are.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float

from diffshade.arrays import is_concrete
from diffshade.errors import BadInput
from diffshade.fusion import processors
from diffshade.geometry.gbuffer import GBuffer
from diffshade.geometry.surface import AbstractSurface
from diffshade.light.base import AbstractLight
from diffshade.light.distributed import AbstractEmitter
from diffshade.light.environment import EnvironmentLight
from diffshade.light.parallel import ParallelLight
from diffshade.light.point import AbstractPointLight
from diffshade.light.visible import check_visible

__all__ = ["shadowed"]

FINER = 4
"""Nodes of the finer rule along a side, for one of the light's own."""


def shadowed(
    lights: AbstractLight | AbstractEmitter | Sequence[AbstractLight | AbstractEmitter],
    gbuffer: GBuffer,
    occluders: AbstractSurface | Sequence[AbstractSurface],
    *,
    finer: int = FINER,
) -> tuple[AbstractLight, ...]:
    """The lights for a scene, each with what the points of a G-buffer see of it past the occluders.

    A light adds I_p f v s, v the share of it that is visible: 0 or 1 of a light without extent, and of
    each element of a light with extent the share of `finer` by `finer` times as many nodes as it has
    (along a side). Surfaces throw shadows on themselves too, by their true shape: where a mesh is shaded
    smoothly and its triangles turn from the light before the normals do, its triangles show.

    Of a mesh that is shaded once a face or a vertex so are its shadows.

    A light's plane [P] in `visible` is over the points of this G-buffer; one that has shadows already has
    both. It is a constant to every derivative with respect to surfaces and places of lights, whose
    shadows' edges do not move: compute it anew where these move. Without it nothing is computed of
    shadows.

    Raises `BadInput` for a G-buffer without positions, for lights, surfaces or positions that are traced
    by `jit`, `grad` or `vmap`, for a light that is none, and as `ds.visibility` does for a mesh.

    >>> import diffshade as ds
    >>> g = ds.GBuffer.from_arrays(np.zeros((1, 1, 3)), np.array([[[0.0, 0.0, 1.0]]]))
    >>> ball, lamp = ds.Sphere((0, 0, 2), 1.0), ds.PointLight((0, 0, 5))
    >>> ds.render(g, ds.Scene(lights=shadowed(lamp, g, ball)), ds.Material(kd=1.0)).item()
    0.0
    """
    if not is_concrete((lights, gbuffer, occluders)):
        raise BadInput(
            "shadows were asked for inside jit, grad or vmap, where they cannot be decided: compute"
            " ds.shadowed outside and pass on its lights"
        )
    if gbuffer.position is None:
        raise BadInput(
            "shadows need positions, and this G-buffer has normals only: give"
            " GBuffer.from_arrays a position"
        )
    if isinstance(finer, bool) or not isinstance(finer, int) or finer < 1:
        raise BadInput(f"finer is {finer}: give a whole number of at least 1")
    if isinstance(lights, AbstractLight | AbstractEmitter):
        lights = (lights,)
    check_visible(tuple(x for x in lights if isinstance(x, AbstractLight)), gbuffer.point_count)
    surfaces = [occluders] if isinstance(occluders, AbstractSurface) else list(occluders)
    here = gbuffer.position
    points = np.stack([np.asarray(x, np.float64) for x in (here.x, here.y, here.z)], axis=-1)
    eps = float(np.finfo(here.x.dtype).eps)

    def seen(light: AbstractLight) -> Bool[np.ndarray, "P"]:
        towards, distance = _rays(light, points)
        hidden = np.zeros(len(points), bool)
        for surface in surfaces:
            hidden |= surface.hides(points, towards, distance, eps)
        return ~hidden

    found: list[AbstractLight] = []
    for light in lights:
        if isinstance(light, AbstractEmitter):
            found += _of_emitter(light, seen, finer)
        else:
            found.append(_with(light, seen(light)))
    return tuple(found)


def _of_emitter(emitter: AbstractEmitter, seen: Any, finer: int) -> list[AbstractLight]:
    """The elements of a light, with the share that is seen of each."""
    own: Any = emitter.elements()
    evenly: Any = replace(emitter, radiance=1.0)  # type: ignore[arg-type]
    nodes = evenly.with_samples(finer * emitter.samples).elements()
    places, at = (np.stack([np.asarray(x.position) for x in each]) for each in (own, nodes))
    nearest = ((at[:, None] - places) ** 2).sum(axis=2).argmin(axis=1)
    power = np.array([float(node.intensity) for node in nodes])

    def share(number: int) -> Float[np.ndarray, "P"]:
        members = np.flatnonzero(nearest == number)
        if not members.size:  # all fall together, in a light that is a point to rounding
            return 1.0 * seen(own[number])
        lit = sum(power[k] * seen(nodes[k]) for k in members)
        return np.minimum(lit / power[members].sum(), 1)  # as far as rounding goes

    with ThreadPoolExecutor(processors()) as threads:
        shares = threads.map(share, range(len(own)))
        return [_with(element, plane) for element, plane in zip(own, shares, strict=True)]


def _rays(
    light: AbstractLight, points: Float[np.ndarray, "P 3"]
) -> tuple[Float[np.ndarray, "P 3"], Float[np.ndarray, "P"]]:
    """The unit vectors from points towards a light, and how far it is."""
    if isinstance(light, ParallelLight):
        to = np.broadcast_to(np.asarray(light.direction, np.float64), points.shape)
    elif isinstance(light, AbstractPointLight):
        to = np.asarray(light.position, np.float64) - points
    elif isinstance(light, EnvironmentLight):
        raise BadInput(
            "an EnvironmentLight has no ray that a surface could hide: give ds.shadowed its"
            " as_lights(samples)"
        )
    else:
        raise BadInput(f"a light is {light!r}: give lights, such as ds.PointLight")
    length = np.sqrt((to * to).sum(axis=1))
    towards = to / np.where(length > 0, length, 1)[:, None]
    return towards, length if isinstance(light, AbstractPointLight) else np.full_like(
        length, np.inf
    )


def _with(light: AbstractLight, share: Any) -> AbstractLight:
    """The light with what is seen of it now, of what was seen before."""
    dtype = light.intensity.dtype
    if light.visible is not None:
        share = np.asarray(light.visible) * share
    return replace(light, visible=jax.device_put(np.asarray(share, dtype)))
