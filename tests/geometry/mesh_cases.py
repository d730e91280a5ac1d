"""Meshes made here, and a ray caster that tries every triangle."""

import jax.numpy as jnp
import numpy as np

from diffshade.geometry.camera import AbstractCamera
from diffshade.geometry.mesh import Mesh

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
CUBE_QUADS = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
CUBE_FACES = np.concatenate([CUBE_QUADS[:, [0, 1, 2]], CUBE_QUADS[:, [0, 2, 3]]])


def cube() -> Mesh:
    """Twelve triangles, corners at -1 and 1, outside outwards."""
    return Mesh(CUBE, CUBE_FACES)


def icosphere(levels: int) -> tuple[np.ndarray, np.ndarray]:
    """20 * 4**levels triangles with all vertices on the unit sphere."""
    golden = (1 + 5**0.5) / 2
    signs = [(a, b) for a in (-1, 1) for b in (-golden, golden)]
    corners = [np.roll([0, a, b], shift) for shift in range(3) for a, b in signs]
    vertices = np.array(corners, np.float64) / np.hypot(1, golden)
    near = np.linalg.norm(vertices[:, None] - vertices[None], axis=-1) < 1.1
    faces = [
        (a, b, c) if np.linalg.det(vertices[[a, b, c]]) > 0 else (a, c, b)
        for a in range(12)
        for b in range(a)
        for c in range(b)
        if near[a, b] and near[b, c] and near[a, c]
    ]
    triangles = vertices[np.array(faces)]
    for _ in range(levels):
        a, b, c = np.moveaxis(triangles, 1, 0)
        ab, bc, ca = a + b, b + c, c + a
        split = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(corner, axis=1) for corner in split])
        triangles /= np.linalg.norm(triangles, axis=-1, keepdims=True)
    rounded = np.round(triangles.reshape(-1, 3), 9) + 0.0
    _, first, number = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    return triangles.reshape(-1, 3)[first], number.reshape(-1, 3)


def brute_force(
    mesh: Mesh, camera: AbstractCamera
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pixels, faces, barycentric coordinates and distances, from every ray and every triangle.

    By the signed volumes of the ray with each edge, which the library does not use.
    """
    count = camera.width * camera.height
    rays = camera.rays(jnp.arange(count))
    origin, direction = (
        np.broadcast_to(np.asarray(v.to_array(), np.float64), (count, 3))[:, None] for v in rays
    )
    corners = np.asarray(mesh.vertices, np.float64)[np.asarray(mesh.faces)][None]
    a, b, c = (corners[:, :, k] - origin for k in range(3))
    volumes = np.stack(
        [(np.cross(u, w) * direction).sum(-1) for u, w in ((b, c), (c, a), (a, b))], axis=-1
    )
    total = volumes.sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = volumes / total[..., None]
        normal = np.cross(b - a, c - a)
        distance = (a * normal).sum(-1) / (direction * normal).sum(-1)
    hit = (weights >= 0).all(-1) & (total != 0)
    if camera.position is not None:
        hit &= distance > 0
    distance = np.where(hit, distance, np.inf)
    face = distance.argmin(axis=1)
    pixel = np.flatnonzero(hit.any(axis=1))
    face = face[pixel]
    return pixel, face, weights[pixel, face], distance[pixel, face]
