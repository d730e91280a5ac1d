"""The analytic sphere (LIGHT-14 to LIGHT-16), for any camera."""

from functools import partial
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from diffshade import guard
from diffshade.arrays import vector
from diffshade.buckets import bucket
from diffshade.errors import BadInput
from diffshade.geometry.camera import AbstractCamera, Frame, Rays
from diffshade.geometry.fields import number
from diffshade.geometry.surface import AbstractSurface, Crossings, Visibility
from diffshade.vector import Vec3, dot

__all__ = ["Sphere"]


class Sphere(AbstractSurface):
    """|P - center| = radius (LIGHT-14), radius > 0, seen from outside.

    A pixel is foreground where the ray through its centre meets the sphere, the outline included.
    A camera inside sees nothing of it. On the outline the depth has derivative 0. In the `layers` of
    transparent surfaces its far side is seen too, from a camera inside as well.

    >>> Sphere(center=(0, 0, 0), radius=1.0).center.shape
    (3,)
    """

    center: Float[Array, "3"] = eqx.field(
        converter=vector("the sphere's center"), default=(0.0, 0.0, 0.0)
    )
    radius: Float[Array, ""] = eqx.field(converter=number("the sphere's radius"), default=1.0)
    follows_rays: ClassVar[bool] = True

    def visibility(self, camera: AbstractCamera) -> Visibility:
        near, _ = self._distances(camera)
        # Converted on the host: JAX would compile that for every number of pixels.
        index = np.flatnonzero(_in_front(near, camera)).astype(np.int32)
        return Visibility((camera.height, camera.width), jax.device_put(index))

    def crossings(self, camera: AbstractCamera, count: int | None = None) -> Crossings:
        near, far = self._distances(camera)
        # On the outline the two are one
        met = np.stack([_in_front(near, camera), _in_front(far, camera) & (far > near)])
        if count == 1:
            met[1] &= ~met[0]
        inside, index = (numbers.astype(np.int32) for numbers in np.nonzero(met))
        seen = Visibility(
            shape=(camera.height, camera.width),
            index=jax.device_put(index),
            inside=jax.device_put(inside.astype(bool)),
        )
        return Crossings(seen, np.stack([near, far])[met])

    def _distances(self, camera: AbstractCamera) -> Float[np.ndarray, "2 N"]:
        """Of every pixel's ray, where it enters and where it leaves; NaN where it does not meet."""
        if not float(self.radius) > 0:
            raise BadInput(f"the sphere's radius is {float(self.radius):g}: it must be above 0")
        count = camera.width * camera.height
        with jax.enable_x64(True):  # the outline is that of the numbers given, not of roundings
            exact = jax.tree.map(partial(np.asarray, dtype=np.float64), (self, camera.unframed()))
            middle, square = map(np.asarray, _chord(*exact, camera.frame, bucket(count)))
        with np.errstate(invalid="ignore"):
            half = np.sqrt(square)
        return np.stack([middle - half, middle + half])[:, :count]

    def points(self, rays: Rays, visibility: Visibility) -> tuple[Vec3, Vec3]:
        _, across, depth_squared = self._closest(rays)
        # LIGHT-15: z = sqrt(r^2 - dx^2 - dy^2), measured back along the ray from its closest point
        # to the centre. Its derivative on the outline, where z = 0, is infinite; here it is 0 there.
        depth, side = guard.sqrt(depth_squared), visibility.side(depth_squared.dtype)
        depth = depth if side is None else depth * side
        normal = (across - rays.direction * depth) * (1 / self.radius)
        # LIGHT-16, the other way round: from the eye, which may be far, rounding would be larger.
        position = Vec3.from_array(self.center) + normal * self.radius
        return position, normal if side is None else normal * side

    def hides(
        self,
        points: Float[np.ndarray, "N 3"],
        towards: Float[np.ndarray, "N 3"],
        distance: Float[np.ndarray, "N"],
        eps: float,
    ) -> Bool[np.ndarray, "N"]:
        # From a point of the sphere a ray comes nearer to the centre only where it goes in, and there
        # n.l < 0: whatever rounding says of such a point, it is dark. From inside it is seen through.
        from_centre = points - np.asarray(self.center, np.float64)
        along = -(from_centre * towards).sum(axis=1)
        near = from_centre + along[:, None] * towards
        radius = float(self.radius)
        depth_squared = radius**2 - (near * near).sum(axis=1)
        enters = along - np.sqrt(np.maximum(depth_squared, 0))
        hidden = (along > 0) & (depth_squared > 0) & (enters < distance)
        # A source on the sphere, as of a ball that glows, is not hidden where the ray meets it first.
        source = from_centre + np.where(np.isfinite(distance), distance, 0)[:, None] * towards
        size = np.abs(points).max(axis=1, initial=0) + radius
        off = 16 * (np.finfo(np.float32).eps * radius + eps * size)
        on_it = np.abs(np.sqrt((source * source).sum(axis=1)) - radius) <= off
        faces = (source * towards).sum(axis=1) < 0
        return hidden & ~(np.isfinite(distance) & on_it & faces)

    def _closest(self, rays: Rays) -> tuple[Float[Array, "P"], Vec3, Float[Array, "P"]]:
        """Of each ray, where it passes closest to the centre, that point from there, and z^2 there."""
        origin, direction = rays
        from_centre = origin - Vec3.from_array(self.center)
        along = -dot(from_centre, direction)
        near = from_centre + direction * along
        # A direction is a unit vector to rounding, which far away shows: near is not quite across.
        across = near - direction * dot(near, direction)
        return along, across, self.radius**2 - dot(across, across)


@jax.jit(static_argnames="count")
def _chord(
    sphere: Sphere, camera: AbstractCamera, frame: Frame, count: int
) -> tuple[Float[Array, "N"], Float[Array, "N"]]:
    """Along each ray, the middle of what is inside, and the square of half its length."""
    pixels = frame.points(jnp.arange(count, dtype=jnp.int32), camera.up.dtype)
    along, _, depth_squared = sphere._closest(camera.through(*pixels))
    return along, depth_squared


def _in_front(distance: Float[np.ndarray, "N"], camera: AbstractCamera) -> Bool[np.ndarray, "N"]:
    return distance > (-np.inf if camera.position is None else 0)
