"""Maps: a material for every pixel or region, and what is known of each."""

import jax
import numpy as np
import pytest
from map_cases import GBUFFER, KD, KS, PIXELS, SIZE, N, directions, rendered, scenes, truth

import diffshade as ds
import fitting
from fitting.pixel_block import _program


def of(material: ds.Material) -> dict[str, np.ndarray]:
    """A material's maps by name."""
    lobe = material.specular[0]
    named = {"ka": material.ka, KD: material.kd, KS: lobe.ks, N: lobe.shininess}  # type: ignore[attr-defined]
    return {name: np.asarray(value) for name, value in named.items() if value is not None}


def check_recovered(maps: fitting.Maps, material: ds.Material, least: float) -> None:
    """What is identified is right, and that is at least this share of the shininess.

    Within 1e-3, or, where in float32 the tail of a highlight that is not seen is lost in rounding, a
    tenth of the error that noise of a thousandth would make.
    """
    for name, expected in of(material).items():
        known = maps.identified[name]
        off = np.abs(maps.coefficients[name] - expected)
        allowed = np.maximum(1e-3 * expected, 0.1 * np.where(known, maps.nominal_errors[name], 0))
        assert np.all(off[known] < allowed[known]), name
        assert np.mean((off > 1e-3 * expected)[known]) < 1e-3, name
    assert maps.identified[N].mean() > least
    assert maps.relative_residual < 1e-4


@pytest.mark.parametrize("steps", [None, 8])
def test_random_truths_come_back_where_they_are_identified(
    steps: int | None, rng: np.random.Generator
) -> None:
    material, lit = truth(rng), scenes()
    maps = fitting.fit_maps(rendered(lit, material), GBUFFER, lit, steps=steps)
    check_recovered(maps, material, least=0.25)
    assert maps.converged.mean() > 0.99
    # and the recovered maps are a material like any other
    again = ds.render(GBUFFER, lit[0], maps.material)
    np.testing.assert_allclose(again, ds.render(GBUFFER, lit[0], material), atol=2e-3)
    image = maps.to_image(KD)
    assert image.shape == (SIZE, SIZE, 1)
    np.testing.assert_array_equal(image[GBUFFER.mask].T, maps.coefficients[KD])


@pytest.mark.slow
def test_colours_ambient_and_several_kinds_of_lights(rng: np.random.Generator) -> None:
    """Coloured lights, two in some images and one in others, with attenuation and object colours."""
    towards = directions(30, rng)
    law = ds.QuadraticAttenuation(1.0, 0.05, 0.02)
    lit = []
    for k, d in enumerate(towards):
        lights = [ds.PointLight(3 * d, rng.uniform(0.5, 1.5, 3), law)]
        if k % 3 == 0:
            lights.append(ds.ParallelLight(towards[k - 1], 0.5))
        lit.append(ds.Scene(ambient=None if k % 5 == 0 else 0.7, lights=lights))
    plain = truth(rng, channels=3, lobe=ds.BlinnPhong)
    material = ds.Material(
        ka=rng.uniform(0.05, 0.3, (3, PIXELS)),
        kd=plain.kd,
        specular=plain.specular,
        od=(1, 0.8, 0.6),
    )
    form = ds.Material(ka=0.5, kd=0.5, specular=ds.BlinnPhong(0.5, 10.0), od=(1, 0.8, 0.6))
    images = rendered(lit, material)
    by_steps = fitting.fit_maps(images, GBUFFER, lit, material=form, steps=10)
    check_recovered(by_steps, material, least=0.3)
    check_recovered(fitting.fit_maps(images, GBUFFER, lit, material=form), material, least=0.3)


@pytest.mark.slow
def test_fixed_steps_end_where_optimistix_does(rng: np.random.Generator) -> None:
    """With noise, so that neither ends at the truth."""
    lit = scenes()
    images = [i + rng.normal(0, 2e-3, i.shape) for i in rendered(lit, truth(rng))]
    free = {KD: (0.0, None), KS: (0.0, None)}
    by_steps, solved = (
        fitting.fit_maps(images, GBUFFER, lit, steps=steps, bounds=free) for steps in (8, None)
    )
    for name in (KD, KS, N):
        known = by_steps.identified[name] & solved.identified[name]
        assert known.mean() > 0.2
        # Where n is hardly told, the bottom of the valley is flat: k_d may stop a little apart.
        apart = np.abs(by_steps.coefficients[name] - solved.coefficients[name])
        in_errors = (apart / solved.standard_errors[name])[known]
        assert np.quantile(in_errors, 0.99) < 0.02, name
        assert np.max(in_errors) < 0.3, name
        disputed = by_steps.identified[name] != solved.identified[name]
        assert disputed.mean() < 0.03


@pytest.mark.slow
def test_errors_are_those_that_noise_makes(rng: np.random.Generator) -> None:
    """Over many pixels error / standard error has variance 1, and the noise is found."""
    lit, sigma = scenes(48), 1e-3
    material = truth(rng)
    images = [i + rng.normal(0, sigma, i.shape) for i in rendered(lit, material)]
    free = {KD: (None, None), KS: (None, None)}
    maps = fitting.fit_maps(images, GBUFFER, lit, bounds=free)
    nominal = 1e-3 * max(image.max() for image in images)
    # Where even the shininess is known well: an error of 10 % is no longer linear in the noise.
    known = maps.nominal_errors[N] < 0.03 * maps.coefficients[N]
    for name, expected in of(material).items():
        off = (maps.coefficients[name] - expected)[known]
        unit = maps.nominal_errors[name][known] / nominal
        count = known.sum()
        assert count > 200
        # The mean square of n standard normal numbers is 1 within sqrt(2 / n); allow four of these.
        assert abs(np.mean((off / (sigma * unit)) ** 2) - 1) < 4 * np.sqrt(2 / count) + 0.02, name
        own = maps.standard_errors[name] / np.where(known, maps.noise, 1)
        np.testing.assert_allclose(own[known], unit, rtol=1e-3)
    assert abs(np.mean(maps.noise**2) / sigma**2 - 1) < 0.02


def test_a_shininess_that_no_image_tells_is_not_identified(rng: np.random.Generator) -> None:
    """k_s = 0; no highlight in any image; one image; and a pixel that is never used."""
    lit = scenes()
    matte = ds.Material(kd=0.6, specular=ds.Phong(ks=0.0, shininess=20.0))
    maps = fitting.fit_maps(rendered(lit, matte), GBUFFER, lit)
    assert not maps.identified[N].any()
    np.testing.assert_allclose(maps.coefficients[KD][maps.identified[KD]], 0.6, rtol=1e-3)
    assert maps.identified[KD].mean() > 0.95

    # From grazing light a sharp highlight is seen only far from the view's direction.
    grazing = [
        ds.Scene(lights=ds.ParallelLight((x, y, 0.1))) for x in (-1, 1) for y in (-1, 0.2, 1)
    ]
    sharp = ds.Material(kd=0.6, specular=ds.Phong(0.5, 400.0))
    maps = fitting.fit_maps(rendered(grazing, sharp), GBUFFER, grazing)
    towards = np.asarray(GBUFFER.normal.z) > 0.95
    assert towards.sum() > 50
    assert not maps.identified[N][0][towards].any()
    assert maps.identified[KD][0][towards].mean() > 0.5

    one = scenes(1)
    maps = fitting.fit_maps(rendered(one, truth(rng)), GBUFFER, one)
    assert not maps.identified[N].any()
    assert np.isinf(maps.nominal_errors[N]).all()
    assert np.isinf(maps.standard_errors[KD]).all()

    valid = GBUFFER.mask.copy()
    row, column = np.argwhere(valid)[100]
    valid[row, column] = False
    maps = fitting.fit_maps(rendered(lit, matte), GBUFFER, lit, valid=valid, steps=8)
    assert not any(identified[0, 100] for identified in maps.identified.values())
    assert np.isinf(maps.nominal_errors[KD][0, 100])
    assert maps.residual[100] == 0


def test_what_is_masked_does_not_count(rng: np.random.Generator) -> None:
    lit, material = scenes(), truth(rng)
    images = rendered(lit, material)
    valid = [rng.uniform(size=(SIZE, SIZE)) > 0.2 for _ in lit]
    spoilt = [np.where(v[..., None], image, 7.0) for image, v in zip(images, valid, strict=True)]
    spoilt[0][~valid[0]] = np.nan
    maps = fitting.fit_maps(spoilt, GBUFFER, lit, valid=valid, steps=8)
    check_recovered(maps, material, least=0.15)
    unmasked = fitting.fit_maps(spoilt[1:], GBUFFER, lit[1:], steps=8)
    assert unmasked.relative_residual > 0.1


def test_bounds_hold(rng: np.random.Generator) -> None:
    lit = scenes()
    limits = {"kd": (0.3, 0.5), "specular.ks": (0.2, 0.4), "specular.shininess": (5.0, 30.0)}
    for steps in (None, 8):
        maps = fitting.fit_maps(rendered(lit, truth(rng)), GBUFFER, lit, bounds=limits, steps=steps)
        for name, (low, high) in zip((KD, KS, N), limits.values(), strict=True):
            found = maps.coefficients[name]
            assert found.min() >= low * (1 - 1e-6)
            assert found.max() <= high * (1 + 1e-6)


@pytest.mark.slow
def test_each_pixel_agrees_with_a_fit_of_its_own(rng: np.random.Generator) -> None:
    """The pixel's solver and the engine are two programs for one problem."""
    lit = scenes()
    images = [i + rng.normal(0, 1e-3, i.shape) for i in rendered(lit, truth(rng))]
    maps = fitting.fit_maps(images, GBUFFER, lit)
    known = np.flatnonzero(maps.identified[N][0] & (maps.coefficients[KD][0] < 0.99))[::40]
    assert len(known) > 3
    where = np.argwhere(GBUFFER.mask)
    for pixel in known:
        alone = np.zeros((SIZE, SIZE), bool)
        alone[tuple(where[pixel])] = True
        fit = fitting.fit(images, GBUFFER, lit, valid=alone)
        for name in (KD, KS, N):
            error = float(maps.standard_errors[name][0, pixel])
            found = float(np.ravel(fit.coefficients[name])[0])
            assert abs(maps.coefficients[name][0, pixel] - found) < 0.02 * error, name
            np.testing.assert_allclose(np.ravel(fit.standard_errors[name])[0], error, rtol=0.02)


def test_regions_share_a_material() -> None:
    lit = scenes(6)
    rows = np.arange(SIZE)[:, None]
    labels = np.where(rows < 15, 4, np.where(rows < 30, 9, -3)) + np.zeros((1, SIZE), int)
    label = labels[GBUFFER.mask]
    material = ds.Material(
        kd=np.where(label == 4, 0.6, 0.3)[None],
        specular=ds.Phong(
            ks=np.full((1, PIXELS), 0.4), shininess=np.where(label == 4, 12.0, 60)[None]
        ),
    )
    calls: list[tuple[int, int]] = []
    maps = fitting.fit_maps(
        rendered(lit, material),
        GBUFFER,
        lit,
        regions=labels,
        progress=lambda done, total: calls.append((done, total)),
    )
    assert calls == [(1, 3), (2, 3), (3, 3)]
    none = label < 0
    for name, expected in of(material).items():
        np.testing.assert_allclose(maps.coefficients[name][:, ~none], expected[:, ~none], rtol=1e-3)
        assert maps.identified[name][:, ~none].all()
        assert not maps.identified[name][:, none].any()
        assert len(np.unique(maps.coefficients[name][:, label == 9])) == 1
    assert maps.residual[~none].max() < 1e-3
    np.testing.assert_array_equal(maps.residual[none], 1)


def test_all_blocks_share_one_program(rng: np.random.Generator) -> None:
    lit = scenes(8)
    images = rendered(lit, truth(rng))
    fitting.fit_maps(images, GBUFFER, lit, steps=7, block=512)
    before = _program()._cache_size()
    brighter = [image * 1.01 for image in images]
    fitting.fit_maps(brighter, GBUFFER, scenes(8, seed=2), steps=7, block=512)
    assert _program()._cache_size() == before


def test_threads_keep_the_precision_of_their_caller(rng: np.random.Generator) -> None:
    for double in (False, True):
        with jax.enable_x64(double):
            lit = scenes(8)
            sphere = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(16, 16, 2.2))
            material = ds.Material(kd=0.5, specular=ds.Phong(0.3, 10.0))
            images = [np.asarray(ds.render(sphere, scene, material)) for scene in lit]
            maps = fitting.fit_maps(images, sphere, lit, steps=8)
        assert maps.coefficients[N].dtype == (np.float64 if double else np.float32)


def test_bad_input_is_refused_in_one_line(rng: np.random.Generator) -> None:
    lit = scenes(3)
    images = rendered(lit, truth(rng))
    two = ds.Material(kd=0.5, specular=(ds.Phong(0.2, 10.0), ds.Phong(0.2, 90.0)))
    mapped = ds.Material(kd=np.full((1, PIXELS), 0.5), specular=ds.Phong(0.5, 10.0))
    mesh = ds.Mesh(np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], float), np.array([[0, 1, 2]]))
    camera = ds.OrthographicCamera(SIZE, SIZE, 2.2)
    spread = ds.gbuffer(mesh, camera, shading=ds.FlatShading())
    ambient = [ds.Scene(ambient=1.0) for _ in lit]
    coloured = [ds.Scene(lights=ds.ParallelLight((0, 0, 1), (1, 0.5, 0.2))) for _ in lit]
    cases = {
        "one with a shininess": {"material": two},
        "lobes": {"material": ds.Material(kd=0.5)},
        "holds maps": {"material": mapped},
        "at least 1": {"steps": 0},
        "block is 0": {"block": 0},
        "give lower <= upper": {"bounds": {KD: (1.0, 0.0)}},
        "0 < lower": {"bounds": {N: (0.0, 10.0)}},
        "names 'kx'": {"bounds": {"kx": (0, 1)}},
        "whole numbers": {"regions": np.zeros((SIZE, SIZE))},
        "regions has shape": {"regions": np.zeros((3, 3), int)},
    }
    for message, options in cases.items():
        with pytest.raises(ds.BadInput, match=message) as caught:
            fitting.fit_maps(images, GBUFFER, lit, **options)  # type: ignore[arg-type]
        assert "\n" not in str(caught.value)
    with pytest.raises(ds.BadInput, match="PhongShading"):
        fitting.fit_maps(images, spread, lit)
    with pytest.raises(ds.BadInput, match="no scene has a light"):
        fitting.fit_maps(images, GBUFFER, ambient)
    with pytest.raises(ds.BadInput, match="channels"):
        fitting.fit_maps(images, GBUFFER, coloured)
    with pytest.raises(ds.BadInput, match="2 scenes for 3 images"):
        fitting.fit_maps(images, GBUFFER, lit[:2])


def test_planes_have_the_precision_of_the_surface(rng: np.random.Generator) -> None:
    """Planes keep the G-buffer's precision."""
    lit = scenes(8)
    maps = fitting.fit_maps(rendered(lit, truth(rng)), GBUFFER, lit, steps=8)
    dtype = GBUFFER.normal.x.dtype
    assert dtype == (np.float64 if jax.config.jax_enable_x64 else np.float32)
    assert {a.dtype for a in maps.coefficients.values()} == {dtype}
    assert {a.dtype for a in maps.standard_errors.values()} == {dtype}


def test_the_background_does_not_count(rng: np.random.Generator) -> None:
    lit = scenes(8)
    images = [np.array(image) for image in rendered(lit, truth(rng))]
    clean = fitting.fit_maps(images, GBUFFER, lit, steps=8)
    for image in images:
        image[~GBUFFER.mask] = np.nan
    spoilt = fitting.fit_maps(images, GBUFFER, lit, steps=8)
    for name in (KD, KS, N):
        np.testing.assert_array_equal(spoilt.identified[name], clean.identified[name])
        np.testing.assert_array_equal(spoilt.nominal_errors[name], clean.nominal_errors[name])


def test_black_images_tell_nothing() -> None:
    lit = scenes(6)
    maps = fitting.fit_maps([np.zeros((SIZE, SIZE))] * 6, GBUFFER, lit, steps=8)
    assert not any(maps.identified[name].any() for name in (KD, KS, N))
    assert np.isinf(maps.nominal_errors[N]).all()
