"""Directions from a mirror ball: against rays in NumPy, and the photographs of two data sets."""

import numpy as np
import pytest
from mirror_scenes import degrees, mirror_image, unit
from shared import shared_data

from diffshade.errors import BadInput
from diffshade.io.circle import Circle
from diffshade.io.image import read_image, read_mask
from fitting.calibrate import (
    ball_of,
    degrees_per_pixel,
    find_highlight,
    mirror_ball,
    mirrored,
    sphere_of_circle,
)

SHAPE = (120, 140)
CIRCLE = Circle(72.3, 58.6, 50.4)
CENTER = np.array([CIRCLE.cx - SHAPE[1] / 2, SHAPE[0] / 2 - CIRCLE.cy, 0.0])
LIGHTS = unit(np.array([[0.3, 0.4, 1.0], [-0.5, 0.2, 0.9], [0.0, 0.0, 1.0], [1.0, -0.8, 0.2]]))

PSBOX = (
    """-.354310 .069972 -.231485 .347887 .019117 .377425 .267888 .150072
    .323648 -.042205 -.215681 -.188019 .206743 -.239130 -.126778 .207335
    .188762 .183521 .224017 -.312077 -.213533 -.330370 -.131566 -.193409""",
    """-.340993 .075083 -.235288 .354963 .012553 .384830 .263376 .165228
    .319853 -.033436 -.219775 -.166389 .197302 -.227612 -.129872 .213505
    .178775 .203705 .219519 -.301367 -.213272 -.301477 -.139650 -.167014""",
)
"""x and y of the directions that PSBox (Xiong, github.com/yxiong/PSBox, MIT) has in each probe's
`light_directions.txt`, x right, y up, z to the camera."""


@pytest.mark.parametrize(("spread", "bound"), [(0.02, 0.5), (0.06, 0.25)])
def test_directions_from_afar(spread: float, bound: float) -> None:
    """The smaller highlight is a pixel wide, and sampled by rays a fifth of one apart."""
    images = [mirror_image(SHAPE, CENTER, CIRCLE.radius, l, spread=spread) for l in LIGHTS]
    found = mirror_ball(images, circle=CIRCLE)
    assert degrees(found.directions, LIGHTS).max() < bound
    np.testing.assert_allclose(np.linalg.norm(found.points, axis=-1), 1, rtol=1e-6)


def test_directions_in_perspective() -> None:
    """One that takes the ball for far away is wrong by degrees."""
    focal, center = 150.0, np.array([0.6, -0.3, -4.0])
    fov = 2 * np.arctan(SHAPE[0] / 2 / focal)
    mask = mirror_image(SHAPE, center, 1.0, LIGHTS[0], focal=focal)[..., 0] > 0.01
    images = [mirror_image(SHAPE, center, 1.0, l, focal=focal) for l in LIGHTS]
    near, far = mirror_ball(images, mask=mask, fov=fov), mirror_ball(images, mask=mask)
    assert degrees(near.directions, LIGHTS).max() < 1.0
    assert degrees(far.directions, LIGHTS).max() > 5


def test_degrees_per_pixel() -> None:
    """From afar 2 / (R n.v) radians; in perspective, by differences of directions a step apart."""
    across = np.array([0.0, 0.5, -0.9])
    x, y = CIRCLE.cx + 0.6 * CIRCLE.radius * across, CIRCLE.cy + 0.8 * CIRCLE.radius * across
    expected = np.degrees(2 / (CIRCLE.radius * np.sqrt(1 - across**2)))
    found = degrees_per_pixel(*ball_of(CIRCLE, SHAPE), x, y)
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    near, step = sphere_of_circle(CIRCLE, SHAPE, 0.9), 1e-2
    turns = [
        degrees(
            np.asarray(mirrored(*near, x + step * np.cos(a), y + step * np.sin(a))[1], float),
            np.asarray(mirrored(*near, x - step * np.cos(a), y - step * np.sin(a))[1], float),
        )
        / (2 * step)
        for a in np.linspace(0, np.pi, 60)
    ]
    np.testing.assert_allclose(degrees_per_pixel(*near, x, y), np.max(turns, axis=0), rtol=2e-2)


def test_glare_and_a_second_reflection_do_not_move_the_highlight() -> None:
    image = mirror_image(SHAPE, CENTER, CIRCLE.radius, LIGHTS[0], spread=0.2)
    plain = find_highlight(image, CIRCLE)
    row, column = int(plain.y), int(plain.x)
    image[row, column : column + 35] = 1.0
    image[80:84, 90:94] = 1.0
    glared = find_highlight(image, CIRCLE)
    assert np.hypot(glared.x - plain.x, glared.y - plain.y) < 0.3
    assert plain.rival == 0 < glared.rival < 0.3


def test_what_shows_no_highlight_is_refused() -> None:
    with pytest.raises(BadInput, match="no highlight"):
        find_highlight(np.zeros((40, 40, 3)), Circle(20, 20, 10))
    with pytest.raises(BadInput, match="no pixel"):
        find_highlight(np.zeros((40, 40, 3)), Circle(200, 20, 10))


def test_the_chrome_sphere() -> None:
    folder = shared_data("uw_psm")
    images = [read_image(folder / "chrome" / f"chrome.{k}.png").values for k in range(12)]
    found = mirror_ball(images, mask=read_mask(folder / "chrome" / "chrome.mask.png"))
    error = degrees(found.directions, np.loadtxt(folder / "lights_from_chrome.txt"))
    assert error.max() < 0.5, error


@pytest.mark.parametrize("probe", [1, 2])
def test_the_probes_of_psbox(probe: int) -> None:
    """Given their circles, whose y runs upwards from row 0 below the image; the reference is a median
    of pixels at 250 and more, itself some 0.3 degrees off."""
    folder = shared_data("psbox", f"LightProbe-{probe}")
    images = [read_image(folder / f"Image_{k:02d}.JPG").values for k in range(1, 13)]
    x, y, radius = np.loadtxt(folder / "circle_data.txt")
    circle = Circle(x - 0.5, images[0].shape[0] - y + 0.5, radius)
    across = np.array(PSBOX[probe - 1].split(), float).reshape(12, 2)
    reference = np.append(across, np.sqrt(1 - (across**2).sum(-1, keepdims=True)), axis=-1)
    error = degrees(mirror_ball(images, circle=circle).directions, reference)
    assert np.median(error) < 0.5, error
    assert error.max() < 1.5, error
