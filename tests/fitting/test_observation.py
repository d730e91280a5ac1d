"""Pages and samples: all that was observed is counted once, whatever the size of a page."""

import jax
import numpy as np
import pytest
from compilations import compilations

import diffshade as ds
import fitting
from diffshade.buckets import bucket
from fitting import observation
from fitting.inputs import match
from fitting.observation import Stack, stacks

SIZE = 96
GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(SIZE, SIZE, 2.2))
SCENES = [ds.Scene(ambient=0.5, lights=ds.PointLight((x, 0.5, 2.5), 1.2)) for x in (-1.0, 0.0, 1.0)]
TRUTH = ds.Material(ka=0.1, kd=(0.6, 0.4, 0.2), specular=ds.Phong(ks=0.3, shininess=25.0))


def images(rng: np.random.Generator) -> list[np.ndarray]:
    exact = (np.asarray(ds.render(GBUFFER, scene, TRUTH)) for scene in SCENES)
    return [image + rng.normal(0, 0.01, image.shape).astype(image.dtype) for image in exact]


def stack_of(pictures: list[np.ndarray], valid: list[np.ndarray] | None = None) -> Stack:
    (stack,), _ = stacks(match(pictures, GBUFFER, SCENES, valid), fitted_law=False)
    return stack


def test_many_pages_are_one(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    observed = images(rng)
    valid = [rng.uniform(size=(SIZE, SIZE)) < 0.8 for _ in SCENES]
    whole = fitting.fit(observed, GBUFFER, SCENES, valid=valid)
    monkeypatch.setattr(observation, "PAGE", 3000)
    assert len(list(stack_of(observed, valid).pages(1))) > 5
    paged = fitting.fit(observed, GBUFFER, SCENES, valid=valid)
    for name, value in whole.coefficients.items():
        np.testing.assert_allclose(paged.coefficients[name], value, rtol=1e-9)
    np.testing.assert_allclose(paged.relative_residual, whole.relative_residual, rtol=1e-12)


def test_pages_hold_every_used_pixel_once(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    observed = images(rng)
    valid = [rng.uniform(size=(SIZE, SIZE)) < 0.3 for _ in SCENES]
    monkeypatch.setattr(observation, "PAGE", 3000)
    pages = list(stack_of(observed, valid).pages(1))
    used = sum(float(page.weight.sum()) for page in pages)
    assert used == sum(np.count_nonzero(mask & GBUFFER.mask) for mask in valid)
    square = sum(float(np.sum(page.weight[:, None] * page.observed**2)) for page in pages)
    expected = sum(
        float(np.sum(image[mask & GBUFFER.mask] ** 2))
        for image, mask in zip(observed, valid, strict=True)
    )
    np.testing.assert_allclose(square, expected, rtol=1e-5)


def test_a_sample_has_the_brightest_points_when_asked(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    observed = images(rng)
    row, column = SIZE // 2, SIZE // 2
    observed[1][row, column] = 50
    monkeypatch.setattr(observation, "SAMPLE", 64)
    stack = stack_of(observed)
    assert stack.sample(bright=True).observed.max() == 50
    fair = stack.sample(bright=False)
    assert fair.fair == 64
    assert fair.observed.shape[-1] == 64


@pytest.mark.slow
def test_sizes_share_programs() -> None:
    """A hundred fits compile no more than one set of programs a bucket."""
    scene = ds.Scene(lights=ds.ParallelLight((0.3, 0.4, 1.0)))
    truth = ds.Material(kd=0.5, specular=ds.Phong(ks=0.5, shininess=20.0))

    def fitted(width: int, height: int) -> int:
        gbuffer = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(width, height, 2.2))
        image = np.asarray(ds.render(gbuffer, scene, truth))
        with compilations() as compiled:
            fitting.fit(image, gbuffer, scene)
        programs.append(len(compiled))
        return bucket(gbuffer.pixel_count)

    programs: list[int] = []
    once = len({fitted(60, 60)})
    first = programs.pop()
    ladder = {fitted(60 + k % 10, 60 + k // 10) for k in range(100)}
    assert once == 1
    assert sum(programs) <= first * (len(ladder) - 1)


def test_a_highlight_that_no_fair_sample_meets() -> None:
    """A lobe of a few pixels in a large image is found by the brightest points."""
    gbuffer = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(512, 512, 2.2))
    scene = ds.Scene(lights=ds.ParallelLight((0.3, 0.4, 1.0)))
    truth = ds.Material(kd=0.5, specular=ds.Phong(ks=0.5, shininess=20_000.0))
    fit = fitting.fit(np.asarray(ds.render(gbuffer, scene, truth)), gbuffer, scene)
    allowed = 1e-6 if jax.config.jax_enable_x64 else 1e-3
    np.testing.assert_allclose(fit.coefficients["specular.0.shininess"], 20_000, rtol=allowed)
    np.testing.assert_allclose(fit.coefficients["specular.0.ks"], 0.5, rtol=allowed)


def test_a_sample_of_more_images_than_it_has_points(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    observed = images(rng)
    observed[-1][SIZE // 2, SIZE // 2] = 50
    monkeypatch.setattr(observation, "SAMPLES", 12)
    monkeypatch.setattr(observation, "FEWEST", 2)
    assert stack_of(observed).sample(bright=True).observed.max() == 50
