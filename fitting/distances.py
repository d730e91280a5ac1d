"""How far the lit points of a capture lie from its lights: the unit of an attenuation that is fitted."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.point import PointLight
from diffshade.scene import Scene
from diffshade.vector import Vec3, dot, length
from fitting.observation import Group
from fitting.sharding import over_devices

__all__ = ["Distances", "lit_distances", "share_nearer"]


@dataclass(frozen=True)
class Distances:
    """Between lights and the points they light: the geometric mean, the least, the greatest."""

    reference: float
    nearest: float
    farthest: float


def lit_distances(groups: Sequence[Group]) -> Distances | None:
    """Over the used pixels of all images and their point lights; None where nothing is lit."""
    logarithm, count, nearest, farthest = 0.0, 0.0, np.inf, 0.0
    for group in groups:
        if any(isinstance(light, PointLight) for light in group.scenes.lights):
            total, lit, low, high, _ = (float(x) for x in _of_group(group, 0.0))
            logarithm, count = logarithm + total, count + lit
            nearest, farthest = min(nearest, low), max(farthest, high)
    if count == 0:
        return None
    return Distances(float(np.exp(logarithm / count)), nearest, farthest)


def share_nearer(groups: Sequence[Group], limit: float) -> float:
    """The share of all pairs of a light and a point that it lights that are nearer than `limit`."""
    sums = [_of_group(group, limit) for group in groups]
    return float(sum(s[4] for s in sums)) / max(float(sum(s[1] for s in sums)), 1.0)


Totals = tuple[
    Float[Array, ""], Float[Array, ""], Float[Array, ""], Float[Array, ""], Float[Array, ""]
]


@over_devices
def _of_group(group: Group, limit: float | Float[Array, ""]) -> Totals:
    """The sum of log d and how many were summed, the least d and the greatest, how many are nearer."""

    def of_light(gbuffer: GBuffer, weight: Array, light: PointLight) -> Totals:
        assert gbuffer.position is not None
        to_light = Vec3.from_array(light.position) - gbuffer.position
        distance = length(to_light)
        lit = (dot(gbuffer.normal, to_light) > 0) & (distance > 0)
        if gbuffer.spread is None:  # else points are not pixels, and have no weight
            lit = lit & (weight > 0)
        return (
            jnp.sum(jnp.log(jnp.where(lit, distance, 1))),
            jnp.sum(lit, dtype=distance.dtype),
            jnp.min(jnp.where(lit, distance, jnp.inf)),
            jnp.max(jnp.where(lit, distance, 0)),
            jnp.sum(lit & (distance < limit), dtype=distance.dtype),
        )

    def merged(a: Totals, b: Totals) -> Totals:
        near, far = jnp.minimum(a[2], b[2]), jnp.maximum(a[3], b[3])
        return a[0] + b[0], a[1] + b[1], near, far, a[4] + b[4]

    def of_image(total: Totals, image: tuple[Scene, Array]) -> tuple[Totals, None]:
        scene, weight = image

        def add_block(b: Array, total: Totals) -> Totals:
            gbuffer = jax.tree.map(lambda plane: plane[b], group.blocks)
            for light in scene.lights:
                if isinstance(light, PointLight):
                    total = merged(total, of_light(gbuffer, weight[b], light))
            return total

        return lax.fori_loop(0, group.own(group.count), add_block, total), None

    zero = jnp.zeros((), group.weight.dtype)
    start = (zero, zero, zero + jnp.inf, zero, zero)
    images = (group.scenes, group.weight)
    if group.mesh is None:
        return lax.scan(of_image, start, images)[0]
    devices = group.mesh.axis_names
    own = lax.scan(of_image, lax.pcast(start, devices, to="varying"), images)[0]
    over = (lax.psum, lax.psum, lax.pmin, lax.pmax, lax.psum)
    return tuple(of_all(value, devices) for of_all, value in zip(over, own, strict=True))
