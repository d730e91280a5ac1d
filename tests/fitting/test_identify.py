"""Every way in which images cannot tell coefficients apart is named, and only where it is so.

Each case has a neighbour in which the images do tell. The oracle is `dense`: the plain model with its
whole Jacobian, of which the singular values say how many directions are lost.
"""

from dataclasses import replace

import jax
import numpy as np
import pytest
from dense import Plain

import diffshade as ds
import fitting
import fitting.identify
from fitting.degeneracies import Seen
from fitting.identify import Unidentified

TWO = ((0.8, 0.5, 2.5), (-1.0, 0.8, 2.0))
FOUR = (*TWO, (0.0, -1.0, 4.0), (1.0, 1.0, 1.4))
LAW = (1.0, 0.2, 0.1)
RGB = {"ka": (0.1, 0.2, 0.05), "kd": (0.5, 0.4, 0.2), "ks": ((0.3, 0.2, 0.1),)}
HEAD = ((0.0, 0.0, 1.0),)
LOBES = {"ks": ((0.3,), (0.2,))}
FAR = ((30.0, 20.0, 90.0),)
FAINT = (1.0, 1e-3, 1e-5)

SCALE = {"kd", "specular.0.ks", "attenuation.c0", "attenuation.c1", "attenuation.c2"}
LOBE = {"specular.0.ks", "specular.0.shininess"}

# what, the case, words of the sentence, the coefficients that are named, and the neighbour
CASES: dict[str, tuple[Plain, str, set[str], Plain]] = {
    "one scale": (
        Plain(FOUR, c=LAW),
        "share one scale, which no image",
        SCALE,
        Plain(FOUR, c=LAW, hold=("kd",)),
    ),
    "one scale, three channels": (
        Plain(FOUR, c=LAW, **RGB),
        "share one scale, which no image",
        SCALE,
        Plain(FOUR, c=LAW, **RGB, hold=("c0",)),
    ),
    "one scale, not clamped": (
        Plain(FOUR, c=(0.3, 0.2, 0.1)),
        "share one scale, which no image",
        SCALE,
        Plain(FOUR, c=(0.3, 0.2, 0.1), clamp=True),
    ),
    "all clamped": (
        Plain(FOUR, c=(0.1, 0.02, 0.01), clamp=True),
        "clamped at 1 at every lit point",
        SCALE - {"kd", "specular.0.ks"},
        Plain(FOUR, c=(0.3, 0.2, 0.1), clamp=True),
    ),
    "I_a and k_a": (
        Plain(TWO, ambient=True),
        "product of I_a and k_a",
        {"ka", "ambient"},
        Plain(TWO, ambient=True, hold=("ka",)),
    ),
    "gains": (
        Plain(TWO, gains=True, **RGB),
        "gains share one scale with kd and specular.0.ks",
        {"kd", "specular.0.ks", "gain.0", "gain.1"},
        Plain(TWO, gains=True, **RGB, hold=("gain0",)),
    ),
    "gains against constants": (
        Plain(FOUR, gains=True, c=LAW, separate=True, hold=("kd",)),
        "gains share one scale with c0, c1 and c2",
        {*(f"gain.{j}" for j in range(4)), *(SCALE - {"kd", "specular.0.ks"})},
        Plain(FOUR, gains=True, c=LAW, separate=True, hold=("kd", "gain0")),
    ),
    "a light that lights nothing": (
        Plain((*TWO, (0.0, 0.0, -5.0)), gains=True, hold=("gain0",)),
        "no used pixel shows that light",
        {"gain.2"},
        Plain((*TWO, (0.0, 0.5, 5.0)), gains=True, hold=("gain0",)),
    ),
    "two lights in one place": (
        Plain((TWO[0], TWO[0]), gains=True, hold=("kd",)),
        "light the surface alike",
        {"gain.0", "gain.1"},
        Plain(TWO, gains=True, hold=("kd",)),
    ),
    "a far light": (
        Plain(FAR, c=FAINT, hold=("c0",)),
        "the lights are far: their distances vary by 1 %",
        {"kd", "specular.0.ks", "attenuation.c1", "attenuation.c2"},
        Plain(FOUR, c=LAW, hold=("c0",)),
    ),
    "a far light, known kd": (
        Plain(FAR, c=FAINT, hold=("c0", "kd")),
        "the lights are far",
        {"attenuation.c1", "attenuation.c2"},
        Plain((*FAR, *TWO), c=FAINT, separate=True, hold=("c0", "c2", "kd")),
    ),
    "one near light": (
        Plain(TWO[:1], c=LAW, hold=("c0",)),
        "too few to tell c0, c1 and c2 apart",
        {"attenuation.c1"},
        Plain(FOUR, c=LAW, hold=("c0",)),
    ),
    "no light is reflected": (
        Plain(TWO, kd=(0.0,), ks=((0.0,),), c=LAW, hold=("c0", "n0")),
        "light that is not reflected shows no attenuation",
        {"attenuation.c1", "attenuation.c2"},
        Plain(FOUR, kd=(0.1,), ks=((0.0,),), c=LAW, hold=("c0", "n0")),
    ),
    "k_s is 0": (
        Plain(TWO, ks=((0.0,),)),
        "a highlight that is not seen has no width",
        {"specular.0.shininess"},
        Plain(TWO, ks=((0.02,),)),
    ),
    "k_s is near 0": (
        Plain(TWO, ks=((1e-4,),)),
        "too little of the highlight",
        {"specular.0.shininess"},
        Plain(TWO, ks=((0.02,),)),
    ),
    "no highlight": (
        Plain(((2.5, 0.0, 1.0),), plane=True, n=(20.0,)),
        "no highlight is seen: only the flank",
        LOBE,
        Plain(((2.5, 0.0, 1.0), (0.2, 0.0, 1.0)), plane=True, n=(20.0,)),
    ),
    "highlight between the pixels": (
        Plain(HEAD, near=False, n=(400.0,)),
        "no highlight is seen: only the flank",
        LOBE,
        Plain(((0.5, 0.0, 1.0), (0.0, 0.4, 1.0)), near=False, n=(100.0,)),
    ),
    "a lobe that no pixel shows": (
        Plain(((0.0, 3.0, -1.0),), ka=None, n=(2000.0,), plane=True, hold=("kd",)),
        "no used pixel shows any of specular.0",
        LOBE,
        Plain(((0.0, 0.3, 1.0),), ka=None, n=(20.0,), plane=True, hold=("kd",)),
    ),
    "headlight, a broad lobe": (
        Plain(HEAD, near=False, halfway=True, n=(1.0,), **RGB),
        "(a headlight)",
        {"kd", "specular.0.ks"},
        Plain(((1.0, 0.0, 1.0),), near=False, halfway=True, n=(1.0,), **RGB),
    ),
    "headlight, nearly as broad": (
        Plain(HEAD, near=False, halfway=True, n=(1.05,)),
        "(a headlight)",
        {"kd", *LOBE},
        Plain(HEAD, near=False, halfway=True, n=(5.0,)),
    ),
    "headlight, Phong": (
        Plain(HEAD, near=False, n=(20.0,), plane=True),
        "r.v varies too little over the used pixels",
        {"ka", "kd", *LOBE},
        Plain(HEAD, near=False, n=(20.0,)),
    ),
    "flat": (
        Plain(((1.0, 0.0, 1.0),), near=False, plane=True, ks=(), n=()),
        "n.l varies too little over the used pixels",
        {"ka", "kd"},
        Plain(((1.0, 0.0, 1.0),), near=False, ks=(), n=()),
    ),
    "two lobes": (
        Plain(TWO, **LOBES, n=(20.0, 20.0)),
        "the same shape (shininess 20 and 20)",
        {*LOBE, "specular.1.ks", "specular.1.shininess"},
        Plain(TWO, **LOBES, n=(200.0, 10.0)),
    ),
    "two lobes, nearly": (
        Plain(TWO, **LOBES, n=(20.0, 20.5)),
        "the same shape (shininess 20 and 20.5)",
        {*LOBE, "specular.1.ks", "specular.1.shininess"},
        Plain(TWO, **LOBES, n=(40.0, 10.0)),
    ),
    "a light from behind": (
        Plain(((0.0, 0.0, -1.0),), near=False, ks=(), n=()),
        "no pixel depends on it",
        {"kd"},
        Plain(((0.0, 0.3, 1.0),), near=False, ks=(), n=()),
    ),
}


def saying(found: tuple[Unidentified, ...], words: str) -> list[Unidentified]:
    return [item for item in found if words in item.reason]


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.float64
def test_each_is_named(name: str, dtype: type) -> None:
    case, words, coefficients, _ = CASES[name]
    found = case.told(dtype)
    named = saying(found, words)
    assert named, [item.reason for item in found]
    assert coefficients & {n for item in named for n in item.coefficients}, found
    # In float32 more may be lost in the sums.
    if dtype == np.float64:
        assert coefficients == {n for item in found for n in item.coefficients}, found
    assert all("\n" not in item.reason for item in found)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.float64
def test_its_neighbour_is_not(name: str) -> None:
    _, words, _, neighbour = CASES[name]
    assert not saying(neighbour.told(), words)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.float64
def test_as_many_directions_are_lost_as_singular_values(name: str) -> None:
    """Of the dense Jacobian, its columns scaled to one length."""
    case = CASES[name][0]
    jacobian = case.dense()[:, ~case.known]
    norm = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(norm > 0, norm, 1)
    lost = jacobian.shape[1] - np.linalg.matrix_rank(scaled, tol=1e-7 * np.linalg.norm(scaled))
    blind = case.uncertainty().blind
    assert blind.shape[1] == lost
    # and along each of them nothing changes
    size = np.abs(blind).max(axis=0, initial=0)
    assert np.all(size > 0)


@pytest.mark.float64
def test_a_gauge_that_was_chosen_is_named_though_nothing_is_lost() -> None:
    """As `fit` does it: the scale is set by convention, and the search has no null direction."""
    case = Plain(FOUR, c=LAW, hold=("c0",))
    uncertainty = case.uncertainty()
    values = dict(uncertainty.values)

    def told(**options: object) -> tuple[Unidentified, ...]:
        return fitting.identify.unidentified(values, uncertainty, 1.0, **options)  # type: ignore[arg-type]

    assert not saying(told(), "share one scale")
    assert saying(told(scaled=True), "share one scale")
    # A clamp seen to act at some points sets the scale; at all of them it hides the constants.
    assert not saying(told(scaled=True, seen=Seen(1.0, 3.0, 0.3)), "share one scale")
    hidden = told(scaled=True, seen=Seen(1.0, 3.0, 1.0))
    assert not saying(hidden, "share one scale")
    assert saying(hidden, "clamped at 1 at every")
    both = saying(
        told(gains=("gain.0", "gain.1")), "gains share one scale with kd and specular.0.ks"
    )
    assert set(both[0].coefficients) == {"kd", "specular.0.ks", "gain.0", "gain.1"}
    assert not saying(told(), "gains share")


@pytest.mark.float64
def test_noise_that_was_found_counts() -> None:
    """A shininess that is known for little noise is not known for much."""
    case = Plain(TWO, ks=((0.02,),))
    assert case.told() == ()
    assert saying(replace(case, noise=0.1).told(), "too little of the highlight of specular.0")


GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(48, 48, 2.2))
MATERIAL = ds.Material(ka=0.1, kd=(0.6, 0.4, 0.2), specular=ds.Phong(0.3, 25.0))


def scene(
    *lights: tuple[float, float, float], law: ds.QuadraticAttenuation | None = None
) -> ds.Scene:
    return ds.Scene(ambient=0.5, lights=tuple(ds.PointLight(p, 1.0, law) for p in lights))


@pytest.mark.slow
def test_a_fit_names_the_scale_and_a_far_light() -> None:
    law = ds.QuadraticAttenuation(*LAW)
    unknown = ds.QuadraticAttenuation
    near = scene(*FOUR, law=law)
    fit = fitting.fit(ds.render(GBUFFER, near, MATERIAL), GBUFFER, near, attenuation=unknown)
    assert [set(item.coefficients) for item in fit.unidentified] == [SCALE]
    away = scene(*FAR, law=ds.QuadraticAttenuation(*FAINT))
    fit = fitting.fit(ds.render(GBUFFER, away, MATERIAL), GBUFFER, away, attenuation=unknown)
    named = {name for item in fit.unidentified for name in item.coefficients}
    assert {"attenuation.c1", "attenuation.c2"} <= named
    assert saying(fit.unidentified, "share one scale")
    # What is measured is k_d at the distance of the light, whatever the law.
    assert "reference.kd" not in named


def test_a_fit_names_a_lobe_that_is_not_there_and_one_that_is_diffuse() -> None:
    matte = ds.Material(ka=0.1, kd=(0.6, 0.4, 0.2))
    fit = fitting.fit(ds.render(GBUFFER, scene(*TWO), matte), GBUFFER, scene(*TWO))
    assert "specular.0.shininess" in {n for item in fit.unidentified for n in item.coefficients}
    fit = fitting.fit(ds.render(GBUFFER, scene(*TWO), MATERIAL), GBUFFER, scene(*TWO))
    assert fit.unidentified == ()

    broad = ds.Material(kd=0.4, specular=ds.BlinnPhong(0.3, 1.0))
    for light, lost in (((0, 0, 1), True), ((1, 0, 1), False)):
        lit = ds.Scene(lights=ds.ParallelLight(light))
        fit = fitting.fit(
            ds.render(GBUFFER, lit, broad),
            GBUFFER,
            lit,
            material=broad,
            hold=["specular.shininess"],
        )
        assert bool(saying(fit.unidentified, "(a headlight)")) == lost
        assert bool(np.isinf(fit.standard_errors["kd"]).all()) == lost


def test_two_lobes_of_one_width() -> None:
    lobes = (ds.Phong(0.3, 25.0), ds.Phong(0.2, 25.0))
    for widths, lost in (((25.0, 25.0), True), ((25.0, 4.0), False)):
        model = ds.Material(
            kd=0.5,
            specular=tuple(
                replace(lobe, shininess=jax.numpy.asarray(n))
                for lobe, n in zip(lobes, widths, strict=True)
            ),
        )
        image = ds.render(GBUFFER, scene(*TWO), model)
        hold = ["specular.shininess"]
        fit = fitting.fit(image, GBUFFER, scene(*TWO), material=model, hold=hold)
        assert bool(saying(fit.unidentified, "the same shape")) == lost
