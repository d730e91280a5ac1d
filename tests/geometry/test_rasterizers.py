"""Arrays as nvdiffrast and PyTorch3D give them, by the recipes of `GBuffer.from_arrays`.

Both are imitated here, pixel by pixel, by their documentation alone: what a pixel of a tensor holds, and
where on the image it lies.
"""

from typing import Any, NamedTuple

import numpy as np
import pytest
import trimesh

import diffshade as ds

WIDTH, HEIGHT, FOV = 24, 18, 0.7
EYE, TARGET, UP = np.array([1.5, 1.0, 3.0]), np.array([0.1, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
BALL = trimesh.creation.icosphere(subdivisions=1)
VERTICES, FACES = np.asarray(BALL.vertices), np.asarray(BALL.faces)
SCENE = ds.Scene(
    ambient=0.1, lights=(ds.PointLight((2.0, 3.0, 2.0), 3.0), ds.ParallelLight((-1, 0, 1), 0.5))
)
MATERIAL = ds.Material(0.5, (0.5, 0.4, 0.3), ds.Phong(0.3, 20.0))


class Hits(NamedTuple):
    """The nearest face of each pixel, -1 where there is none, and the weights of its corners."""

    face: np.ndarray
    weights: np.ndarray

    def interpolated(self, values: np.ndarray) -> np.ndarray:
        """[H, W, 3]; 0 outside."""
        corners = values[FACES[np.maximum(self.face, 0)]]
        mean = (self.weights[..., None] * corners).sum(axis=2)
        return np.where(self.face[..., None] >= 0, mean, 0)


def axes() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Right, up and backward, of a camera at EYE that looks at TARGET."""
    backward = (EYE - TARGET) / np.linalg.norm(EYE - TARGET)
    right = np.cross(UP, backward)
    right /= np.linalg.norm(right)
    return right, np.cross(backward, right), backward


def rasterized(x: np.ndarray, y: np.ndarray, depth: np.ndarray, at: tuple[Any, Any]) -> Hits:
    """Of projected vertices, at points [H, W] of the image; weights are those on the surface."""
    px, py = at
    face, weights = np.full(px.shape, -1), np.zeros((*px.shape, 3))
    nearest = np.full(px.shape, np.inf)
    for number, (a, b, c) in enumerate(FACES):

        def edge(p: int, q: int) -> np.ndarray:
            return (x[q] - x[p]) * (py - y[p]) - (y[q] - y[p]) * (px - x[p])

        area = (x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a])
        flat = np.stack([edge(b, c), edge(c, a), edge(a, b)], axis=-1) / area
        lifted = flat / depth[[a, b, c]]
        far = 1 / lifted.sum(axis=-1)
        hit = (flat > 0).all(axis=-1) & (far < nearest)
        face[hit], nearest[hit] = number, far[hit]
        weights[hit] = (lifted * far[..., None])[hit]
    return Hits(face, weights)


def nvdiffrast() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`rast` [1, H, W, 4] = (u, v, z/w, triangle_id), and interpolated positions and normals.

    Row 0 is the bottom; (u, v) is (1, 0) at the first vertex and (0, 1) at the second; triangle_id counts
    from 1, and all is 0 where there is no triangle.
    """
    right, up, backward = axes()
    view = np.stack([(VERTICES - EYE) @ axis for axis in (right, up, backward)], axis=1)
    w = -view[:, 2]
    scale = 1 / np.tan(FOV / 2)
    x, y = scale * HEIGHT / WIDTH * view[:, 0] / w, scale * view[:, 1] / w
    column, row = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    hits = rasterized(x, y, w, ((2 * column + 1) / WIDTH - 1, (2 * row + 1) / HEIGHT - 1))
    rast = np.zeros((1, HEIGHT, WIDTH, 4), np.float32)
    rast[0, ..., :2] = hits.weights[..., :2]
    rast[0, ..., 3] = hits.face + 1
    return rast, hits.interpolated(VERTICES)[None], hits.interpolated(VERTICES)[None]


def pytorch3d() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`pix_to_face` [1, H, W, 1], and positions and normals interpolated by `bary_coords`.

    View axes have x left, y up and z forward, as has NDC, whose shorter side is [-1, 1]. Row 0 and column
    0 are at the top left, at (+s, +1); pix_to_face is -1 where there is no face.
    """
    right, up, backward = axes()
    view = np.stack([(VERTICES - EYE) @ axis for axis in (-right, up, -backward)], axis=1)
    scale = 1 / np.tan(FOV / 2)
    x, y = scale * view[:, 0] / view[:, 2], scale * view[:, 1] / view[:, 2]
    column, row = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    s = WIDTH / HEIGHT
    hits = rasterized(
        x, y, view[:, 2], (s * (1 - (2 * column + 1) / WIDTH), 1 - (2 * row + 1) / HEIGHT)
    )
    return hits.face[None, ..., None], hits.interpolated(VERTICES), hits.interpolated(VERTICES)


@pytest.fixture(scope="module")
def ours() -> tuple[np.ndarray, np.ndarray]:
    """The mask and the image by our own rays."""
    camera = ds.PerspectiveCamera(WIDTH, HEIGHT, FOV, tuple(EYE), tuple(TARGET), tuple(UP))
    gbuffer = ds.gbuffer(ds.Mesh(VERTICES, FACES, normals=VERTICES), camera)
    return np.asarray(gbuffer.mask), np.asarray(ds.render(gbuffer, SCENE, MATERIAL))


def check(gbuffer: ds.GBuffer, ours: tuple[np.ndarray, np.ndarray]) -> None:
    mask, image = ours
    inside = np.asarray(gbuffer.mask)
    assert 80 < mask.sum() < 300
    np.testing.assert_array_equal(inside, mask)
    found = np.asarray(ds.render(gbuffer, SCENE, MATERIAL))
    np.testing.assert_allclose(found, image, atol=2e-4)
    assert image.max() > 0.5


def test_nvdiffrast(ours: tuple[np.ndarray, np.ndarray]) -> None:
    rast, position, normal = nvdiffrast()
    gbuffer = ds.GBuffer.from_arrays(
        position[0, ::-1], normal[0, ::-1], rast[0, ::-1, :, 3] > 0, eye=EYE
    )
    check(gbuffer, ours)


def test_nvdiffrast_the_wrong_way_up_is_seen(ours: tuple[np.ndarray, np.ndarray]) -> None:
    rast, position, normal = nvdiffrast()
    gbuffer = ds.GBuffer.from_arrays(position[0], normal[0], rast[0, ..., 3] > 0, eye=EYE)
    with pytest.raises(AssertionError):
        check(gbuffer, ours)


def test_pytorch3d(ours: tuple[np.ndarray, np.ndarray]) -> None:
    pix_to_face, position, normal = pytorch3d()
    check(ds.GBuffer.from_arrays(position, normal, pix_to_face[0, ..., 0] >= 0, eye=EYE), ours)


def test_pytorch3d_in_view_axes() -> None:
    """Positions and normals of its camera's own axes: about that camera, turned to ours."""
    pix_to_face, position, normal = pytorch3d()
    right, up, backward = axes()
    turn = np.stack([-right, up, -backward], axis=1)
    seen = ds.GBuffer.from_arrays(
        ((position - EYE) @ turn) * (-1, 1, -1),
        (normal @ turn) * (-1, 1, -1),
        pix_to_face[0, ..., 0] >= 0,
        eye=(0, 0, 0),
    )
    light = np.array([2.0, 3.0, 2.0])
    place = np.array([right, up, backward]) @ (light - EYE)
    world = ds.GBuffer.from_arrays(position, normal, pix_to_face[0, ..., 0] >= 0, eye=EYE)
    images = [
        np.asarray(ds.render(g, ds.Scene(lights=ds.PointLight(p, 1.0)), MATERIAL))
        for g, p in ((seen, place), (world, light))
    ]
    np.testing.assert_allclose(images[0], images[1], atol=2e-4)
