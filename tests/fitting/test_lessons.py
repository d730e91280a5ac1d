"""What the notebooks on fitting drag: photographs that are what they say, and the truth found in them."""

from pathlib import Path

import jax
import numpy as np
import pytest

import diffshade as ds
import fitting
from diffshade.io.encoding import decode
from diffshade.io.read_capture import read_capture
from fitting import lessons

BALL = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(32, 32, 2.2))
FRONT = ds.Scene(lights=ds.ParallelLight((0, 0, 1)))
CHALK = ds.Material(kd=0.8)
SLIDERS = {"ka": 0.4, "kd": 0.6, "ks": 0.4, "shininess": 20, "azimuth": -0.5, "elevation": 0.5}


class TestPhotograph:
    def test_without_anything_it_is_the_render(self) -> None:
        expected = np.asarray(ds.render(BALL, FRONT, CHALK), np.float32)
        np.testing.assert_array_equal(lessons.photograph(BALL, FRONT, CHALK), expected)

    def test_the_noise_is_normal_and_one_a_seed(self) -> None:
        plain = lessons.photograph(BALL, FRONT, CHALK)
        one, again, other = (
            lessons.photograph(BALL, FRONT, CHALK, noise=0.05, seed=seed) for seed in (1, 1, 2)
        )
        np.testing.assert_array_equal(one, again)
        assert np.std(one - plain) == pytest.approx(0.05, rel=0.1)
        assert abs(np.corrcoef((one - plain).ravel(), (other - plain).ravel())[0, 1]) < 0.1

    def test_clipped_then_encoded(self) -> None:
        plain = lessons.photograph(BALL, FRONT, CHALK)
        encoded = lessons.photograph(BALL, FRONT, CHALK, white=0.5, gamma=2.2)
        np.testing.assert_allclose(decode(encoded, 2.2), np.minimum(plain, 0.5), atol=1e-6)
        assert np.mean(plain > 0.5) > 0.1  # or nothing was clipped

    def test_the_dark_is_not_below_nothing(self) -> None:
        noisy = lessons.photograph(BALL, FRONT, CHALK, noise=0.1, gamma=2.2)
        assert np.isfinite(noisy).all()
        assert noisy.min() == 0

    @pytest.mark.parametrize("wrong", [{"noise": -0.1}, {"white": 0.0}, {"gamma": -1.0}])
    def test_what_no_camera_does(self, wrong: dict[str, float]) -> None:
        with pytest.raises(ds.BadInput, match="give noise >= 0"):
            lessons.photograph(BALL, FRONT, CHALK, **wrong)


def test_lights_in_a_ring(tolerance: float) -> None:
    ring = np.array(lessons.around(5, 0.4))
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), 1, rtol=tolerance)
    np.testing.assert_allclose(ring[:, 2], np.cos(0.4), rtol=tolerance)
    np.testing.assert_allclose(ring.sum(axis=0)[:2], 0, atol=tolerance)


class TestSpoilt:
    CAMERA = ds.OrthographicCamera(32, 32, 2.2)
    GLOSSY = ds.Material(kd=0.6, specular=ds.Phong(0.35, 60))

    def test_the_capture_is_the_photographs(self, tmp_path: Path) -> None:
        capture = read_capture(lessons.spoilt(tmp_path, self.CAMERA, self.GLOSSY, noise=0.0))
        assert len(capture.images) == lessons.LIGHTS
        for k, (scene, image) in enumerate(zip(capture.scenes, capture.images, strict=True)):
            (light,) = scene.lights
            expected = lessons.around(lessons.LIGHTS, lessons.TILT)[k]
            np.testing.assert_allclose(light.direction, expected, rtol=1e-6)
            rendered = np.asarray(ds.render(capture.gbuffer, scene, self.GLOSSY))
            np.testing.assert_allclose(image, np.minimum(rendered, 1), atol=1e-5)
        assert capture.notes == ("images read as linear",)

    def test_what_is_wrong_is_not_said(self, tmp_path: Path) -> None:
        plain, other = tmp_path / "plain", tmp_path / "other"
        for folder in (plain, other):
            folder.mkdir()
        spoil = {"white": 0.7, "gamma": 2.2, "turned": 0.2}
        right = lessons.spoilt(plain, self.CAMERA, self.GLOSSY, noise=0.0)
        wrong = lessons.spoilt(other, self.CAMERA, self.GLOSSY, noise=0.0, **spoil)
        assert right.read_text() == wrong.read_text()
        before, after = (read_capture(path).images for path in (right, wrong))
        for k, (a, b) in enumerate(zip(before, after, strict=True)):
            far = np.abs(np.minimum(a, 0.7) - decode(b, 2.2)).max()
            assert (far > 0.01) == (k == 2)

    def test_a_plateau_is_noted(self, tmp_path: Path) -> None:
        capture = read_capture(lessons.spoilt(tmp_path, self.CAMERA, self.GLOSSY, white=0.5))
        assert any("plateau below full scale" in note for note in capture.notes)


@pytest.mark.slow
class TestHideAndRecover:
    def test_what_was_hidden_is_found_within_its_errors(self) -> None:
        hidden = lessons.hide_and_recover(BALL, **SLIDERS, noise=0.005)
        assert list(hidden.true) == ["ka", "kd", "specular.0.ks", "specular.0.shininess"]
        for name, true in hidden.true.items():
            low, high = hidden.intervals[name]
            assert low < hidden.found[name] < high
            assert abs(hidden.found[name] - true) < 4 * hidden.errors[name] < 0.3 * true
        assert hidden.fit.noise == pytest.approx(0.005, rel=0.1)

    def test_it_is_the_fit_of_the_image_alone(self) -> None:
        """Nothing of the truth goes into it but by the image and the light."""
        hidden = lessons.hide_and_recover(BALL, **SLIDERS, noise=0.02, seed=5)
        again = fitting.fit(hidden.images[0], BALL, hidden.scenes[0])
        for name, value in again.coefficients.items():
            np.testing.assert_array_equal(value.squeeze(), hidden.found[name])

    def test_without_a_highlight_its_width_is_not_told(self) -> None:
        hidden = lessons.hide_and_recover(BALL, **{**SLIDERS, "ks": 0.0}, noise=0.005)
        assert hidden.errors["specular.0.shininess"] > 0.1 * hidden.found["specular.0.shininess"]
        unsaid = {name for item in hidden.fit.unidentified for name in item.coefficients}
        assert "specular.0.shininess" in unsaid

    def test_dragging_never_compiles_again(self, caplog: pytest.LogCaptureFixture) -> None:
        def drag(**moved: float) -> list[str]:
            caplog.clear()
            with jax.log_compiles():
                hidden = lessons.hide_and_recover(BALL, **{"noise": 0.01, **SLIDERS, **moved})
                assert hidden.errors
                assert hidden.fit.correlations
            return [r.getMessage() for r in caplog.records if "Compiling" in r.getMessage()]

        jax.clear_caches()
        assert drag()
        for moved in ({"ka": 0, "shininess": 300.0}, {"azimuth": 1, "seed": 9}, {"noise": 0.1}):
            assert drag(**moved) == []


@pytest.mark.slow
class TestAmbientOrDiffuse:
    SHEET = lessons.sheet(16)
    PAPER = {"ka": 0.3, "kd": 0.6, "noise": 0.01}  # noqa: RUF012

    def test_a_photograph_is_one_brightness(self, tolerance: float) -> None:
        hidden = lessons.ambient_or_diffuse(self.SHEET, [0.0, 1.0], **{**self.PAPER, "noise": 0.0})
        for angle, image in zip((0.0, 1.0), hidden.images, strict=True):
            expected = 0.5 * 0.3 + 0.8 * 0.6 * np.cos(angle)
            np.testing.assert_allclose(image, np.full((16, 16, 1), expected), rtol=1e-6)

    def test_two_lights_tell_as_much_as_two_lines_do(self) -> None:
        """sigma^2 (A^T A)^-1 with a row (I_a, I_p cos(angle)) for every pixel."""
        for angle in (0.3, 1.2):
            hidden = lessons.ambient_or_diffuse(self.SHEET, [0.0, angle], **self.PAPER)
            rows = np.array([(0.5, 0.8), (0.5, 0.8 * np.cos(angle))])
            covariance = hidden.fit.noise**2 * np.linalg.inv(256 * rows.T @ rows)
            errors = np.sqrt(np.diag(covariance))
            np.testing.assert_allclose(list(hidden.errors.values()), errors, rtol=1e-4)
            np.testing.assert_allclose(
                hidden.fit.correlations.matrix[0, 1], covariance[0, 1] / np.prod(errors), rtol=1e-4
            )
            for name, true in hidden.true.items():
                assert abs(hidden.found[name] - true) < 4 * hidden.errors[name]

    def test_one_light_tells_neither(self) -> None:
        hidden = lessons.ambient_or_diffuse(self.SHEET, [0.0], **self.PAPER)
        assert set(hidden.errors.values()) == {np.inf}
        (unsaid,) = hidden.fit.unidentified
        assert unsaid.coefficients == ("ka", "kd")
        assert "looks like the ambient light" in unsaid.reason
