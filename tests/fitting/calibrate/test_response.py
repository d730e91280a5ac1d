"""The camera's gamma, brackets and lens: against encodings and distortions made in NumPy."""

import builtins
import sys
from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np
import pytest
from shared import shared_data

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.io.circle import Circle, ball_gbuffer
from diffshade.io.read_capture import read_capture
from fitting.calibrate import fit_gamma, merge_brackets, response, undistort
from fitting.calibrate.decoded_capture import gamma_to_json
from fitting.calibrate.jackknife import covariance

DIRECTIONS = ((0.4, 0.5, 1), (-0.6, 0.1, 1), (0.1, -0.7, 1), (0, 0.1, 1.0), (0.5, -0.4, 1))
EPS = float(np.finfo(float).eps)
BALL = ball_gbuffer(Circle(20, 20, 18), (40, 40))


@pytest.mark.slow
@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_a_gamma_comes_back_within_its_interval(gamma: float, rng: np.random.Generator) -> None:
    scenes = [ds.Scene(ambient=1.0, lights=ds.ParallelLight(d)) for d in DIRECTIONS]
    truth = ds.Material(ka=0.05, kd=0.6)
    encoded = []
    for scene in scenes:
        image = np.asarray(ds.render(BALL, scene, truth))
        noisy = image ** (1 / gamma) + rng.normal(0, 0.003, image.shape)
        encoded.append(noisy.clip(0, 1).astype(image.dtype))
    found = fit_gamma(encoded, BALL, scenes, material=ds.Material(ka=0.1, kd=0.5), start=1.5)
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
    found = covariance((np.ones((50, 1, 1)), -left[:, None]), noise=1e-9, eps=EPS)
    np.testing.assert_allclose(found[0, 0], left.var(ddof=1) / 50, rtol=1e-9)


def test_what_images_agree_on_is_no_surer_than_noise_allows() -> None:
    """Where they disagree about one number, another keeps the error that noise gives it."""
    hessians = np.stack([10 * np.eye(2)] * 4)
    gradients = np.array([[0.0, 300.0], [0.0, -300.0], [0.0, 200.0], [0.0, -200.0]])
    found = np.diagonal(covariance((hessians, gradients), noise=1.0, eps=EPS))
    assert abs(found[0] - 1 / 40) < 1e-12
    assert found[1] > 100


@pytest.mark.parametrize("images", [1, 3, 6])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_what_no_image_tells_has_no_error_bar(
    images: int, dtype: type[np.floating], rng: np.random.Generator
) -> None:
    """Two numbers in one sum, one that nothing depends on, and one more: as if that were alone."""
    jacobian = rng.normal(size=(images, 30, 4))
    jacobian[:, :, 1], jacobian[:, :, 2] = 0.3 * jacobian[:, :, 0], 0
    left = rng.normal(size=(images, 30))
    jacobian[:, :, 3] += 5 * left
    told = jacobian[..., [0, 3]]
    left -= (told @ np.linalg.lstsq(told.reshape(-1, 2), left.ravel())[0][..., None])[..., 0]

    def of(j: np.ndarray) -> np.ndarray:
        j = j.astype(dtype)
        groups = (j.mT @ j).astype(float), np.einsum("kpm,kp->km", j, left)
        return np.diagonal(covariance(groups, noise=0.1, eps=float(np.finfo(dtype).eps)))

    assert np.isinf(of(jacobian)[:3]).all()
    np.testing.assert_allclose(of(jacobian)[3], of(told)[1], rtol=1e3 * np.finfo(dtype).eps)


def test_groupings_add_and_the_noise_is_counted_once(rng: np.random.Generator) -> None:
    """Of a mean of numbers by row and by column: the variances of both means."""
    x = rng.normal(size=(6, 1)) + rng.normal(size=8)
    left = x - x.mean()
    rows, columns = (
        (np.full((len(sums), 1, 1), x.size / len(sums)), -sums[:, None])
        for sums in (left.sum(axis=1), left.sum(axis=0))
    )
    of_means = x.mean(axis=1).var(ddof=1) / 6 + x.mean(axis=0).var(ddof=1) / 8
    for noise, expected in ((1e-9, of_means), (9.0, 81 / x.size)):
        found = covariance(rows, columns, noise=noise, eps=EPS)
        np.testing.assert_allclose(found, [[expected]], rtol=1e-9)


def lit(
    surface: GBuffer, directions: Sequence[tuple[float, ...]], noise: float = 0.0
) -> tuple[list[np.ndarray], list[ds.Scene]]:
    """Linear photographs of a matte surface, and what lit them."""
    rng = np.random.default_rng(3)
    scenes = [ds.Scene(ambient=1.0, lights=ds.ParallelLight(l)) for l in directions]
    images = [np.asarray(ds.render(surface, s, ds.Material(0.05, 0.5))) for s in scenes]
    return [i + rng.normal(0, noise, i.shape).astype(i.dtype) for i in images], scenes


FLAT = eqx.tree_at(lambda g: g.normal, BALL, jax.tree.map(lambda x: 0 * x, BALL.normal))
FLAT = eqx.tree_at(lambda g: g.normal.z, FLAT, 1 + FLAT.normal.z)
BEHIND = (0, 0, -1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("surface", "directions", "noise"),
    [
        (BALL, [BEHIND], 0.0),
        (BALL, [BEHIND] * 2, 0.0),
        (BALL, [BEHIND] * 5, 0.0),
        (FLAT, [(0, 0, 1.0)] * 5, 0.0),
        (FLAT, [(0, 0, 1.0)] * 5, 0.01),
    ],
    ids=["behind-1", "behind-2", "behind-5", "flat", "flat-noisy"],
)
def test_a_gamma_that_the_images_do_not_tell_is_not_found(
    surface: GBuffer, directions: Sequence[tuple[float, ...]], noise: float
) -> None:
    """One brightness in each image, the same in all: any gamma, and a k_a of its own."""
    images, scenes = lit(surface, directions, noise)
    found = fit_gamma(images, surface, scenes, material=ds.Material(ka=0.1, kd=0.5))
    assert found.standard_error == np.inf
    assert found.interval == (0.3, 4.0)
    document = gamma_to_json(found)
    assert document["standard_error"] is None
    assert document["interval"] == [0.3, 4.0]


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
