"""Pictures: what is shown where, at which exposure, in which colour."""

import numpy as np
import pytest

from diffshade import plot
from diffshade.io.encoding import encode_srgb
from diffshade.plot import pictures

SHAPE = (12, 10)
LEFT, MIDDLE, RIGHT = (
    slice(k * (10 + pictures.GAP), k * (10 + pictures.GAP) + 10) for k in range(3)
)


def everywhere() -> np.ndarray:
    return np.ones(SHAPE, bool)


def flat(value: float, channels: int = 3) -> np.ndarray:
    return np.full((*SHAPE, channels), value)


def test_exposure_brings_the_bright_end_to_white(rng: np.random.Generator) -> None:
    image = rng.uniform(0, 0.05, (100, 100, 3))
    image[0, :20] = 7.0  # a highlight: a fifth of a percent
    shown = image * plot.exposure([image], [np.ones((100, 100), bool)])
    assert np.mean(shown.max(axis=-1) > 1) < 0.03
    assert np.quantile(shown, 0.99) > 0.9


def test_exposure_and_scale_look_at_used_pixels_only() -> None:
    image, used = flat(0.5), everywhere()
    image[3], used[3] = 1e6, False
    assert plot.exposure([image], [used]) == 2.0
    assert plot.residual_scale([image], [used]) == 0.5


def test_exposure_and_scale_of_nothing() -> None:
    for used in (everywhere(), ~everywhere()):
        assert plot.exposure([flat(0.0)], [used]) == 1.0
        assert plot.residual_scale([flat(0.0)], [used]) == 1.0


@pytest.mark.parametrize("value", [0.123456, 4567.0, 9.99e-7])
def test_the_scale_can_be_said_in_two_digits(value: float) -> None:
    scale = plot.residual_scale([flat(-value)], [everywhere()])
    assert float(f"{scale:.1e}") == scale
    assert scale == pytest.approx(value, rel=0.05)


@pytest.mark.parametrize(("channels", "value"), [(1, 0.2), (3, 0.2), (2, 0.2), (5, 0.2)])
def test_tone_is_srgb_of_the_exposed_light(channels: int, value: float) -> None:
    shown = plot.tone(flat(value, channels), 2.0)
    assert shown.shape == (*SHAPE, 3)
    np.testing.assert_allclose(shown, encode_srgb(0.4))


def test_tone_of_what_cannot_be_shown() -> None:
    light = np.array([[[np.nan], [np.inf], [-1.0], [5.0]]])
    shown = plot.tone(light)
    np.testing.assert_allclose(shown[0, :, 0], [0, 1, 0, 1])
    assert shown.max() <= 1  # or write_png refuses it


def test_the_colours_of_the_residual() -> None:
    signed = np.array([[-9.0, -2.0, -1.0, 0.0, 1.0, 2.0, 9.0]])
    colours = plot.diverging(signed, 2.0)[0]
    red, blue = colours[:, 0], colours[:, 2]
    np.testing.assert_allclose(colours[3], 0.97)  # white
    assert np.all(blue[:3] > red[:3])
    assert np.all(red[4:] > blue[4:])
    np.testing.assert_array_equal(colours[0], colours[1])
    np.testing.assert_array_equal(colours[5], colours[6])


def test_the_three_panels() -> None:
    observed, predicted = flat(0.5), flat(0.25)
    observed[4, 5] = (0.25, 0.25, 0.0)  # blue is too dark, the others are right
    foreground, used = everywhere(), everywhere()
    foreground[0, 0] = False
    used[0, 0] = used[8, 2] = False
    picture = plot.comparison(observed, predicted, foreground, used, exposure=1.0, scale=0.25)
    assert picture.shape == (12, 3 * 10 + 3 * pictures.GAP + pictures.BAR, 3)
    left, middle, right = (picture[:, part] for part in (LEFT, MIDDLE, RIGHT))
    np.testing.assert_allclose(left[0, 0], encode_srgb(0.5))  # the photograph as it is
    np.testing.assert_allclose(middle[0, 0], pictures.BACKGROUND)
    np.testing.assert_allclose(right[0, 0], pictures.BACKGROUND)
    np.testing.assert_allclose(middle[1, 1], encode_srgb(0.25))
    np.testing.assert_allclose(right[1, 1], pictures.COLOURS[-1])
    np.testing.assert_allclose(right[4, 5], pictures.COLOURS[0])
    assert right[8, 2, 0] in pictures.STRIPES
    np.testing.assert_allclose(picture[0, -1], pictures.COLOURS[-1])  # the bar's ends
    np.testing.assert_allclose(picture[-1, -1], pictures.COLOURS[0])


def test_a_map_of_what_was_left_out() -> None:
    foreground = np.zeros((40, 50), bool)
    foreground[10:20, 10:20] = True
    clipped, broken = np.zeros_like(foreground), np.zeros_like(foreground)
    clipped[12, 11:13] = broken[12, 12] = True
    reasons = {"clipped": clipped, "not finite or not opaque": broken}
    shown = plot.left_out(foreground, reasons)
    assert shown.shape == (16, 16, 3)  # a margin of three pixels
    np.testing.assert_allclose(shown[0, 0], pictures.BACKGROUND)
    np.testing.assert_allclose(shown[3, 3], pictures.USED)
    np.testing.assert_allclose(shown[5, 4], pictures.REASONS["clipped"])
    np.testing.assert_allclose(shown[5, 5], pictures.REASONS["not finite or not opaque"])
    assert len(np.unique(shown.reshape(-1, 3), axis=0)) == 4


def test_a_comparison_is_cropped_to_the_object() -> None:
    big = np.zeros((60, 80), bool)
    big[20:30, 40:45] = True
    light = np.ones((60, 80, 1))
    picture = plot.comparison(light, light, big, big, exposure=1.0, scale=1.0)
    assert picture.shape[:2] == (16, 3 * 11 + 3 * pictures.GAP + pictures.BAR)


def test_a_sheet_is_in_reading_order() -> None:
    shown = [np.full((4, 6, 3), k / 10) for k in range(1, 4)]
    sheet = plot.contact_sheet(shown, columns=2)
    values = [value for value in sheet[:, :, 0].ravel() if value != pictures.BACKGROUND]
    assert list(dict.fromkeys(values)) == [0.1, 0.2, 0.3]
    assert len(values) == 3 * 4 * 6


def test_reduced_and_enlarged() -> None:
    image = np.arange(5 * 7, dtype=float).reshape(5, 7, 1)
    small = plot.reduced(image, 2)
    assert small.shape == (2, 3, 1)
    assert small[1, 2, 0] == image[2:4, 4:6].mean()
    np.testing.assert_array_equal(plot.reduced(image, 1), image)
    large = plot.enlarged(image, 3)
    assert large.shape == (15, 21, 1)
    np.testing.assert_array_equal(plot.reduced(large, 3), image)
