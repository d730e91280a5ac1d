"""Normals of polygons and of vertices."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from diffshade import guard
from diffshade.vector import Vec3, cross, dot, length, unit

__all__ = [
    "angle_weights",
    "area_weights",
    "face_normals",
    "newell_normal",
    "plane_normals",
    "uniform_weights",
    "vertex_normals",
]

Weights = Callable[[Vec3, Vec3, Vec3], Float[Array, "3 F"]]


def face_normals(a: Vec3, b: Vec3, c: Vec3) -> Vec3:
    """(b - a) x (c - a) of triangles counter-clockwise seen from outside.

    It points outwards, and its length is twice the triangle's area: zero for a degenerate one.
    """
    return cross(b - a, c - a)


def plane_normals(a: Vec3, b: Vec3, c: Vec3) -> Vec3:
    """The unit normals of triangles; zero, with derivative 0, for one without area.

    From edges of unit length: the square of an area leaves the range of float32 for edges below
    1e-9 or above 1e9.
    """
    return unit(cross(unit(b - a), unit(c - a)))


def newell_normal(polygon: Float[Array, "N 3"]) -> Float[Array, "3"]:
    """Unit normal of any polygon, by Newell's method (text C): concave and non-planar ones too.

    The components are twice the areas of the polygon's projections on the three coordinate planes,
    N_x = sum (y_i - y_j)(z_i + z_j) and so on in turn, j the vertex after i. It points to the side
    from which the vertices run counter-clockwise. A polygon of no area gives zero, with derivative 0.

    >>> newell_normal(jnp.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])).tolist()
    [0.0, 0.0, 1.0]
    """
    # About the centroid: the sum is the same, with no cancellation for a polygon far from the origin.
    here = Vec3.from_array(polygon - jnp.mean(polygon, axis=0))
    after = Vec3(*(jnp.roll(plane, -1) for plane in (here.x, here.y, here.z)))
    less, more = here - after, here + after
    normal = Vec3(
        jnp.sum(less.y * more.z),
        jnp.sum(less.z * more.x),
        jnp.sum(less.x * more.y),
    )
    return unit(normal).to_array()


def uniform_weights(a: Vec3, b: Vec3, c: Vec3) -> Float[Array, "3 F"]:
    """Every face counts the same at each of its vertices, as text B has it."""
    return jnp.ones((3, *a.x.shape), a.x.dtype)


def area_weights(a: Vec3, b: Vec3, c: Vec3) -> Float[Array, "3 F"]:
    """A face counts by its area: fine triangulations of a flat part do not outvote it."""
    left, right = b - a, c - a
    area = length(cross(unit(left), unit(right))) * length(left) * length(right)
    return jnp.broadcast_to(area, (3, *area.shape))


def angle_weights(a: Vec3, b: Vec3, c: Vec3) -> Float[Array, "3 F"]:
    """A face counts by its angle at the vertex: the result does not depend on the triangulation."""

    def angle(at: Vec3, left: Vec3, right: Vec3) -> Float[Array, "F"]:
        u, w = left - at, right - at
        opposite, adjacent = length(cross(u, w)), dot(u, w)
        # arctan2 has no derivative at (0, 0), the corner of a face without extent
        some = (opposite != 0) | (adjacent != 0)
        return jnp.where(
            some, jnp.arctan2(jnp.where(some, opposite, 0), jnp.where(some, adjacent, 1)), 0
        )

    return jnp.stack([angle(a, b, c), angle(b, c, a), angle(c, a, b)])


def vertex_normals(
    vertices: Float[Array, "V 3"], faces: Int[Array, "F 3"], *, weights: Weights = uniform_weights
) -> Vec3:
    """N_v = sum w_k N_k / |sum w_k N_k| over the faces k at a vertex (text B).

    `weights` is `uniform_weights` (text B), `area_weights` or `angle_weights`. Degenerate faces do
    not count. A vertex of no face, or whose faces' normals cancel, has normal zero, with derivative 0.
    """
    corners = tuple(Vec3.from_array(vertices[faces[:, k]]) for k in range(3))
    flat = plane_normals(*corners).to_array()
    weight = weights(*corners)
    # Only the ratios of the weights count: scaled to 1 their sum stays in the range of float32.
    weight = weight * guard.reciprocal(lax.stop_gradient(jnp.max(weight, initial=0)))
    total = jnp.zeros_like(vertices)
    for k in range(3):
        share = weight[k][:, None] * flat
        total = total + jax.ops.segment_sum(share, faces[:, k], vertices.shape[0])
    return unit(Vec3.from_array(total))
