"""The outline of a ball by the model of its edge, on balls of many rays a pixel, and in photographs."""

from functools import cache

import numpy as np
import pytest
from povray import render as povray_render
from povray import requires_povray
from scipy.ndimage import gaussian_filter
from shared import shared_data

from diffshade.io.circle import Circle
from diffshade.io.circle_from_mask import circle_from_mask
from diffshade.io.image import read_image, read_mask
from fitting.calibrate import circle_from_images
from fitting.calibrate.edge import circle_of_edge

TRUE, SHAPE, RAYS = Circle(50.43, 48.21, 40.2), (96, 100), 8
START = Circle(50.6, 48.0, 40.7)
AROUND = np.arange(8) * np.pi / 4


def transmitted(cosine: np.ndarray, n: float = 1.5) -> np.ndarray:
    """What a smooth surface lets through by Fresnel's law: steep at grazing angles."""
    g = np.sqrt(n**2 - 1 + cosine**2)
    across, along = (cosine - g) / (cosine + g), (n**2 * cosine - g) / (n**2 * cosine + g)
    return 1 - (across**2 + along**2) / 2


@cache
def sharp(plastic: bool = False, across: float = 1.0, lit: int = 8) -> np.ndarray:
    """The brightest of `lit` of eight lights all round, 8 x 8 rays a pixel, -1 off the ball.

    Its outline is `TRUE`, or an ellipse that is as high and `across` times as wide.
    """
    y, x = (np.mgrid[: SHAPE[0] * RAYS, : SHAPE[1] * RAYS] + 0.5) / RAYS
    nx, ny = (x - TRUE.cx) / (TRUE.radius * across), (TRUE.cy - y) / TRUE.radius
    nz = np.sqrt((1 - nx**2 - ny**2).clip(0))
    n_dot_l = np.max(
        [nx * np.cos(a) + ny * np.sin(a) + nz for a in AROUND[:lit]], axis=0
    ) / np.sqrt(2)
    shade = n_dot_l.clip(0)
    if plastic:
        shade = shade * transmitted(nz) * transmitted(shade)
    return np.where(nx**2 + ny**2 < 1, shade, -1.0)


def photograph(ball: np.ndarray, blur: float, background: float = 0.015) -> np.ndarray:
    """Blurred by so many pixels, and each pixel the mean of its area."""
    seen = gaussian_filter(np.where(ball < 0, background, ball), blur * RAYS)
    return seen.reshape(SHAPE[0], RAYS, SHAPE[1], RAYS).mean(axis=(1, 3))


def off(found: Circle | None) -> float:
    assert found is not None
    return float(np.abs(np.subtract(found, TRUE)).max())


@pytest.mark.parametrize("blur", [0.1, 0.35, 0.8])
@pytest.mark.parametrize(("plastic", "most"), [(False, 0.03), (True, 0.15)])
def test_the_outline_of_a_blurred_ball(
    plastic: bool, most: float, blur: float, rng: np.random.Generator
) -> None:
    """The steepest logarithm is 0.2 to 0.6 pixels outside the outline, where the ball is matte."""
    image = photograph(sharp(plastic), blur)
    noisy = image * (1 + 0.01 * rng.normal(size=image.shape)) + 0.001 * rng.normal(size=image.shape)
    assert off(circle_of_edge(noisy, START)) < (0.25 if plastic and blur > 0.5 else most)


@pytest.mark.parametrize("background", [0.0, 0.15, 0.9])
def test_any_background(background: float) -> None:
    """Darker than the rim or brighter; as it is the largest value all round if bright, it is uneven."""
    image = photograph(sharp(), 0.4, background)
    image += 0.01 * background * np.sin(np.arange(SHAPE[1]) / 3)
    assert off(circle_of_edge(image, START)) < 0.03


def test_a_stand_and_eight_bits() -> None:
    ball = sharp().copy()
    ball[85 * RAYS :, 40 * RAYS : 60 * RAYS] = 0.4
    image = np.round(255 * photograph(ball, 0.4)) / 255
    assert off(circle_of_edge(image, START)) < 0.03


def test_a_part_of_the_rim_that_no_light_reaches() -> None:
    """Three lights leave a quarter of it dark before black."""
    image = photograph(sharp(lit=3), 0.4, 0.0)
    assert image[round(TRUE.cy + 0.7 * TRUE.radius), round(TRUE.cx - 0.7 * TRUE.radius)] == 0
    assert off(circle_of_edge(image, START)) < 0.03


def test_an_ellipse_counts_as_the_circle_in_its_middle() -> None:
    """As a ball off the axis is seen in perspective: one that is less wide by 0.4 pixels."""
    found = circle_of_edge(photograph(sharp(across=0.99), 0.4), START)
    assert found is not None
    np.testing.assert_allclose(found, [TRUE.cx, TRUE.cy, TRUE.radius * 0.995], atol=0.05)
    assert circle_of_edge(photograph(sharp(across=0.95), 0.4), START) is None


def test_what_shows_no_edge_is_refused(rng: np.random.Generator) -> None:
    """Noise, a blur wider than what is looked at, clipped pixels all round, and a ball of few pixels."""
    image = photograph(sharp(), 0.4)
    assert circle_of_edge(rng.random(SHAPE), START) is None
    assert circle_of_edge(np.zeros(SHAPE), START) is None
    assert circle_of_edge(photograph(sharp(), 2.5), START) is None
    assert circle_of_edge((4 * image).clip(0, 1), START) is None
    assert circle_of_edge(image, START._replace(radius=9.0)) is None
    assert circle_of_edge(image, Circle(500.0, 500.0, 40.0)) is None


def test_it_is_the_outline_of_the_images() -> None:
    image = photograph(sharp(), 0.8)
    assert off(circle_from_images([0.5 * image[..., None], image[..., None]])) < 0.03


@requires_povray
def test_the_outline_of_a_ball_by_pov_ray() -> None:
    """In the same pixels, 8 x 8 rays each, by a renderer that knows nothing of the library."""
    height, width = SHAPE
    center = [TRUE.cx - width / 2, height / 2 - TRUE.cy, 0.0]
    image = povray_render(
        [({"kind": "sphere", "center": center, "radius": TRUE.radius}, {"ka": 0.1, "kd": 0.8})],
        [{"kind": "parallel", "direction": (0.0, 0.0, 1.0), "intensity": 0.9}],
        {
            "kind": "orthographic",
            "width": width * RAYS,
            "height": height * RAYS,
            "extent": float(width),
        },
        ambient=1.0,
    )[..., 0]
    assert off(circle_of_edge(photograph(image, 0.0, 0.0), START)) < 0.03


@pytest.mark.slow
def test_the_ball_of_diligent() -> None:
    """Edge models fitted to each light, channel and sector by itself say 71.45 to 71.60; the circle of
    the normals that are published, 70.75, is not the outline in the photographs."""
    folder = shared_data("diligent_ball")
    names = (folder / "filenames.txt").read_text().split()
    lights = np.loadtxt(folder / "light_intensities.txt")
    images = [read_image(folder / n).values / e for n, e in zip(names, lights, strict=True)]
    assert abs(circle_from_images(images).radius - 71.5) < 0.1


@pytest.mark.slow
def test_the_gray_sphere() -> None:
    """Its mask is as large, but 0.7 pixels left of what the pictures show."""
    folder = shared_data("uw_psm", "gray")
    images = [read_image(folder / f"gray.{k}.png").values for k in range(0, 12, 2)]
    found = circle_from_images(images)
    mask = circle_from_mask(read_mask(folder / "gray.mask.png"))
    assert abs(found.radius - mask.radius) < 0.2
    assert np.hypot(found.cx - mask.cx, found.cy - mask.cy) < 1.0
