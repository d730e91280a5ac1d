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
    "sphere_weights",
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
    """The unit normals of triangles; zero, with derivative 0, for one without area up to rounding.

    From edges of unit length: the square of an area leaves the range of float32 for edges below
    1e-9 or above 1e9.
    """
    return _unit_above_rounding(cross(unit(b - a), unit(c - a)), jnp.ones_like(a.x))


def newell_normal(polygon: Float[Array, "N 3"]) -> Float[Array, "3"]:
    """Unit normal of any polygon, by Newell's method (text C): concave and non-planar ones too.

    The components are twice the areas of the polygon's projections on the three coordinate planes,
    N_x = sum (y_i - y_j)(z_i + z_j) and so on in turn, j the vertex after i. It points to the side
    from which the vertices run counter-clockwise. A polygon of no area gives zero, with derivative 0.

    >>> newell_normal(jnp.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])).tolist()
    [0.0, 0.0, 1.0]
    """
    # About the centroid: the sum is the same, with no cancellation for a polygon far from the origin.
    about = polygon - jnp.mean(polygon, axis=0, keepdims=True)
    # In units of its own size, a constant to derivatives: squares of small coordinates leave the range
    here = Vec3.from_array(about * guard.reciprocal(lax.stop_gradient(jnp.max(jnp.abs(about)))))
    after = Vec3(*(jnp.roll(plane, -1) for plane in (here.x, here.y, here.z)))
    less, more = here - after, here + after
    normal = Vec3(
        jnp.sum(less.y * more.z),
        jnp.sum(less.z * more.x),
        jnp.sum(less.x * more.y),
    )
    return _unit_above_rounding(normal, jnp.sum(dot(here, here))).to_array()


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
        u, w = unit(left - at), unit(right - at)
        opposite, adjacent = length(cross(u, w)), dot(u, w)
        # arctan2 has no derivative at (0, 0), the corner of a face without extent
        nothing = (opposite == 0) & (adjacent == 0)
        return jnp.arctan2(opposite, jnp.where(nothing, 1, adjacent))

    return jnp.stack([angle(a, b, c), angle(b, c, a), angle(c, a, b)])


def sphere_weights(a: Vec3, b: Vec3, c: Vec3) -> Float[Array, "3 F"]:
    """Exact where the vertices lie on a sphere: sin(angle) / (|u| |w|) of the edges u, w (Max 1999).

    The normals of a smooth surface are then right to second order in the length of its edges, those
    of the other means to first order. A sliver with short edges outvotes all its neighbours, so it
    is for clean meshes: second derivatives are finite in float32 for edges of 1e-6 and more. Max,
    Weights for computing vertex normals from facet normals, JGT 4 (2).
    """

    def weight(at: Vec3, left: Vec3, right: Vec3) -> Float[Array, "F"]:
        u, w = left - at, right - at
        lengths = guard.reciprocal(length(u)) * guard.reciprocal(length(w))
        return length(cross(unit(u), unit(w))) * lengths

    return jnp.stack([weight(a, b, c), weight(b, c, a), weight(c, a, b)])


def vertex_normals(
    vertices: Float[Array, "V 3"], faces: Int[Array, "F 3"], *, weights: Weights = uniform_weights
) -> Vec3:
    """N_v = sum w_k N_k / |sum w_k N_k| over the faces k at a vertex (text B).

    `weights` is `uniform_weights` (text B), `area_weights`, `angle_weights` or `sphere_weights`.
    Degenerate faces do not count. A vertex of no face, or whose faces' normals cancel up to
    rounding, has normal zero, with derivative 0.
    """
    count, at = vertices.shape[0], faces.T.ravel()
    corners = tuple(Vec3.from_array(vertices[faces[:, k]]) for k in range(3))
    flat = jnp.tile(plane_normals(*corners).to_array(), (3, 1))
    weight = weights(*corners).ravel()
    # Only the ratios of the weights at a vertex count: the largest is scaled to 1, so that squares
    # of sums stay in the range of float32.
    largest = jax.ops.segment_max(lax.stop_gradient(weight), at, count)
    weight = weight * guard.reciprocal(largest)[at]
    shares = jnp.concatenate([weight[:, None] * flat, weight[:, None]], axis=1)
    x, y, z, terms = jax.ops.segment_sum(shares, at, count).T
    return _unit_above_rounding(Vec3(x, y, z), terms)


def _unit_above_rounding(v: Vec3, terms: Float[Array, "*N"]) -> Vec3:
    """v / |v|, or zero where v is but what rounding left of terms of that size."""
    rounding = 8 * float(jnp.finfo(terms.dtype).eps) * terms
    some = dot(v, v) > rounding**2
    return unit(Vec3(*(jnp.where(some, plane, 0) for plane in (v.x, v.y, v.z))))
