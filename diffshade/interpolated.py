"""Meshes that show what interpolated shading does, and where it goes wrong (text C, "Problems with
interpolated shading"), and the interpolation along scan lines that text B has.

The four problems, after Foley, van Dam, Feiner and Hughes, Computer Graphics, 16.2.6:

- a `ball` of faces has an outline of straight edges, however smoothly it is shaded;
- between the four corners of a square, `scan_lines` give other intensities when it turns, and two
  triangles (`square`) those of the diagonal that cuts it;
- a vertex that lies on an edge and does not belong to it leaves a seam along it (`diamond`);
- where the normals of faces cancel in the mean, what is bent looks flat (`corrugated`).
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from diffshade.arrays import ArrayLike, floats
from diffshade.errors import BadInput
from diffshade.geometry.fields import indices
from diffshade.geometry.mesh import Mesh
from diffshade.geometry.normals import angle_weights

__all__ = ["ball", "corrugated", "diamond", "scan_lines", "square"]

TWO_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
"""Of four corners in turn, cut from the first to the third."""


def ball(bands: int) -> Mesh:
    """The unit sphere in `bands` from pole to pole (the y axis), each of 2 * bands faces around it.

    All vertices lie on the sphere. Seen from the z axis its outline is a regular polygon of 2 * bands
    corners, of area bands * sin(pi / bands). Raises `BadInput` for fewer than two bands.

    >>> ball(3).faces.shape
    (24, 3)
    """
    if bands < 2:
        raise BadInput(f"a ball of {bands} bands has no faces: give two or more")
    around = 2 * bands
    down = np.pi * np.arange(1, bands)[:, None] / bands
    turn = 2 * np.pi * np.arange(around)[None, :] / around
    rings = np.stack(
        np.broadcast_arrays(
            np.sin(down) * np.cos(turn), np.cos(down), -np.sin(down) * np.sin(turn)
        ),
        axis=-1,
    )
    vertices = np.concatenate([[[0, 1.0, 0]], rings.reshape(-1, 3), [[0, -1.0, 0]]])
    at = 1 + np.arange((bands - 1) * around).reshape(bands - 1, around)
    after = np.roll(at, -1, axis=1)
    bottom = len(vertices) - 1
    caps = [
        np.stack([np.zeros_like(at[0]), at[0], after[0]], axis=-1),
        np.stack([at[-1], np.full_like(at[0], bottom), after[-1]], axis=-1),
    ]
    quads = np.stack([at[:-1], at[1:], after[1:], after[:-1]], axis=-1).reshape(-1, 4)
    return _mesh(vertices, np.concatenate([*caps, quads[:, TWO_TRIANGLES].reshape(-1, 3)]))


def scan_lines(
    corners: ArrayLike, intensities: ArrayLike, points: ArrayLike
) -> Float[np.ndarray, "*P"]:
    """Intensities at `points` [*P, 2] of a convex polygon `corners` [K, 2], by text B's formula.

    Along the two edges that the scan line of a point meets, and then across from the one to the other:
    I_4 = (y_4 - y_2)/(y_1 - y_2) I_1 + (y_1 - y_4)/(y_1 - y_2) I_2, likewise I_5, and
    I_p = (x_5 - x_p)/(x_5 - x_4) I_4 + (x_p - x_4)/(x_5 - x_4) I_5. Linear within a triangle; within a
    polygon of more corners it depends on how that lies. NaN outside; what lies level with the top is
    outside, and with the bottom inside. Raises `BadInput` for a polygon that is not convex.

    >>> scan_lines([[0, 0], [2, 0], [2, 2], [0, 2]], [0, 1, 2, 1], [[1.0, 0.5]]).tolist()
    [0.75]
    """
    corners, values = np.asarray(corners, float), np.asarray(intensities, float)
    if corners.ndim != 2 or corners.shape[1] != 2 or values.shape != corners.shape[:1]:
        raise BadInput(
            f"corners has shape {corners.shape} and intensities {values.shape}: give [K, 2] and [K]"
        )
    x, y = np.moveaxis(np.asarray(points, float), -1, 0)
    x4, x5 = np.full(x.shape, np.inf), np.full(x.shape, -np.inf)
    i4, i5, met = np.zeros(x.shape), np.zeros(x.shape), np.zeros(x.shape, int)
    for j in range(len(corners)):
        (x1, y1), (x2, y2) = corners[j - 1], corners[j]
        meets = (y1 <= y) != (y2 <= y)
        part = np.where(meets, (y - y2) / (y1 - y2 if y1 != y2 else 1), 0)
        on_edge, intensity = (
            part * x1 + (1 - part) * x2,
            part * values[j - 1] + (1 - part) * values[j],
        )
        first, last = meets & (on_edge <= x4), meets & (on_edge >= x5)
        x4, i4 = np.where(first, on_edge, x4), np.where(first, intensity, i4)
        x5, i5 = np.where(last, on_edge, x5), np.where(last, intensity, i5)
        met += meets
    if (met > 2).any():
        raise BadInput("a scan line meets more than two edges: give a convex polygon")
    inside = (met == 2) & (x4 <= x) & (x <= x5)
    wide = inside & (x5 > x4)
    across = np.where(wide, x - np.where(wide, x4, 0), 0) / np.where(wide, x5 - x4, 1)
    return np.where(inside, (1 - across) * i4 + across * i5, np.nan)


def square(intensities: ArrayLike, turn: float = 0.0, *, other_diagonal: bool = False) -> Mesh:
    """A square in two triangles, turned by an angle in radians: corners from bottom left, side 2.

    Under a parallel light from the viewer, k_d = 1, its corners have these `intensities` [4] in [0, 1]:
    that is what their normals are made for. It is cut from the first corner to the third, or else along
    the other diagonal.

    >>> square([0, 1, 0, 1]).vertices.shape
    (4, 3)
    """
    towards = np.asarray(intensities, float)
    if towards.shape != (4,) or not ((towards >= 0) & (towards <= 1)).all():
        raise BadInput(f"intensities are {towards.tolist()}: give four numbers from 0 to 1")
    zero, (cosine, sine) = np.zeros(4), (np.cos(turn), np.sin(turn))
    x, y = np.array([[-1.0, 1, 1, -1], [-1, -1, 1, 1]])
    vertices = np.stack([cosine * x - sine * y, sine * x + cosine * y, zero], axis=-1)
    aside = np.sqrt(1 - towards**2)
    normals = np.stack([cosine * aside, sine * aside, towards], axis=-1)
    return _mesh(vertices, (TWO_TRIANGLES + other_diagonal) % 4, normals)


def diamond(*, shared: bool) -> Mesh:
    """A flat square on its corner with the normals of a dome, (x, y, 1) / |(x, y, 1)|, in two halves.

    The right half has a vertex in the middle of the edge between the halves. If it is `shared`, so has
    the left one; if not, the two interpolate between different vertices along that edge (a T-junction).

    >>> [diamond(shared=shared).faces.shape[0] for shared in (False, True)]
    [3, 4]
    """
    vertices = np.array([[0.0, 0, 0], [0, -1, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0]])
    left = [[3, 4, 0], [0, 4, 1]] if shared else [[3, 4, 1]]
    faces = np.array([[1, 2, 0], [0, 2, 3], *left])
    return _mesh(vertices, faces, vertices + np.array([0, 0, 1.0]))


def corrugated(folds: int, height: float = 0.5, *, cuts: int = 1) -> Mesh:
    """A strip of 2 * `folds` slopes of width 1 along x, up to z = `height` and down, from y = -1 to 1.

    With one cut a slope all vertices are on the ridges and in the valleys, where the normals of two
    slopes have the mean (0, 0, 1): but for the two ends, all vertices have parallel normals. With more
    cuts slopes have vertices of their own.

    >>> corrugated(2).vertex_normals().z[1:4].round(6).tolist()
    [1.0, 1.0, 1.0]
    """
    if folds < 1 or cuts < 1:
        raise BadInput(f"{folds} folds of {cuts} cuts a slope: give one or more of each")
    x = np.linspace(-folds, folds, 2 * folds * cuts + 1)
    z = height * (1 - np.abs((x + folds) % 2 - 1))
    edges = [np.stack([x, np.full_like(x, y), z], axis=-1) for y in (-1, 1)]
    at = np.arange(len(x) - 1)
    quads = np.stack([at, at + 1, at + 1 + len(x), at + len(x)], axis=-1)
    faces = quads[:, TWO_TRIANGLES].reshape(-1, 3)
    return replace(_mesh(np.concatenate(edges), faces), weights=angle_weights)


def _mesh(
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    normals: Float[np.ndarray, "V 3"] | None = None,
) -> Mesh:
    given = None if normals is None else floats("normals")(normals)
    return Mesh(floats("vertices")(vertices), indices("faces")(faces), given)
