"""The problems of interpolated shading (row S7), each in numbers."""

from typing import Any

import numpy as np
import pytest

import diffshade as ds
from diffshade import interpolated

HEAD_ON = ds.Scene(lights=ds.ParallelLight((0, 0, 1)))
WHITE = ds.Material(kd=1.0)
CORNERS = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
CHECKED = (0.0, 1.0, 0.0, 1.0)


def picture(mesh: ds.Mesh, shading: Any, scene: ds.Scene = HEAD_ON, extent: float = 2.2) -> Any:
    camera = ds.OrthographicCamera(33, 33, extent)
    return np.asarray(ds.render(ds.gbuffer(mesh, camera, shading=shading), scene, WHITE))[..., 0]


def turned(points: np.ndarray, angle: float) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return points @ np.array([[cosine, sine], [-sine, cosine]])


class TestSilhouette:
    @pytest.mark.parametrize("bands", [2, 3, 8])
    def test_a_ball_is_closed_and_on_the_sphere(self, bands: int, tolerance: float) -> None:
        mesh = interpolated.ball(bands)
        faces = np.asarray(mesh.faces)
        assert len(mesh.vertices) - len(faces) / 2 == 2  # Euler
        np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1, atol=10 * tolerance)
        centroids = np.asarray(mesh.vertices)[faces].mean(axis=1)
        assert (np.sum(centroids * np.asarray(mesh.face_normals().to_array()), axis=1) > 0).all()

    @pytest.mark.parametrize("bands", [3, 6])
    def test_the_outline_is_a_polygon(self, bands: int) -> None:
        seen = ds.visibility(interpolated.ball(bands), ds.OrthographicCamera(256, 256, 2.2))
        area = seen.index.size * (2.2 / 256) ** 2
        assert abs(area - bands * np.sin(np.pi / bands)) < 0.01
        assert area < 0.96 * np.pi  # by 17 and 4.5 % smaller than the circle

    def test_one_band_is_refused(self) -> None:
        with pytest.raises(ds.BadInput, match="1 bands"):
            interpolated.ball(1)


class TestOrientation:
    def test_a_triangle_is_interpolated_linearly(self) -> None:
        corners = np.array([[-0.9, -0.7], [0.8, -0.3], [-0.1, 0.95]])
        weights = np.random.default_rng(1).dirichlet([1, 1, 1], 50)
        values = np.array([0.3, -1.0, 2.0])
        found = interpolated.scan_lines(corners, values, weights @ corners)
        np.testing.assert_allclose(found, weights @ values, rtol=1e-9, atol=1e-12)

    def test_a_level_square_is_interpolated_bilinearly(self) -> None:
        values = np.array([0.1, 0.9, 0.4, 0.7])
        x, y = np.random.default_rng(2).uniform(-1, 1, (2, 50))
        u, v = (x + 1) / 2, (y + 1) / 2
        expected = (1 - v) * ((1 - u) * 0.1 + u * 0.9) + v * ((1 - u) * 0.7 + u * 0.4)
        found = interpolated.scan_lines(CORNERS, values, np.stack([x, y], -1))
        np.testing.assert_allclose(found, expected, rtol=1e-12)

    @pytest.mark.parametrize(("degrees", "centre"), [(0, 0.5), (45, 1.0), (-45, 0.0)])
    def test_scan_lines_change_as_a_square_turns(self, degrees: float, centre: float) -> None:
        """Level, the centre is the mean of all corners; on its corner, that of the two beside it."""
        corners = turned(CORNERS, np.radians(degrees))
        corners = np.round(corners, 12)
        found = interpolated.scan_lines(corners, CHECKED, np.zeros((1, 2)))
        np.testing.assert_allclose(found, [centre], atol=1e-12)

    @pytest.mark.parametrize(("other_diagonal", "centre"), [(False, 0.0), (True, 1.0)])
    def test_triangles_do_not_change_and_depend_on_the_diagonal(
        self, other_diagonal: bool, centre: float, tolerance: float
    ) -> None:
        points = np.random.default_rng(3).uniform(-0.99, 0.99, (40, 2))
        u, v = (points.T + 1) / 2
        # 1 at both ends of the other diagonal, 0 at those of the first, a plane on each side of the cut
        expected = 1 - abs(u + v - 1) if other_diagonal else abs(u - v)
        for angle in (0.0, np.pi / 4, 1.1):
            mesh = interpolated.square(CHECKED, angle, other_diagonal=other_diagonal)
            image = picture(mesh, ds.GouraudShading(), extent=3.0)
            assert abs(image[16, 16] - centre) < 10 * tolerance
            corners = np.asarray(mesh.vertices, float)[:, :2]
            found = np.full(len(points), np.nan)
            for face in np.asarray(mesh.faces):
                at = interpolated.scan_lines(
                    corners[face], np.array(CHECKED)[face], turned(points, angle)
                )
                found = np.where(np.isnan(found), at, found)
            np.testing.assert_allclose(found, expected, atol=20 * tolerance)

    def test_the_library_interpolates_triangles_as_scan_lines_do(self, tolerance: float) -> None:
        mesh = interpolated.square((0.2, 1.0, 0.5, 0.8), 0.3)
        image = picture(mesh, ds.GouraudShading(), extent=3.0)
        row, column = np.indices(image.shape) + 0.5
        points = np.stack([column * 3 / 33 - 1.5, 1.5 - row * 3 / 33], axis=-1)
        corners = np.asarray(mesh.vertices, float)[:, :2]
        compared = 0
        for face in np.asarray(mesh.faces):
            values = np.array([0.2, 1.0, 0.5, 0.8])[face]
            expected = interpolated.scan_lines(corners[face], values, points)
            inside = np.isfinite(expected)
            np.testing.assert_allclose(image[inside], expected[inside], atol=30 * tolerance)
            compared += inside.sum()
        assert compared > 400

    def test_outside_is_nothing(self) -> None:
        points = [[0, 1.5], [1.5, 0], [-1.5, 0], [0, -1.5]]
        assert np.isnan(interpolated.scan_lines(CORNERS, CHECKED, points)).all()

    def test_wrong_polygons_are_refused(self) -> None:
        arrow = [[0, 0], [2, -1], [0.5, 0], [2, 1]]
        with pytest.raises(ds.BadInput, match="convex"):
            interpolated.scan_lines(np.array(arrow)[:, ::-1], [1, 1, 1, 1], [[0.0, 1.0]])
        with pytest.raises(ds.BadInput, match=r"\[K, 2\] and \[K\]"):
            interpolated.scan_lines(CORNERS, [1, 1, 1], [[0.0, 1.0]])
        with pytest.raises(ds.BadInput, match="from 0 to 1"):
            interpolated.square([0, 1, 0, 2])


class TestSharedVertices:
    @pytest.mark.parametrize(
        ("shading", "middle", "quarter"),
        [
            # 1, against 1 / sqrt 2 of both ends; and the mean of these, against the same
            (ds.GouraudShading(), 1 - 0.5**0.5, (1 - 0.5**0.5) / 2),
            # Half way between (0, 0, 1) and (0, 1, 1) / sqrt 2, against (0, 1, 2) / sqrt 5
            (ds.PhongShading(), 0.0, np.cos(np.pi / 8) - 2 / 5**0.5),
        ],
        ids=["Gouraud", "Phong"],
    )
    def test_the_seam_of_a_t_junction(self, shading: Any, middle: float, quarter: float) -> None:
        """Across the edge between the halves, at its middle and a quarter along it."""
        camera = ds.OrthographicCamera(241, 241, 1.205)  # pixels 0.005 apart, one on the seam

        def jumps(shared: bool) -> Any:
            g = ds.gbuffer(interpolated.diamond(shared=shared), camera, shading=shading)
            image = np.asarray(ds.render(g, HEAD_ON, WHITE))[..., 0]
            return image[[120, 20], 121] - image[[120, 20], 119]

        np.testing.assert_allclose(jumps(shared=True), 0, atol=0.006)
        np.testing.assert_allclose(jumps(shared=False), [middle, quarter], atol=0.006)


class TestUnrepresentativeNormals:
    def test_a_corrugated_strip_looks_flat(self, tolerance: float) -> None:
        low = ds.Scene(lights=ds.ParallelLight((1, 0, 2)))
        cosine = 2 / np.sqrt(5)
        pictures = {
            name: picture(interpolated.corrugated(4), shading, low, extent=1.9)
            for name, shading in (
                ("flat", ds.FlatShading()),
                ("Gouraud", ds.GouraudShading()),
                ("Phong", ds.PhongShading()),
            )
        }
        for name in ("Gouraud", "Phong"):
            np.testing.assert_allclose(pictures[name], cosine, atol=20 * tolerance)
        # Of slopes with normals (-+1, 0, 2) / sqrt 5 one is faced by the light, one turned away from it
        flat = np.unique(pictures["flat"].round(5))
        np.testing.assert_allclose(flat, [0.6, 1.0], atol=1e-5)

    def test_more_vertices_bring_the_folds_back(self) -> None:
        low = ds.Scene(lights=ds.ParallelLight((1, 0, 2)))
        mesh = interpolated.corrugated(4, cuts=4)
        image = picture(mesh, ds.GouraudShading(), low, extent=1.9)
        assert image.max() > 0.99
        assert image.min() < 0.61

    def test_no_folds_are_refused(self) -> None:
        with pytest.raises(ds.BadInput, match="0 folds"):
            interpolated.corrugated(0)
