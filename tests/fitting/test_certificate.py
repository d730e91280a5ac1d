"""Certificates: proven where it is so, refused where it is not, and never wrong."""

import re
from dataclasses import replace
from typing import ClassVar

import jax
import numpy as np
import pytest
from certified import GBUFFER, Case, case, dense_residual

import diffshade as ds
from diffshade.errors import BadInput
from fitting.attempt import attempted, searched
from fitting.certificate import Certificate, certify
from fitting.gauge import PolynomialGauge
from fitting.lower_bound import bound
from fitting.model import model_of
from fitting.observed import Observed
from fitting.weights import Tukey, Weighting

SLACK = 1e-9 if jax.config.jax_enable_x64 else 3e-6
"""What the oracle itself may be off by: its columns come from the renderer, in its precision."""
LOBE = ds.Material(ka=0.5, kd=0.5, specular=ds.Phong(ks=0.5, shininess=30.0))


def certified(drawn: Case, **options: float) -> Certificate:
    return certify(drawn.observed, drawn.minimum, drawn.limit.box, **options)


def bounded(drawn: Case, intervals: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """The bounds `below` and `above`, relative; and the norm of what was observed."""
    found = bound(drawn.observed, drawn.minimum, intervals, np.inf)
    norm = float(found.norm)
    return found.below / norm, found.above / norm, norm


def holds(certificate: Certificate, drawn: Case, nodes: int = 60) -> None:
    """What it says is so, as far as dense least squares at many shininess values can tell."""
    found = dense_residual(drawn, np.exp(float(drawn.minimum.u[0])))
    assert certificate.interval is not None
    low, high = certificate.interval
    for n in np.geomspace(0.1, 1e5, nodes):
        left = dense_residual(drawn, n)
        if certificate.proven:
            assert left >= found - certificate.tolerance - SLACK
        if not low * (1 - 1e-6) <= n <= high * (1 + 1e-6):  # the box has rounded ends
            assert left > found + certificate.tolerance - SLACK


@pytest.mark.parametrize("noise", [0.0, 1e-3, 0.05])
@pytest.mark.parametrize("light_count", [1, 3])
def test_a_random_truth_is_proven(rng: np.random.Generator, light_count: int, noise: float) -> None:
    drawn = case(rng, light_count=light_count, noise=noise)
    certificate = certified(drawn)
    assert certificate.proven, certificate.reason
    np.testing.assert_allclose(certificate.shininess, (0.1, 1e5), rtol=1e-6)
    holds(certificate, drawn)
    # and the interval is about as short as it can be
    best = np.exp(float(drawn.minimum.u[0]))
    assert certificate.interval is not None
    low, high = certificate.interval
    assert low < best < high
    found = dense_residual(drawn, best)
    for end in (low, high):
        assert dense_residual(drawn, end) < found + 2 * certificate.tolerance


def test_the_bound_lies_under_the_residual(rng: np.random.Generator) -> None:
    """Over intervals of all widths, of images that no material gives: noise on nothing, too."""
    for noise in (0.0, 0.3, 3.0):
        drawn = case(rng, light_count=3, noise=noise)
        a = np.exp(rng.uniform(np.log(0.1), np.log(1e4), 16))
        b = a * np.exp(rng.uniform(0, 1.5, 16) ** 3)
        below, above, norm = bounded(drawn, np.stack([a, b], axis=1))
        np.testing.assert_allclose(norm, np.linalg.norm(drawn.image[GBUFFER.mask]), rtol=1e-6)
        for k in range(16):
            inside = [dense_residual(drawn, n) for n in np.geomspace(a[k], b[k], 7)]
            assert below[k] <= min(inside) + SLACK
            assert above[k] >= inside[0] - SLACK


def test_the_bound_is_of_second_order(rng: np.random.Generator) -> None:
    """Its gap shrinks with the square of the interval's width, and is that of rounding at 0."""
    scene = ds.Scene(ambient=0.5, lights=ds.PointLight((0.8, 0.5, 2.5)))
    image = np.asarray(ds.render(GBUFFER, scene, ds.Material(0.1, 0.6, ds.Phong(0.4, 40.0))))
    noise = rng.normal(0, 0.02, image.shape) * GBUFFER.mask[..., None]
    drawn = Case.of(image + noise.astype(image.dtype), scene, LOBE)
    n = np.exp(float(drawn.minimum.u[0]))
    exact = dense_residual(drawn, n)
    widths = np.append(0.2 / 2.0 ** np.arange(15), 0.0)
    below, above, _ = bounded(drawn, n * np.exp(np.outer(widths, [-0.5, 0.5])))
    gaps = exact - below
    assert (gaps[:3] / gaps[1:4] > 3.5).all()
    np.testing.assert_allclose([below[-1], above[-1]], exact, atol=2e-6)


def two_basins(box: tuple[float, float]) -> Case:
    """Two highlights in the image, one lobe in the model, and a search that sees n within `box`."""
    scene = ds.Scene(lights=ds.ParallelLight((0.3, 0.4, 1.0)))
    lobes = ds.Phong(ks=0.05, shininess=2.0), ds.Phong(ks=0.9, shininess=400.0)
    image = np.asarray(ds.render(GBUFFER, scene, ds.Material(specular=lobes)))
    start = ds.Material(specular=ds.Phong(ks=0.5, shininess=10.0))
    return Case.of(image, scene, start, {"specular.shininess": box})


def test_the_wrong_basin_is_never_proven() -> None:
    wrong = two_basins((0.1, 20))
    np.testing.assert_allclose(np.exp(wrong.minimum.u[0]), 4, rtol=0.05)
    assert certified(wrong).proven  # within its box it is the best
    right = two_basins((0.1, 1e5))
    np.testing.assert_allclose(np.exp(right.minimum.u[0]), 193, rtol=0.05)
    assert certified(right).proven
    certificate = certify(wrong.observed, wrong.minimum, right.limit.box)
    assert not certificate.proven
    assert certificate.reason.startswith("Shininess ")
    # and what it names as better is better
    named = float(certificate.reason.split()[1])
    best = (wrong.minimum.cost / wrong.minimum.square) ** 0.5
    assert dense_residual(right, named) < best - certificate.tolerance
    assert certificate.interval is not None
    low, high = certificate.interval
    assert low <= 193 <= high


@pytest.mark.slow
def test_what_is_no_minimum_is_not_proven(rng: np.random.Generator) -> None:
    drawn = case(rng, light_count=3, noise=1e-3)
    beside = replace(drawn.minimum, u=drawn.minimum.u + 0.5)
    certificate = certify(drawn.observed, beside, drawn.limit.box)
    assert not certificate.proven
    assert certificate.reason.startswith("Shininess ")


def test_no_highlight_leaves_the_shininess_open() -> None:
    """Any shininess will do where ks is 0: proven, and the interval says so."""
    scene = ds.Scene(ambient=1.0, lights=ds.PointLight((0.8, 0.5, 2.5)))
    image = np.asarray(ds.render(GBUFFER, scene, ds.Material(ka=0.1, kd=0.6)))
    noise = np.random.default_rng(0).normal(0, 1e-3, image.shape) * GBUFFER.mask[..., None]
    drawn = Case.of(image + noise.astype(image.dtype), scene, LOBE)
    certificate = certified(drawn)
    assert certificate.proven, certificate.reason
    assert certificate.interval is not None
    low, high = certificate.interval
    assert low < 0.5
    assert high > 9e4
    holds(certificate, drawn)


@pytest.mark.slow
def test_bounds_are_kept_to(rng: np.random.Generator) -> None:
    """A ks that must be less than it is, one without a bound, and ka held: each its own optimum."""
    scene = ds.Scene(
        ambient=0.5, lights=(ds.PointLight((0.8, 0.5, 2.5)), ds.PointLight((-1, 1, 3)))
    )
    truth = ds.Material(ka=0.1, kd=0.6, specular=ds.Phong(ks=0.7, shininess=40.0))
    image = np.asarray(ds.render(GBUFFER, scene, truth))
    noise = rng.normal(0, 1e-3, image.shape) * GBUFFER.mask[..., None]
    image = image + noise.astype(image.dtype)
    for bounds in ({"specular.ks": (0, 0.3)}, {"specular.ks": (0, None), "kd": (0, None)}):
        drawn = Case.of(image, scene, LOBE, bounds)
        certificate = certified(drawn)
        assert certificate.proven, certificate.reason
        holds(certificate, drawn)


@pytest.mark.slow
def test_weights_are_those_of_the_solution(rng: np.random.Generator) -> None:
    """Outliers that a robust fit gives no weight to: the residual is weighted, and small."""
    scene = ds.Scene(ambient=0.5, lights=ds.PointLight((0.8, 0.5, 2.5)))
    truth = ds.Material(ka=0.1, kd=0.6, specular=ds.Phong(ks=0.4, shininess=40.0))
    image = np.asarray(ds.render(GBUFFER, scene, truth))
    dtype = image.dtype
    dirty = (rng.uniform(size=image.shape[:2]) < 0.05) & GBUFFER.mask
    noise = rng.normal(0, 1e-3, image.shape) * GBUFFER.mask[..., None]
    image = image + (noise + dirty[..., None]).astype(dtype)
    drawn = Case.of(image, scene, LOBE)
    weighting = Weighting(robust=Tukey())
    model = drawn.minimum.problem.model
    basins = searched(drawn.observed, model, drawn.limit, weighting, None)
    found = attempted(drawn.observed, model, drawn.limit, basins, weighting, gains=False)
    minimum = found.minimum
    np.testing.assert_allclose(np.exp(minimum.u[0]), 40, rtol=0.03)
    certificate = certify(drawn.observed, minimum, drawn.limit.box)
    assert certificate.proven, certificate.reason
    assert "at the weights of the solution" in certificate.reason
    assert certificate.interval is not None
    assert certificate.interval[0] < np.exp(minimum.u[0]) < certificate.interval[1] < 60
    plain = (drawn.minimum.cost / drawn.minimum.square) ** 0.5
    assert float(re.search(r"residual ([0-9.e-]+) that", certificate.reason)[1]) < plain / 10


def test_too_few_evaluations_prove_nothing(rng: np.random.Generator) -> None:
    drawn = case(rng, light_count=1, noise=1e-3)
    certificate = certified(drawn, most_evaluations=16)
    assert not certificate.proven
    assert certificate.reason == "Undecided after 17 evaluations."
    holds(certificate, drawn)


class Hump(ds.Phong):
    """A lobe that promises nothing."""

    kind: ClassVar[str] = "hump"
    convex: ClassVar[bool] = False


def test_what_a_proof_does_not_reach_is_said(rng: np.random.Generator) -> None:
    drawn = case(rng, light_count=1, noise=1e-3)
    minimum, problem, model = drawn.minimum, drawn.minimum.problem, drawn.minimum.problem.model
    lobe = model.material.specular[0]
    lobes = replace(model.material, specular=(lobe, lobe))
    two = replace(model, material=lobes, searched=model_of(lobes, frozenset(), 1).searched)
    hump = replace(model, material=replace(model.material, specular=Hump(lobe.ks, lobe.shininess)))
    heavy = replace(lobe, weight=ds.Dielectric(1.5))
    weighted = model_of(replace(model.material, specular=(heavy,)), frozenset(), 1)
    weighted = replace(model, material=weighted.material, searched=(("specular.0.weight.index",),))
    law = replace(model, gauge=PolynomialGauge(np.ones(()), held=(None, None, None)))

    def certified_as(**changed: object) -> Certificate:
        other = replace(minimum, problem=replace(problem, **changed))
        return certify(drawn.observed, other, drawn.limit.box)

    lights = drawn.observed.photographs[0]
    dark = Observed([lights._replace(scene=replace(lights.scene, ambient=-lights.scene.ambient))])
    gained = replace(minimum, gains=np.ones(1))
    for certificate, reason in (
        (
            certified_as(model=two),
            "2 shapes are searched: specular.0.shininess, specular.1.shininess",
        ),
        (certified_as(model=hump), "does not fall convexly with specular.0.shininess"),
        (certified_as(model=weighted), "does not fall convexly with specular.0.weight.index"),
        (certified_as(model=law), "The attenuation is searched"),
        (certify(drawn.observed, gained, drawn.limit.box), "The gains of the lights are searched"),
        (certified_as(lower=problem.lower - 1), "may be negative"),
        (certify(dark, minimum, drawn.limit.box), "A light or an object colour is negative"),
    ):
        assert not certificate.proven
        assert reason in certificate.reason
        assert certificate.interval is None
    with pytest.raises(BadInput, match="tolerance is 0"):
        certified(drawn, tolerance=0.0)
    nowhere = replace(minimum, u=minimum.u * np.nan)
    assert "No minimum was found" in certify(drawn.observed, nowhere, drawn.limit.box).reason


@pytest.mark.slow
def test_what_is_held_is_not_searched() -> None:
    """Without a shininess to search all is linear; one of two lobes may be searched."""
    scene = ds.Scene(ambient=0.5, lights=ds.PointLight((0.8, 0.5, 2.5)))
    lobes = ds.Phong(ks=0.3, shininess=200.0), ds.BlinnPhong(ks=0.2, shininess=20.0)
    truth = ds.Material(ka=0.1, kd=0.6, specular=lobes)
    image = np.asarray(ds.render(GBUFFER, scene, truth))
    held = frozenset({"specular.0.shininess", "ka"})
    drawn = Case.of(image, scene, truth, hold=held)
    certificate = certified(drawn)
    assert certificate.proven, certificate.reason
    assert certificate.interval is not None
    low, high = certificate.interval
    assert 18 < low < 20 < high < 22
    certificate = certified(Case.of(image, scene, truth, hold=held | {"specular.1.shininess"}))
    assert certificate.proven
    assert certificate.interval is None
