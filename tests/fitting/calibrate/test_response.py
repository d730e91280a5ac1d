"""The camera's gamma, brackets and lens: against encodings and distortions made in NumPy."""

import builtins
import sys

import numpy as np
import pytest
from shared import shared_data

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.io.circle import Circle, ball_gbuffer
from diffshade.io.read_capture import read_capture
from fitting.calibrate import fit_gamma, merge_brackets, response, undistort
from fitting.calibrate.jackknife import covariance

DIRECTIONS = ((0.4, 0.5, 1), (-0.6, 0.1, 1), (0.1, -0.7, 1), (0, 0.1, 1.0), (0.5, -0.4, 1))


@pytest.mark.slow
@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_a_gamma_comes_back_within_its_interval(gamma: float, rng: np.random.Generator) -> None:
    gbuffer = ball_gbuffer(Circle(20, 20, 18), (40, 40))
    scenes = [ds.Scene(ambient=1.0, lights=ds.ParallelLight(d)) for d in DIRECTIONS]
    truth = ds.Material(ka=0.05, kd=0.6)
    encoded = []
    for scene in scenes:
        image = np.asarray(ds.render(gbuffer, scene, truth))
        noisy = image ** (1 / gamma) + rng.normal(0, 0.003, image.shape)
        encoded.append(noisy.clip(0, 1).astype(image.dtype))
    found = fit_gamma(encoded, gbuffer, scenes, material=ds.Material(ka=0.1, kd=0.5), start=1.5)
    assert found.converged
    assert not found.at_limit
    assert found.gamma == pytest.approx(gamma, rel=0.01)
    low, high = found.interval
    assert low < gamma < high
    assert high - low < 0.1 * gamma


@pytest.mark.slow
def test_the_gamma_of_a_real_ball_is_what_it_was_encoded_by(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Linear by certificate, encoded in NumPy in 8 bits. Phong's lobe leaves 4 to 8 % of it, which pulls
    the gamma by 1 to 5 %: farther than by how the images disagree, and not out of the interval. Green
    alone, and few pixels, as all tell the same.
    """
    monkeypatch.setattr(response, "MOST", 2**13)
    capture = read_capture(shared_data("diligent_ball"))
    powers = [source.exposure[1] for source in capture.sources]
    scenes = [
        ds.Scene(ambient=e, lights=ds.ParallelLight(scene.lights[0].direction, e))
        for scene, e in zip(capture.scenes, powers, strict=True)
    ]
    for gamma in (1.0, 2.2):
        encoded = [
            (255 * (image[..., 1:2] * e).clip(0, 1) ** (1 / gamma)).round() / 255
            for image, e in zip(capture.images, powers, strict=True)
        ]
        found = fit_gamma(encoded, capture.gbuffer, scenes, valid=capture.valid)
        assert found.converged
        low, high = found.interval
        assert low < gamma < high, found
        assert high - low < 0.25 * gamma
        assert found.gamma == pytest.approx(gamma, rel=0.06)


def test_the_jackknife_of_a_mean_is_the_variance_of_the_mean(rng: np.random.Generator) -> None:
    """Of numbers, y their mean: J = -1, r = x - y."""
    x = rng.normal(0, 2.0, 50)
    left = x - x.mean()
    found = covariance(np.ones((50, 1, 1)), -left[:, None], 1e-9)
    np.testing.assert_allclose(found[0, 0], left.var(ddof=1) / 50, rtol=1e-9)


def test_what_images_agree_on_is_no_surer_than_noise_allows() -> None:
    """Where they disagree about one number, another keeps the error that noise gives it."""
    hessians = np.stack([10 * np.eye(2)] * 4)
    gradients = np.array([[0.0, 300.0], [0.0, -300.0], [0.0, 200.0], [0.0, -200.0]])
    found = np.diagonal(covariance(hessians, gradients, 1.0))
    assert abs(found[0] - 1 / 40) < 1e-12
    assert found[1] > 100


def test_brackets_give_radiance_in_proportion(rng: np.random.Generator) -> None:
    pytest.importorskip("cv2")
    radiance = np.geomspace(0.02, 2.0, 64 * 64).reshape(64, 64, 1)
    radiance = rng.permutation(radiance.ravel()).reshape(64, 64, 1)
    radiance[3, 4] = 40.0
    seconds = (0.1, 0.5, 2.0)
    codes = [
        np.round(255 * (radiance * t).clip(0, 1) ** (1 / 2.2)).astype(np.uint8) for t in seconds
    ]
    merged = merge_brackets(codes, seconds)
    assert merged.radiance.shape == radiance.shape
    assert not merged.valid[3, 4]  # clipped in all
    assert merged.valid.mean() > 0.99
    assert np.log(merged.radiance / radiance)[merged.valid].std() < 0.01
    for wrong, told in ((codes[0][:8], "16 a side"), (codes[0][..., [0, 0]], "2 channels")):
        with pytest.raises(BadInput, match=told):
            merge_brackets([wrong] * 3, seconds)


def test_a_distorted_grid_is_straight_again() -> None:
    pytest.importorskip("cv2")
    focal, k1, shape = 80.0, -0.15, (100, 120)

    def pattern(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 0.5 + 0.25 * np.cos(x / 6) + 0.2 * np.sin(y / 7)

    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    # Of a distorted pixel the straight one, by Newton's fixed point
    px, py = (x - 60) / focal, (y - 50) / focal
    ux, uy = px.copy(), py.copy()
    for _ in range(60):
        factor = 1 + k1 * (ux**2 + uy**2)
        ux, uy = px / factor, py / factor
    distorted = pattern(60 + focal * ux, 50 + focal * uy)[..., None]
    straight = undistort(distorted, focal=focal, coefficients=(k1, 0, 0, 0))
    error = np.abs(straight[..., 0] - pattern(x, y))[10:-10, 10:-10]
    assert error.max() < 0.01
    with pytest.raises(BadInput, match="coefficients"):
        undistort(distorted, focal=focal, coefficients=(k1,))


def test_without_opencv_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def refusing(name: str, *rest: object) -> object:
        if name == "cv2":
            raise ImportError(name)
        return real(name, *rest)  # type: ignore[arg-type]

    monkeypatch.delitem(sys.modules, "cv2", raising=False)
    monkeypatch.setattr(builtins, "__import__", refusing)
    with pytest.raises(BadInput, match=r"pip install 'diffshade\[calibrate\]'"):
        undistort(np.ones((4, 4, 1)), focal=4.0, coefficients=(0, 0, 0, 0))


@pytest.mark.parametrize(
    ("count", "seconds"), [(2, (1, 2)), (3, (1, 1, 1)), (3, (1, 2)), (3, (1, -1, 2))]
)
def test_exposures_that_tell_nothing_are_refused(count: int, seconds: tuple[float, ...]) -> None:
    with pytest.raises(BadInput, match="give"):
        merge_brackets([np.zeros((4, 4, 3), np.uint8)] * count, seconds)
