"""Laws of attenuation: each is recovered, the wrong one is told apart, LIGHT-12's clamp sets a scale."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from truths import draw

import diffshade as ds
import fitting
from diffshade.light.attenuation import AbstractAttenuation
from fitting.gauge import PolynomialGauge

GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(64, 64, 2.2))
LIGHTS = (((1, 1, 1.5), 1.0), ((-2, 1, 3.5), 1.2), ((0, -2.5, 2), 0.8))
MATERIAL = ds.Material(ka=0.1, kd=0.6, specular=ds.Phong(ks=0.4, shininess=30.0))
CONSTANTS = ("attenuation.c0", "attenuation.c1", "attenuation.c2")
SCALED = {"kd", "specular.0.ks", *CONSTANTS}

# k_a, k_d, k_s, n, c0, c1, c2: clamped at 84, 67, 55 and 0 % of the lit points.
CLAMPED = {
    "far clamped": (0.1, 0.6, 0.4, 30.0, 0.3, 0.15, 0.05),
    "steep": (0.1, 0.6, 0.4, 30.0, 0.1, 0.1, 0.1),
    "sharp": (0.1, 0.5, 0.3, 100.0, 0.02, 0.2, 0.05),
}
NOT_CLAMPED = (0.1, 0.6, 0.4, 30.0, 1.0, 0.2, 0.05)
ALL_CLAMPED = (0.1, 0.6, 0.4, 30.0, 0.05, 0.01, 0.01)


def scene(law: AbstractAttenuation | None) -> ds.Scene:
    return ds.Scene(1.0, tuple(ds.PointLight(at, power, law) for at, power in LIGHTS))


def photograph(
    law: AbstractAttenuation | None,
    *,
    noise: float = 0.0,
    seed: int = 0,
    material: ds.Material = MATERIAL,
) -> np.ndarray:
    image = np.asarray(ds.render(GBUFFER, scene(law), material))
    return image + np.random.default_rng(seed).normal(0, noise, image.shape).astype(image.dtype)


def of_truth(truth: tuple[float, ...], *, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    ka, kd, ks, n, *c = truth
    material = ds.Material(ka=ka, kd=kd, specular=ds.Phong(ks, n))
    return photograph(ds.QuadraticAttenuation(*c), noise=noise, seed=seed, material=material)


def numbers(fit: fitting.Fit, names: tuple[str, ...]) -> list[float]:
    return [float(np.ravel(fit.coefficients[name])[0]) for name in names]


def named(fit: fitting.Fit) -> set[str]:
    return {name for item in fit.unidentified for name in item.coefficients}


ALL = ("ka", "kd", "specular.0.ks", "specular.0.shininess", *CONSTANTS)


@pytest.fixture
def allowed() -> float:
    return 1e-6 if jax.config.jax_enable_x64 else 2e-3


def test_a_linear_law_is_recovered(allowed: float) -> None:
    """With c0 = 1 in the truth all are themselves; c0, c1, k_d and k_s share one scale."""
    law = ds.LinearAttenuation(1.0, 0.3)
    image = photograph(law)
    fit = fitting.fit(image, GBUFFER, scene(None), attenuation=ds.LinearAttenuation)
    found = fit.scene.lights[0].attenuation
    assert isinstance(found, ds.LinearAttenuation)
    np.testing.assert_allclose((found.c0, found.c1), (1.0, 0.3), rtol=allowed)
    np.testing.assert_allclose(fit.material.kd, 0.6, rtol=allowed)
    assert "attenuation.c2" not in fit.coefficients
    assert fit.reference_distance is not None
    shares = np.array([1.0, 0.3 * fit.reference_distance])
    shares = shares / shares.sum()
    np.testing.assert_allclose(numbers(fit, ("reference.l0", "reference.l1")), shares, rtol=allowed)
    assert named(fit) == SCALED - {"attenuation.c2"}
    np.testing.assert_allclose(
        ds.render(GBUFFER, fit.scene, fit.material), image, atol=allowed, rtol=0
    )


def test_a_linear_law_without_c0_grows_to_the_bounds_of_k() -> None:
    """No clamp limits it: k_d is 1 at the most, k_s in proportion."""
    image = photograph(ds.LinearAttenuation(0.0, 0.5))
    fit = fitting.fit(image, GBUFFER, scene(None), attenuation=ds.LinearAttenuation)
    np.testing.assert_allclose(fit.material.kd, 1.0, rtol=1e-4)
    np.testing.assert_allclose(fit.coefficients["attenuation.c1"], 0.5 / 0.6, rtol=1e-3)


def test_an_exponential_law_is_recovered(allowed: float) -> None:
    """Its scale is known: nothing is ambiguous, and k_d and k_s have their bounds."""
    fit = fitting.fit(
        photograph(ds.ExponentialAttenuation(0.35)),
        GBUFFER,
        scene(None),
        attenuation=ds.ExponentialAttenuation,
    )
    assert isinstance(fit.scene.lights[0].attenuation, ds.ExponentialAttenuation)
    np.testing.assert_allclose(fit.coefficients["attenuation.a"], 0.35, rtol=allowed)
    np.testing.assert_allclose(fit.material.kd, 0.6, rtol=allowed)
    np.testing.assert_allclose(fit.material.specular[0].ks, 0.4, rtol=allowed)
    assert fit.unidentified == ()
    assert fit.reference_distance is None


@pytest.mark.slow
def test_the_error_of_an_absorption_is_its_scatter() -> None:
    """Over 40 noisy captures, the errors of a in units of its standard error have mean square 1."""
    deviations = []
    for seed in range(40):
        image = photograph(ds.ExponentialAttenuation(0.35), noise=0.01, seed=seed)
        fit = fitting.fit(image, GBUFFER, scene(None), attenuation=ds.ExponentialAttenuation)
        error = fit.standard_errors["attenuation.a"]
        deviations.append((float(fit.coefficients["attenuation.a"]) - 0.35) / float(error))
    # a chi-square with 40 degrees of freedom: 1 +- 3 * sqrt(2 / 40)
    assert 0.33 < np.mean(np.square(deviations)) < 1.67


@pytest.mark.slow
def test_an_inverse_square_law_has_nothing_to_fit(allowed: float) -> None:
    image = photograph(ds.InverseSquare())
    fit = fitting.fit(image, GBUFFER, scene(None), attenuation=ds.InverseSquare)
    assert isinstance(fit.scene.lights[2].attenuation, ds.InverseSquare)
    np.testing.assert_allclose(fit.material.kd, 0.6, rtol=allowed)
    assert set(fit.coefficients) == {"ka", "kd", "specular.0.ks", "specular.0.shininess"}
    assert fit.unidentified == ()
    # And the quadratic law still finds it, in a corner of its triangle.
    fit = fitting.fit(image, GBUFFER, scene(None), attenuation=ds.QuadraticAttenuation)
    shares = numbers(fit, ("reference.l0", "reference.l1", "reference.l2"))
    np.testing.assert_allclose(shares, (0, 0, 1), atol=allowed)


LAWS = (
    None,
    ds.InverseSquare,
    ds.LinearAttenuation,
    ds.ExponentialAttenuation,
    ds.QuadraticAttenuation,
)


@pytest.mark.parametrize(
    "law",
    [
        None,
        ds.InverseSquare(),
        ds.LinearAttenuation(1.0, 0.3),
        ds.ExponentialAttenuation(0.35),
        ds.QuadraticAttenuation(1.0, 0.2, 0.15),
        ds.QuadraticAttenuation(0.3, 0.15, 0.05),
    ],
    ids=lambda law: "none" if law is None else type(law).__name__,
)
@pytest.mark.parametrize("noise", [0.0, 0.002])
@pytest.mark.slow
def test_the_true_law_has_the_least_criterion(
    law: AbstractAttenuation | None, noise: float
) -> None:
    rows = fitting.compare(photograph(law, noise=noise), GBUFFER, scene(None), LAWS)
    assert rows[0].name == ("attenuation as given" if law is None else type(law).__name__)
    assert rows[0].weight > 0.9
    assert sum(row.weight for row in rows) == pytest.approx(1)
    assert [row.bic for row in rows] == sorted(row.bic for row in rows)


@pytest.mark.slow
def test_the_criterion_is_that_of_schwarz() -> None:
    """From the residual that is reported, by the formula of the docstring."""
    image = photograph(ds.ExponentialAttenuation(0.35), noise=0.01)
    rows = fitting.compare(
        image, GBUFFER, scene(None), (ds.LinearAttenuation, ds.ExponentialAttenuation)
    )
    assert [row.parameters for row in rows] == [6, 6]  # ka, kd, ks, n, the noise; and c1, or a
    used = image[GBUFFER.mask]
    for row in rows:
        left = (row.fit.relative_residual * np.linalg.norm(used)) ** 2
        logarithm = -used.size / 2 * (np.log(2 * np.pi * left / used.size) + 1)
        assert row.log_likelihood == pytest.approx(logarithm, rel=1e-5)
        assert row.bic == pytest.approx(6 * np.log(used.size) - 2 * logarithm, rel=1e-5)
    apart = rows[1].bic - rows[0].bic
    assert rows[1].weight == pytest.approx(1 / (1 + np.exp(apart / 2)), rel=1e-6, abs=1e-30)


@pytest.mark.slow
def test_materials_are_compared_in_the_same_way() -> None:
    image = photograph(None, noise=0.002)
    matte = ds.Material(ka=0.1, kd=0.5)
    halfway = replace(matte, specular=(ds.BlinnPhong(0.3, 50.0),))
    rows = fitting.compare(image, GBUFFER, scene(None), materials=(matte, halfway, MATERIAL))
    assert [row.name for row in rows] == ["ka + kd + Phong", "ka + kd + BlinnPhong", "ka + kd"]
    assert [row.parameters for row in rows] == [5, 5, 3]
    with pytest.raises(ds.BadInput, match="is empty"):
        fitting.compare(image, GBUFFER, scene(None), ())


@pytest.mark.parametrize("truth", CLAMPED.values(), ids=CLAMPED)
def test_a_clamp_that_acts_at_some_points_sets_the_scale(
    truth: tuple[float, ...], allowed: float
) -> None:
    fit = fitting.fit(of_truth(truth), GBUFFER, scene(None), attenuation=ds.QuadraticAttenuation)
    np.testing.assert_allclose(numbers(fit, ALL), truth, atol=allowed, rtol=0)
    assert fit.converged
    assert not any("share one scale" in item.reason for item in fit.unidentified)
    assert {"kd", "specular.0.ks"}.isdisjoint(named(fit))


@pytest.mark.parametrize("truth", CLAMPED.values(), ids=CLAMPED)
def test_the_errors_under_a_clamp_cover_the_truth(truth: tuple[float, ...]) -> None:
    """Six captures with noise: no coefficient is off by 4.5 standard errors, and the scale is told."""
    for seed in range(6):
        image = of_truth(truth, noise=0.003, seed=seed)
        fit = fitting.fit(image, GBUFFER, scene(None), attenuation=ds.QuadraticAttenuation)
        for name, value, found in zip(ALL, truth, numbers(fit, ALL), strict=True):
            error = float(np.max(fit.standard_errors[name]))
            assert abs(found - value) < 4.5 * error, (seed, name, found, error)
        assert float(np.max(fit.standard_errors["kd"])) < 0.01


@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_where_no_clamp_acts_the_scale_is_free(noise: float) -> None:
    image = of_truth(NOT_CLAMPED, noise=noise)
    fit = fitting.fit(image, GBUFFER, scene(None), attenuation=ds.QuadraticAttenuation)
    allowed = 10 * noise or (1e-6 if jax.config.jax_enable_x64 else 2e-3)
    np.testing.assert_allclose(numbers(fit, CONSTANTS), NOT_CLAMPED[4:], atol=allowed)
    assert named(fit) == SCALED
    assert fit.likelihood is not None
    assert fit.likelihood.parameters == 7


@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_where_all_is_clamped_no_constant_is_told(noise: float) -> None:
    image = of_truth(ALL_CLAMPED, noise=noise)
    fit = fitting.fit(image, GBUFFER, scene(None), attenuation=ds.QuadraticAttenuation)
    flat = [item for item in fit.unidentified if "clamped at 1 everywhere" in item.reason]
    assert flat[0].coefficients == CONSTANTS
    np.testing.assert_allclose(fit.material.kd, 0.6, rtol=max(noise, 1e-4))


@pytest.mark.slow
def test_no_clamp_is_seen_where_there_is_none() -> None:
    """Thirty random truths without a clamp, noisy: the extra search is not even begun, or loses."""
    rng = np.random.default_rng(2)
    for trial in range(30):
        truth = draw(rng, 1 + trial % 3, attenuated=True)
        image = np.asarray(ds.render(GBUFFER, truth.scene, truth.material))
        image = image + rng.normal(0, 0.005, image.shape).astype(image.dtype)
        fit = fitting.fit(image, GBUFFER, truth.scene, attenuation=ds.QuadraticAttenuation)
        assert any("share one scale" in item.reason for item in fit.unidentified), trial


@pytest.mark.slow
@pytest.mark.parametrize("held", ["kd", "attenuation.c0"])
def test_held_constants_and_the_clamp(held: str, allowed: float) -> None:
    """What is held sets the scale; the law is clamped all the same."""
    truth = CLAMPED["far clamped"]
    given = scene(ds.QuadraticAttenuation(*truth[4:]))
    fit = fitting.fit(
        of_truth(truth),
        GBUFFER,
        given,
        material=MATERIAL,
        hold=[held],
        attenuation=ds.QuadraticAttenuation,
    )
    np.testing.assert_allclose(numbers(fit, ALL), truth, atol=allowed, rtol=0)
    assert held not in fit.standard_errors
    assert fit.unidentified == ()


@pytest.mark.slow
def test_holding_c1_leaves_the_clamp_to_set_the_scale(allowed: float) -> None:
    truth = (0.1, 0.6, 0.4, 30.0, 0.3, 0.0, 0.1)
    given = scene(ds.QuadraticAttenuation(*truth[4:]))
    fit = fitting.fit(
        of_truth(truth),
        GBUFFER,
        given,
        hold=["attenuation.c1"],
        attenuation=ds.QuadraticAttenuation,
    )
    np.testing.assert_allclose(numbers(fit, ALL), truth, atol=allowed, rtol=0)
    assert fit.unidentified == ()


def test_an_absorption_can_be_held() -> None:
    given = scene(ds.ExponentialAttenuation(0.35))
    fit = fitting.fit(
        photograph(ds.ExponentialAttenuation(0.35)),
        GBUFFER,
        given,
        attenuation=ds.ExponentialAttenuation,
        hold=["attenuation.a"],
    )
    np.testing.assert_allclose(fit.coefficients["attenuation.a"], 0.35, rtol=1e-6)
    np.testing.assert_allclose(fit.material.kd, 0.6, rtol=1e-4)
    with pytest.raises(ds.BadInput, match="no light of the scene has a LinearAttenuation"):
        fitting.fit(
            photograph(None),
            GBUFFER,
            given,
            attenuation=ds.LinearAttenuation,
            hold=["attenuation.c1"],
        )


@pytest.mark.slow
def test_a_clamp_under_outliers() -> None:
    """Shadows by Tukey's weights; the clamp is seen all the same."""
    truth = CLAMPED["steep"]
    image = of_truth(truth, noise=0.002)
    image[20:26, 30:40] *= 0.3
    fit = fitting.fit(
        image, GBUFFER, scene(None), attenuation=ds.QuadraticAttenuation, robust="tukey"
    )
    np.testing.assert_allclose(fit.material.kd, 0.6, atol=0.01)
    np.testing.assert_allclose(fit.coefficients["attenuation.c2"], 0.1, atol=0.02)
    assert not any("share one scale" in item.reason for item in fit.unidentified)


def test_the_grid_of_clamped_laws_begins_between_the_ends() -> None:
    """At every node 1/f is under 1 at the nearest distance and over 1 at the farthest."""
    gauge = PolynomialGauge(jnp.asarray(2.0), (None, None, None))
    for _, law in gauge.ceiling_nodes(1.1, 5.0)[1:]:  # all but the flat one
        near, far = (sum(l * (d / 2.0) ** k for k, l in enumerate(law)) for d in (1.1, 5.0))
        assert near < 1 < far


def test_a_linear_law_beside_a_known_diffuse_coefficient() -> None:
    """Its scale is known then, and its constants are judged as they are."""
    law = ds.LinearAttenuation(1.5, 0.4)
    lights = tuple(ds.PointLight(at, 1.0, law) for at in ((1.0, 1.0, 2.0), (-1.5, 1.0, 3.5)))
    scene = ds.Scene(ambient=1.0, lights=lights)
    gbuffer = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(64, 64, 2.2))
    truth = ds.Material(ka=0.1, kd=0.6, specular=ds.Phong(0.4, 30.0))
    image = ds.render(gbuffer, scene, truth)
    fit = fitting.fit(
        image, gbuffer, scene, material=truth, hold=["kd"], attenuation=ds.LinearAttenuation
    )
    found = fit.coefficients["attenuation.c0"], fit.coefficients["attenuation.c1"]
    np.testing.assert_allclose(found, (1.5, 0.4), rtol=2e-3)


def test_a_window_is_not_dropped() -> None:
    windowed = scene(ds.Windowed(ds.InverseSquare(), reach=9.0))
    for law in (ds.QuadraticAttenuation, ds.InverseSquare):
        with pytest.raises(ds.BadInput, match="would drop"):
            fitting.fit(np.zeros((*GBUFFER.shape, 3)), GBUFFER, windowed, attenuation=law)


def test_a_clamp_that_pulls_everything_away_is_found() -> None:
    """It acts at most points: to first order nothing tells of it, and the law without it fits badly."""
    camera = ds.OrthographicCamera(64, 48, 5.4545)
    gbuffer = ds.gbuffer(ds.Sphere((0.0909, -0.0909, 0)), camera)
    material = ds.Material((0.05, 0.03), (0.35, 0.1), ds.Phong(0.25, 40.0))
    law = ds.QuadraticAttenuation(0.5, 0.0, 0.002)
    places = ((7.5, 5, 15), (-8, 5, 14), (3, 3, 7), (9, 12, 22))
    scenes = [ds.Scene(1.0, ds.PointLight(place, 1.0, law)) for place in places]
    scenes.append(ds.Scene(1.0))  # with the lamp off
    images = [ds.render(gbuffer, scene, material) for scene in scenes]
    fit = fitting.fit(images, gbuffer, scenes, attenuation=ds.QuadraticAttenuation)
    assert fit.relative_residual < 1e-5
    np.testing.assert_allclose(np.asarray(fit.material.kd), [0.35, 0.1], rtol=1e-3)
    assert fit.scene[4].lights == ()
    np.testing.assert_allclose(float(fit.scene[0].lights[0].attenuation.c2), 0.002, rtol=1e-2)
