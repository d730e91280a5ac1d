"""A ball's circle, found from a mask."""

import numpy as np
import pytest
from capture_files import disc

from diffshade.errors import BadInput
from diffshade.io.circle_from_mask import circle_from_mask

SHAPE = (120, 150)


def error(mask: np.ndarray, *truth: float) -> float:
    return float(np.abs(np.subtract(circle_from_mask(mask), truth)).max())


def test_a_pixelated_disc_gives_its_circle_back() -> None:
    random = np.random.default_rng(7)
    for _ in range(10):
        truth = random.uniform((60, 50, 15), (80, 70, 45))
        assert error(disc(*truth, SHAPE), *truth) < 0.1


def test_a_stand_and_a_hole_do_not_move_it() -> None:
    mask = disc(70.2, 50.6, 40.3, SHAPE)
    mask[85:, 60:80] = True
    mask[40:50, 60:66] = False
    assert error(mask, 70.2, 50.6, 40.3) < 0.15


def test_a_ball_cut_off_by_the_image_still_gives_its_circle() -> None:
    assert error(disc(20.0, 50.0, 40.0, SHAPE), 20.0, 50.0, 40.0) < 0.15


@pytest.mark.parametrize("what", ["square", "ellipse", "everything"])
def test_other_shapes_are_refused(what: str) -> None:
    y, x = np.mgrid[:120, :150]
    mask = {
        "square": (abs(x - 70) < 30) & (abs(y - 60) < 30),
        "ellipse": ((x - 70) / 50) ** 2 + ((y - 60) / 40) ** 2 < 1,
        "everything": np.ones(SHAPE, bool),
    }[what]
    with pytest.raises(BadInput):
        circle_from_mask(mask)
