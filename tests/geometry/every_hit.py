"""Everything that the pixels' rays meet: each ray tried with each triangle and sphere, in NumPy."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

import diffshade as ds

__all__ = ["Hits", "every_hit"]


class Hits(NamedTuple):
    """One row a hit, sorted by pixel and then by distance."""

    pixel: np.ndarray
    distance: np.ndarray
    owner: np.ndarray
    face: np.ndarray
    inside: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    """That of the triangle's plane or of the sphere, to the viewer."""

    def layer(self, k: int, owner: int) -> "Hits":
        """Those of an object that are their pixel's k-th."""
        _, first = np.unique(self.pixel, return_index=True)
        rank = np.arange(self.pixel.size) - first[np.searchsorted(self.pixel[first], self.pixel)]
        return Hits(*(x[(rank == k) & (self.owner == owner)] for x in self))


def every_hit(objects: list[ds.Mesh | ds.Sphere], camera: ds.OrthographicCamera) -> Hits:
    """All hits in front of the camera."""
    count = camera.width * camera.height
    origin, direction = (
        np.broadcast_to(np.asarray(v.to_array(), np.float64), (count, 3))
        for v in camera.rays(jnp.arange(count, dtype=jnp.int32))
    )
    parts = []
    for owner, surface in enumerate(objects):
        of = _sphere if isinstance(surface, ds.Sphere) else _mesh
        pixel, face, distance, outward = of(surface, origin, direction)
        inside = (outward * direction[pixel]).sum(axis=1) > 0
        position = origin[pixel] + distance[:, None] * direction[pixel]
        normal = np.where(inside[:, None], -outward, outward)
        owners = np.full(pixel.size, owner)
        parts.append(Hits(pixel, distance, owners, face, inside, position, normal))
    hits = Hits(*map(np.concatenate, zip(*parts, strict=True)))
    if camera.position is not None:
        hits = Hits(*(x[hits.distance > 0] for x in hits))
    return Hits(*(x[np.lexsort((hits.distance, hits.pixel))] for x in hits))


def _sphere(sphere, origin, direction):  # type: ignore[no-untyped-def]
    """The roots of |o + t d - c|^2 = r^2."""
    s = origin - np.asarray(sphere.center, np.float64)
    radius = float(sphere.radius)
    b, c = (s * direction).sum(axis=1), (s * s).sum(axis=1) - radius**2
    pixel = np.flatnonzero(b * b > c)
    root = np.sqrt((b * b - c)[pixel])
    pixel, distance = np.tile(pixel, 2), np.concatenate([-b[pixel] - root, -b[pixel] + root])
    outward = (s[pixel] + distance[:, None] * direction[pixel]) / radius
    return pixel, np.zeros(pixel.size, int), distance, outward


def _mesh(mesh, origin, direction):  # type: ignore[no-untyped-def]
    """Moeller and Trumbore, every ray and every triangle."""
    corners = np.asarray(mesh.vertices, np.float64)[np.asarray(mesh.faces)]
    a, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    o, d = origin[:, None], direction[:, None]
    across, s = np.cross(d, e2), o - a
    det, turned = (e1 * across).sum(-1), np.cross(s, e1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v, t = (
            x / det for x in ((s * across).sum(-1), (d * turned).sum(-1), (e2 * turned).sum(-1))
        )
        pixel, face = np.nonzero((u >= 0) & (v >= 0) & (u + v <= 1))
    outward = np.cross(e1, e2)[face]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    return pixel, face, t[pixel, face], outward
