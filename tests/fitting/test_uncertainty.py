"""Errors, intervals and correlations against the dense Jacobian, quadrature, and many draws of noise."""

from dataclasses import replace

import numpy as np
import pytest
from dense import Minimum, Plain
from scipy.integrate import quad
from scipy.optimize import lsq_linear
from scipy.stats import norm, t

import diffshade as ds
import fitting
from fitting.intervals import bounded_interval, quantile
from fitting.null_space import sparse_basis
from fitting.uncertainty import Uncertainty, _mean_square, propagate

LIGHTS = ((0.8, 0.5, 2.5), (-1.0, 0.8, 2.0))
RGB = Plain(
    LIGHTS, ka=(0.1, 0.2, 0.05), kd=(0.5, 0.4, 0.2), ks=((0.3, 0.2, 0.1),), n=(20.0,), noise=0.01
)
TWO_LOBES = Plain(LIGHTS, ks=((0.3,), (0.1,)), n=(100.0, 5.0), noise=0.02)
ATTENUATED = Plain(LIGHTS, c=(1.0, 0.2, 0.1), noise=0.01)  # one direction is lost


@pytest.mark.float64
@pytest.mark.parametrize("case", [RGB, TWO_LOBES, ATTENUATED, replace(ATTENUATED, hold=("c0",))])
def test_the_covariance_is_that_of_the_dense_jacobian(case: Plain) -> None:
    found = case.uncertainty()
    jacobian = case.dense()[:, ~case.known]
    norms = np.linalg.norm(jacobian, axis=0)
    _, sizes, axes = np.linalg.svd(jacobian / norms, full_matrices=False)
    told = sizes > 1e-6 * sizes[0]
    root = axes[told].T / sizes[told] / norms[:, None]
    expected = found.noise**2 * np.sum(root**2, axis=1)
    expected[(np.abs(axes[~told]) > 1e-4).any(axis=0)] = np.inf
    observations = len(jacobian)
    residual = float(case.minimum().cost)
    assert found.noise == pytest.approx((residual / (observations - told.sum())) ** 0.5, rel=1e-12)
    # Reported numbers are the unknowns themselves, but for exp(log n).
    k = dict(
        zip(("ka", "kd", *(f"specular.{j}.ks" for j in range(len(case.ks)))), case.k.T, strict=True)
    )
    errors = found.standard_errors
    of_k = np.stack([errors[name] for name in k], axis=1).ravel()
    shininess = [errors[f"specular.{j}.shininess"] / n for j, n in enumerate(case.n)]
    of_c = [errors[f"attenuation.c{j}"] for j in range(len(case.c or ()))]
    variance = np.square(np.array([*of_k, *shininess, *of_c])[~case.known])
    np.testing.assert_allclose(variance, expected, rtol=1e-5)


@pytest.mark.float64
def test_correlations() -> None:
    found = TWO_LOBES.uncertainty()
    inverse = np.linalg.inv(TWO_LOBES.dense().T @ TWO_LOBES.dense())
    names = ("ka[0]", "kd[0]", "specular.0.ks[0]", "specular.1.ks[0]")
    names += ("specular.0.shininess", "specular.1.shininess")
    at = [found.numbers.index(name) for name in names]
    error = np.sqrt(np.diagonal(inverse))
    expected = inverse / np.outer(error, error)
    np.testing.assert_allclose(found.correlations[np.ix_(at, at)], expected, atol=1e-8)
    lost = ATTENUATED.uncertainty()
    kd, ka = lost.numbers.index("kd[0]"), lost.numbers.index("ka[0]")
    assert np.isnan(lost.correlations[kd, ka])
    assert lost.correlations[ka, ka] == 1


@pytest.mark.float64
def test_noise_can_be_given() -> None:
    found, given = RGB.uncertainty(), RGB.uncertainty(noise=0.02)
    assert given.noise == 0.02
    for name, error in given.standard_errors.items():
        np.testing.assert_allclose(error, found.standard_errors[name] * 0.02 / found.noise)
        np.testing.assert_allclose(given.unit_errors[name], found.unit_errors[name])


@pytest.mark.float64
def test_the_interval_of_the_shininess_is_on_its_logarithm() -> None:
    case = replace(RGB, noise=0.3)
    found = case.uncertainty(noise=0.3)
    low, high = found.intervals["specular.0.shininess"]
    assert low * high == pytest.approx(400.0)
    relative = found.standard_errors["specular.0.shininess"] / 20.0
    assert np.log(high / 20.0) == pytest.approx(norm.ppf(0.975) * relative)
    low, high = found.intervals["kd"]
    np.testing.assert_allclose((low + high) / 2, case.kd)


@pytest.mark.float64
def test_of_what_is_not_told_the_interval_is_what_the_bounds_leave() -> None:
    size = len(ATTENUATED.known)
    bounds = (np.zeros(size), np.full(size, 7.0))
    found = ATTENUATED.uncertainty(bounds=bounds)
    assert np.isinf(found.standard_errors["kd"]).all()
    np.testing.assert_allclose(found.intervals["kd"], [[0.0], [7.0]])
    np.testing.assert_allclose(found.intervals["attenuation.c1"], [0.0, 7.0])
    # A highlight that is not there: no pixel depends on its width at all.
    matte = Plain(LIGHTS, ks=((0.0,),), noise=0.01)
    found = matte.uncertainty(bounds=(np.full(4, np.log(0.1)), np.full(4, np.log(1e5))))
    np.testing.assert_allclose(found.intervals["specular.0.shininess"], [0.1, 1e5])
    unbounded = ATTENUATED.uncertainty().intervals["kd"]
    np.testing.assert_array_equal(unbounded, [[-np.inf], [np.inf]])


@pytest.mark.float64
@pytest.mark.parametrize(("share", "noise"), [(0.02, 0.2), (0.5, 0.02)])
def test_what_is_made_of_several_unknowns_stays_in_its_own_range(
    share: float, noise: float
) -> None:
    """l = c1 / (c0 + c1), of which each has half of the error: no unknown's bounds are its own."""
    case = replace(ATTENUATED, c=(1 - share, share, 0.1), noise=0.1, hold=("kd", "c2"))

    def report(k: np.ndarray, u: np.ndarray) -> dict[str, np.ndarray]:
        c0, c1 = u[..., 1], u[..., 2]
        return {"k": k[..., 0], "l": c1 / (c0 + c1)}

    minimum = case.minimum()
    observed = minimum, case.u, case.known, 10**6, report
    free = propagate(*observed, noise=noise)
    bound = propagate(*observed, noise=noise, ranges={"l": (np.zeros(1), np.ones(1))})
    error = free.standard_errors["l"]
    assert bound.standard_errors["l"] == error
    np.testing.assert_array_equal(bound.intervals["k"], free.intervals["k"])
    low, high = bound.intervals["l"]
    if share == 0.5:
        assert 4 * error < 0.5  # far from both
        np.testing.assert_array_equal(bound.intervals["l"], free.intervals["l"])
    else:
        assert free.intervals["l"][0] < 0 == low
        expected = bounded_interval(np.array([share / error]))[1][0] * error
        assert high == pytest.approx(expected, rel=1e-9)


def linear_minimum(
    case: Plain, a: np.ndarray, noise: np.ndarray, lower: np.ndarray
) -> tuple[Minimum, np.ndarray]:
    """A fit of k alone, one channel, under bounds."""
    truth = case.k[0]
    k = lsq_linear(a, a @ truth + noise, (lower, np.inf), method="bvls", tol=1e-14).x
    residual = a @ (truth - k) + noise
    columns = np.concatenate([a, np.zeros((len(a), case.u.size)), residual[:, None]], axis=1)
    return Minimum(k[None], np.sum(residual**2), (columns.T @ columns)[None]), k


@pytest.mark.float64
def test_between_free_and_held_by_how_hard_a_bound_is_pressed() -> None:
    case = Plain(LIGHTS, ka=(0.0,), hold=("n0",))
    a = case.jacobians()[0][0].T
    lower = np.array([0.0, -np.inf, -np.inf])
    bounds = (np.append(lower, -np.inf), np.full(4, np.inf))

    def errors(pressed: float, hold: tuple[str, ...] = ("n0",)) -> Uncertainty:
        # Noise that asks for a k_a below 0 by so much, and none besides.
        minimum, _ = linear_minimum(case, a, -pressed * a[:, 0], lower)
        known = replace(case, hold=hold).known
        observed = (minimum, case.u, known, len(a), case.report())
        return propagate(*observed, bounds=bounds, noise=1e-3)

    held = errors(0.0, ("n0", "ka")).standard_errors
    free = propagate(
        linear_minimum(case, a, 0 * a[:, 0], lower)[0],
        case.u,
        case.known,
        len(a),
        case.report(),
        noise=1e-3,
    ).standard_errors
    assert free["kd"] > 1.3 * held["kd"]
    resting, pressed = errors(0.0), errors(1.0)
    np.testing.assert_allclose(resting.standard_errors["kd"], free["kd"], rtol=1e-9)
    np.testing.assert_allclose(resting.standard_errors["ka"], free["ka"], rtol=1e-9)
    np.testing.assert_allclose(pressed.standard_errors["kd"], held["kd"], rtol=1e-3)
    assert pressed.standard_errors["ka"] < 0.05 * free["ka"]
    for found in (resting, pressed):
        low, high = found.intervals["ka"]
        assert low == 0 < high < 2 * free["ka"]
    assert resting.intervals["ka"][1] == pytest.approx(1.96 * float(free["ka"][0]), rel=1e-3)


@pytest.mark.float64
def test_the_mean_square_beyond_a_bound() -> None:
    for push in (0.0, 0.3, 1.0, 4.0, 12.0, 19.9, 20.1, 40.0):
        weight = quad(lambda a: np.exp(-a * a / 2 - push * a), 0, 30 / (1 + push))[0]  # noqa: B023
        square = quad(lambda a: a * a * np.exp(-a * a / 2 - push * a), 0, 30 / (1 + push))[0]  # noqa: B023
        assert _mean_square(push) == pytest.approx(square / weight, rel=1e-3)


def test_quantiles_of_student() -> None:
    for degrees in (7.0, 20.0, 100.0, 1e6):
        assert quantile(degrees) == pytest.approx(t.ppf(0.975, degrees), rel=1e-3)


@pytest.mark.parametrize("truth", [0.0, 0.2, 0.7, 1.5, 3.0, 8.0])
def test_intervals_next_to_a_bound_cover(truth: float) -> None:
    """Exactly 95 %: what of the normal density lies where the interval holds the truth."""
    x = np.linspace(truth - 7, truth + 7, 20001)
    low, high = bounded_interval(x)
    assert np.all((low >= 0) & (high > low))
    assert np.all(np.diff(high) > -1e-9)
    weight = norm.pdf(x - truth)
    inside = (low <= truth) & (truth <= high)
    assert weight[inside].sum() / weight.sum() == pytest.approx(0.95, abs=2e-3)


@pytest.mark.float64
@pytest.mark.parametrize("inside", [0.0, 1.0, 2.0, 20.0])
def test_coverage_with_a_coefficient_on_its_bound_or_near(inside: float) -> None:
    """k_a so many of its errors above 0; 1,000 draws: 95 % +- 2 % of the intervals hold the truth."""
    sigma = 0.02
    case = Plain(LIGHTS, hold=("n0",))
    a = case.jacobians()[0][0].T
    error = sigma * np.sqrt(np.linalg.inv(a.T @ a)[0, 0])
    case = replace(case, ka=(inside * error,))
    lower = np.zeros(3)
    bounds = (np.append(lower, -np.inf), np.full(4, np.inf))
    rng = np.random.default_rng(11)
    report, hits = case.report(), []
    for _ in range(1000):
        minimum, _ = linear_minimum(case, a, rng.normal(0, sigma, len(a)), lower)
        found = propagate(minimum, case.u, case.known, len(a), report, bounds=bounds)
        ends = [found.intervals[name] for name in ("ka", "kd", "specular.0.ks")]
        hits.append(
            [low[0] <= k <= high[0] for (low, high), k in zip(ends, case.k[0], strict=True)]
        )
    coverage = np.mean(hits, axis=0)
    assert np.all((coverage > 0.93) & (coverage < 0.975)), coverage


@pytest.mark.slow
def test_coverage_of_whole_fits() -> None:
    """300 noisy captures: every interval holds the truth in 95 % of them, give or take 3 errors."""
    g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(32, 32, 2.2))
    scene = ds.Scene(ambient=0.5, lights=tuple(ds.PointLight(p) for p in LIGHTS))
    truth = {"ka": 0.1, "kd": 0.5, "specular.0.ks": 0.3, "specular.0.shininess": 25.0}
    material = ds.Material(ka=0.1, kd=0.5, specular=ds.Phong(0.3, 25.0))
    image = np.asarray(ds.render(g, scene, material))
    rng = np.random.default_rng(5)
    hits = []
    for _ in range(300):
        noise = rng.normal(0, 0.05, image.shape).astype(image.dtype)
        fit = fitting.fit(image + noise, g, scene)
        ends = [fit.intervals[name] for name in truth]
        hits.append(
            [
                float(low.max()) <= v <= float(high.min())
                for (low, high), v in zip(ends, truth.values(), strict=True)
            ]
        )
    coverage = np.mean(hits, axis=0)
    assert np.all((coverage > 0.95 - 0.038) & (coverage < 0.95 + 0.038)), coverage


def test_a_sparse_basis_spans_what_it_was_given(rng: np.random.Generator) -> None:
    """Two blocks that share no coordinate, mixed by a rotation, come apart."""
    blocks = np.zeros((7, 3))
    blocks[:3, :1], blocks[3:6, 1:] = rng.normal(size=(3, 1)), rng.normal(size=(3, 2))
    mixed = blocks @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    found = sparse_basis(mixed, np.arange(7.0))
    assert np.linalg.matrix_rank(np.concatenate([found, blocks], axis=1), tol=0.05) == 3
    of_first = np.any(found[:3] != 0, axis=0)
    assert not np.any(of_first & np.any(found[3:] != 0, axis=0))
    assert np.all(found[6] == 0)
