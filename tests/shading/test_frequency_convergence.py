"""Meshes under Phong shading against the analytic sphere, as the mesh is refined (S6)."""

import numpy as np
import pytest

import diffshade as ds

CAMERA = ds.OrthographicCamera(160, 160, 2.2)
SCENE = ds.Scene(
    ambient=0.2,
    lights=(ds.PointLight((1.5, 1.0, 3.0), 0.9), ds.ParallelLight((-0.5, 0.2, 0.8), 0.4)),
)
MATERIAL = ds.Material(ka=0.1, kd=0.6, specular=ds.Phong(ks=0.5, shininess=15.0))


def icosphere(level: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices on the unit sphere and faces: an icosahedron, each face split in four `level` times."""
    g = (1 + 5**0.5) / 2
    edge = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0)]
    v = np.array([(*p[-k:], *p[:-k]) if k else p for k in (0, 1, 2) for p in edge], float)
    distance = np.linalg.norm(v[:, None] - v[None], axis=-1)
    near = np.isclose(distance, 2.0)
    f = np.array(
        [
            (a, b, c)
            for a in range(12)
            for b in range(a)
            for c in range(b)
            if near[a, b] and near[b, c] and near[a, c]
        ]
    )
    a, b, c = (v[f[:, k]] for k in range(3))
    outward = np.sum(np.cross(b - a, c - a) * a, axis=1)
    f[outward < 0] = f[outward < 0, ::-1]
    v = v / np.linalg.norm(v, axis=1, keepdims=True)
    for _ in range(level):
        edges = np.sort(f[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        middle = v[unique].mean(axis=1)
        a, b, c = (inverse.reshape(-1, 3) + len(v)).T
        v = np.concatenate([v, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        f = np.concatenate(
            [np.stack(t, 1) for t in ((f[:, 0], a, c), (a, f[:, 1], b), (c, b, f[:, 2]), (a, b, c))]
        )
    return v, f


@pytest.mark.slow
def test_second_order_over_the_common_interior() -> None:
    sphere = ds.gbuffer(ds.Sphere(), CAMERA)
    exact = np.asarray(ds.render(sphere, SCENE, MATERIAL))
    errors, missing, edges = [], [], []
    for level in (2, 3, 4, 5):
        vertices, faces = icosphere(level)
        # The sphere's own normals at the vertices: what is tested is their interpolation.
        mesh = ds.Mesh(vertices, faces, normals=vertices)
        gbuffer = ds.gbuffer(mesh, CAMERA)
        image = np.asarray(ds.render(gbuffer, SCENE, MATERIAL))
        common = sphere.mask & gbuffer.mask
        # Away from the outline and from the terminators, where the model itself has a kink.
        inner = common & interior()
        errors.append(float(np.sqrt(np.mean((image[inner] - exact[inner]) ** 2))))
        missing.append(int((sphere.mask & ~gbuffer.mask).sum()))
        assert not (gbuffer.mask & ~sphere.mask).any()
        edges.append(np.linalg.norm(vertices[faces[0, 0]] - vertices[faces[0, 1]]))
    orders = np.diff(np.log(errors)) / np.diff(np.log(edges))
    print("L2 errors", errors, "orders", orders, "pixels missing at the silhouette", missing)
    assert np.all(orders > 1.8)
    assert np.all(orders < 2.3)
    assert errors[-1] < 2e-4
    assert missing == sorted(missing, reverse=True)  # the silhouette shrinks onto the circle's


def interior() -> np.ndarray:
    """Pixels within nine tenths of the outline's radius."""
    row, column = np.indices((160, 160)) + 0.5
    return np.hypot(row - 80, column - 80) * 2.2 / 160 < 0.9


def test_flat_shading_is_adequate_far_away() -> None:
    """S4: with light and viewer far, flat shading of a polyhedron is per-pixel shading."""
    vertices, faces = icosphere(0)
    corners = vertices[faces].reshape(-1, 3)  # every face its own vertices: a polyhedron
    mesh = ds.Mesh(corners, np.arange(60).reshape(-1, 3))
    camera = ds.OrthographicCamera(48, 48, 2.2)
    material = ds.Material(kd=0.6, specular=ds.Phong(ks=0.5, shininess=15.0))

    def difference(far: float) -> float:
        scene = ds.Scene(lights=ds.PointLight((0.4 * far, 0.3 * far, far)))
        flat = ds.render(ds.gbuffer(mesh, camera, shading=ds.FlatShading()), scene, material)
        smooth = ds.render(ds.gbuffer(mesh, camera), scene, material)
        return float(np.abs(np.asarray(flat) - np.asarray(smooth)).max())

    assert difference(3.0) > 0.02
    assert difference(1e4) < 1e-4


def test_gouraud_loses_the_highlight_between_vertices() -> None:
    """S5: what falls between the vertices is lost; that is the method."""
    mesh = ds.Mesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    camera = ds.OrthographicCamera(33, 33, 1.8)
    scene = ds.Scene(lights=ds.PointLight((0, 0, 1.0)))
    material = ds.Material(specular=ds.Phong(ks=1.0, shininess=60.0))
    phong = np.asarray(ds.render(ds.gbuffer(mesh, camera), scene, material))
    gouraud = ds.render(ds.gbuffer(mesh, camera, shading=ds.GouraudShading()), scene, material)
    assert phong.max() > 0.99
    assert np.asarray(gouraud).max() < 0.01
