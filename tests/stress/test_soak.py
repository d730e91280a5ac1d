"""A few fits of many sizes in one process, and that what grows is seen."""

import pytest
from stress.soak import Stretch, soak, steady


@pytest.mark.slow
def test_two_dozen_fits_are_right() -> None:
    pytest.importorskip("resource", reason="tells of memory on Unix alone")
    first, second = soak(12, 2, seed=3)
    assert first.right + second.right >= 23
    assert second.compilations <= first.compilations


def test_what_is_not_steady_is_seen() -> None:
    flat = [Stretch(100, 100, 40 * (k == 0), 500.0, 0.02) for k in range(10)]
    assert steady(flat) == []
    for change in (
        {"peak": 520.0},
        {"compilations": 2},
        {"seconds": 0.03},
        {"right": 80},
    ):
        assert len(steady([*flat[:-1], flat[-1]._replace(**change)])) == 1, change
