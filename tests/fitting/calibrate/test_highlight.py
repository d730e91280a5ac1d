"""Which spot on a ball is the lamp, and what is no mirror ball under one lamp: on scenes made in NumPy,
and on photographs of mirrors and of what is none."""

from pathlib import Path

import numpy as np
import pytest
from mirror_scenes import degrees, mirror_image, unit
from shared import shared_data

from diffshade.errors import BadInput
from diffshade.io.circle import Circle
from diffshade.io.circle_from_mask import circle_from_mask
from diffshade.io.image import read_image, read_mask
from fitting.calibrate import find_highlight, mirror_ball

SHAPE = (120, 120)
CIRCLE = Circle(60.0, 60.0, 50.0)
CENTER = np.zeros(3)


def ball(level: float = 0.02) -> np.ndarray:
    return np.full((*SHAPE, 1), level)


def matte(light: tuple[float, ...], gamma: float = 1.0, scale: int = 1) -> np.ndarray:
    """A matte ball that fills the circle, or a larger one, under a distant light."""
    y, x = (np.mgrid[: 120 * scale, : 120 * scale] + 0.5) / (50 * scale) - 1.2
    hit = x**2 + y**2 < 1
    n = np.stack([x, -y, np.sqrt(np.where(hit, 1 - x**2 - y**2, 0))], axis=-1)
    shade = np.where(hit, (n @ unit(np.array(light))).clip(0), 0)
    return shade[..., None] ** gamma


def montage() -> np.ndarray:
    small = mirror_image((60, 60), CENTER, 24.0, np.array([0.3, 0.4, 1.0]), spread=0.1)
    return np.tile(small, (2, 2, 1))


def noisy(rng: np.random.Generator) -> dict[str, np.ndarray]:
    return {
        "uniform": rng.random((*SHAPE, 1)),
        "of a sensor": 0.5 + 0.05 * rng.standard_normal((*SHAPE, 1)),
        "of single photons": rng.poisson(1.0, (*SHAPE, 1)) / 255,
    }


@pytest.mark.parametrize(("level", "rival"), [(0.3, 0.0), (0.8, 1.0)])
def test_a_small_clipped_lamp_goes_before_a_large_dim_reflection(
    level: float, rival: float
) -> None:
    """Nine clipped pixels beside 225; what is above half of the brightness is told of."""
    image = ball()
    image[40:43, 60:63] = 1.0
    image[70:85, 75:90] = level
    found = find_highlight(image, CIRCLE)
    assert (found.x, found.y) == pytest.approx((61.5, 41.5))
    assert found.rival == rival
    assert found.contrast == pytest.approx(50)


def test_a_broad_slope_below_a_narrow_highlight_does_not_draw_it() -> None:
    """As on glossy plastic, whose matte part covers half of the ball; the lamp's spot has 13 pixels."""
    light = unit(np.array([0.0, -0.6, 0.8]))
    narrow = mirror_image(SHAPE, CENTER, CIRCLE.radius, light, spread=0.08)
    found = find_highlight(narrow + 0.2 * matte((0.0, -0.6, 0.8)), CIRCLE)
    plain = find_highlight(narrow, CIRCLE)
    assert np.hypot(found.x - plain.x, found.y - plain.y) < 0.1


def test_a_lamp_behind_the_ball_is_found() -> None:
    light = unit(np.array([0.9, 0.1, -0.5]))
    image = mirror_image(SHAPE, CENTER, CIRCLE.radius, light, spread=0.1)
    found = mirror_ball([image], circle=CIRCLE)
    assert degrees(found.directions, light).max() < 1.0


@pytest.mark.parametrize("half", [10.0, 15.0, 21.0, 24.0, 40.0])
def test_a_lamp_covers_the_share_of_the_ball_that_it_has_of_all_directions(half: float) -> None:
    """To the pixels of its edge, and wherever it is; one beyond 45 degrees across is refused."""
    share = (1 - np.cos(np.radians(half))) / 2
    for light in ([0.0, 0.0, 1.0], [0.7, 0.3, 0.5]):
        image = mirror_image(SHAPE, CENTER, 50.0, np.array(light), spread=np.radians(half))
        assert np.mean(image > 0.5) * 120**2 / (np.pi * 50**2) == pytest.approx(share, rel=0.06)
        if half < 22.5:
            find_highlight(image, CIRCLE)
        else:
            with pytest.raises(BadInput, match="no mirror ball"):
                find_highlight(image, CIRCLE)


@pytest.mark.parametrize("gamma", [1.0, 0.45])
@pytest.mark.parametrize(
    "light", [(0, 0, 1), (0.5, 0.5, 0.7), (0.9, 0, 0.1), (0.9, 0.3, -0.5), (0.7, 0, -0.7)]
)
def test_a_matte_ball_is_refused(light: tuple[float, ...], gamma: float) -> None:
    with pytest.raises(BadInput, match="no mirror ball under one lamp"):
        find_highlight(matte(light, gamma), CIRCLE)


@pytest.mark.parametrize("light", [(0.6, 0, -0.8), (0.44, 0, -0.9)])
def test_a_crescent_at_the_edge_is_refused(light: tuple[float, ...]) -> None:
    """Of a matte ball lit from behind; and of a mirror, whose lamp is cut off there."""
    mirror = mirror_image(SHAPE, CENTER, CIRCLE.radius, np.array([0.44, 0.0, -0.9]), spread=0.2)
    for image in (matte(light), mirror):
        with pytest.raises(BadInput, match="cut off at the edge"):
            find_highlight(image, CIRCLE)


def test_a_wide_clipped_crescent_is_refused() -> None:
    """Whose core is so deep that the pixels at the edge themselves do not count; a streak of glare that
    reaches the edge is not taken for one."""
    image = (8 * matte((0.44, 0, -0.9), scale=8)).clip(0, 1)
    with pytest.raises(BadInput, match="cut off at the edge"):
        find_highlight(image, Circle(480.0, 480.0, 400.0))
    lamp = mirror_image(SHAPE, CENTER, CIRCLE.radius, np.array([0.5, 0.3, 1.0]), spread=0.3)
    plain = find_highlight(lamp, CIRCLE)
    lamp[int(plain.y), int(plain.x) :] = 1.0
    glared = find_highlight(lamp, CIRCLE)
    assert np.hypot(glared.x - plain.x, glared.y - plain.y) < 0.3


@pytest.mark.parametrize("spread", [0.1, 0.3])
def test_a_highlight_that_the_photograph_cuts_is_refused(spread: float) -> None:
    """Small, by its foot, and wide, by its core; a ball that is cut elsewhere serves."""
    image = mirror_image(SHAPE, CENTER, 50.0, np.array([0.7, 0.0, 0.7]), spread=spread)
    whole = find_highlight(image, CIRCLE)
    with pytest.raises(BadInput, match="or of the photograph"):
        find_highlight(image[:, : int(whole.x)], CIRCLE)
    left = find_highlight(image[:, 30:], Circle(30.0, 60.0, 50.0))
    assert (left.x + 30, left.y) == pytest.approx((whole.x, whole.y), abs=0.01)


@pytest.mark.parametrize("spread", [0.1, 0.3])
def test_an_infinite_pixel_of_a_highlight_is_bright_and_one_that_is_nan_is_refused(
    spread: float,
) -> None:
    image = mirror_image(SHAPE, CENTER, 50.0, np.array([0.3, 0.2, 1.0]), spread=spread)
    plain = find_highlight(image, CIRCLE)
    at = int(plain.y), int(plain.x)
    image[at] = np.inf
    found = find_highlight(image, CIRCLE)
    assert np.hypot(found.x - plain.x, found.y - plain.y) < 0.02
    image[10, 60] = np.nan  # beside it
    assert find_highlight(image, CIRCLE) == found
    image[at] = np.nan
    with pytest.raises(BadInput, match="has pixels that are NaN"):
        find_highlight(image, CIRCLE)
    with pytest.raises(BadInput, match="no pixel lies on the ball"):
        find_highlight(np.full_like(image, np.inf), CIRCLE)


@pytest.mark.parametrize("kind", noisy(np.random.default_rng(0)))
def test_noise_is_refused(kind: str, rng: np.random.Generator) -> None:
    with pytest.raises(BadInput, match=r"no lamp stands out|no mirror ball"):
        find_highlight(noisy(rng)[kind], CIRCLE)


def test_a_montage_and_a_slope_are_refused() -> None:
    with pytest.raises(BadInput, match="4 spots are bright, and the largest has 25%"):
        find_highlight(montage(), CIRCLE)
    with pytest.raises(BadInput, match="no mirror ball"):
        find_highlight(np.linspace(0.5, 0.51, 120)[:, None, None] + ball(0.0), CIRCLE)


def test_of_equal_lamps_two_are_told_and_three_refused() -> None:
    """And where none is on, the brightest reflection is one: what GUIDE.md says of them."""
    lights = np.array([[0.0, 0.5, 1.0], [0.5, -0.3, 1.0], [-0.5, -0.3, 1.0]])
    each = [mirror_image(SHAPE, CENTER, CIRCLE.radius, light, spread=0.1) for light in lights]
    assert find_highlight(np.maximum(*each[:2]), CIRCLE).rival > 0.5  # the command notes it
    with pytest.raises(BadInput, match="no lamp stands out"):
        find_highlight(np.maximum.reduce(each), CIRCLE)
    dim = find_highlight(np.minimum(each[0], 0.03), CIRCLE)
    assert dim.contrast == pytest.approx(1.5)


def photographs(folder: Path, pattern: str) -> list[np.ndarray]:
    return [read_image(path).values for path in sorted(folder.glob(pattern))]


def test_the_gray_sphere_is_refused() -> None:
    folder = shared_data("uw_psm", "gray")
    mask = read_mask(folder / "gray.mask.png")
    images = photographs(folder, "gray.?.png") + photographs(folder, "gray.??.png")
    assert len(images) == 6
    for image in images:
        with pytest.raises(BadInput, match="no mirror ball"):
            find_highlight(image, circle_from_mask(mask), mask)


def test_the_cat_of_psbox_is_refused() -> None:
    images = photographs(shared_data("psbox", "Objects"), "*.png")
    assert len(images) == 12
    for image in images:
        with pytest.raises(BadInput, match="no mirror ball"):
            find_highlight(image, Circle(215.0, 275.0, 193.0))


def test_the_glossy_ball_of_diligent() -> None:
    """Its highlights are those of the lamps, of 3 to 23 pixels above half of the brightness. Median 0.5
    and at the most 0.93 degrees from the calibrated lights; as centroids of all that is 5 % above the
    ball's median they were 15 degrees off."""
    folder = shared_data("diligent_ball")
    mask = read_mask(folder / "mask.png")
    found = mirror_ball(photographs(folder, "0*.png"), mask=mask)
    error = degrees(found.directions, np.loadtxt(folder / "light_directions.txt"))
    assert np.median(error) < 0.7, error
    assert error.max() < 1.2, error
    assert 5 < min(h.contrast for h in found.highlights) < 10
