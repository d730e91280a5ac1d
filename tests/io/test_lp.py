"""RTI `.lp` files."""

from pathlib import Path

import numpy as np
import pytest
from capture_files import SRGB, codes, disc, refusal, write_mask, write_png

from diffshade.io.lp import parse_lp
from diffshade.io.read_capture import read_capture

GAMA_1 = b"\x00\x00\x00\x04gAMA\x00\x01\x86\xa0\x31\xe8\x96\x5f"
"""A whole gAMA chunk that says linear."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two linear images of a ball."""
    write_mask(tmp_path / "mask.png", disc(8.0, 6.0, 4.6))
    write_png(tmp_path / "Ball 01.PNG", codes(1), chunk=GAMA_1)
    write_png(tmp_path / "ball_02.png", codes(2), chunk=GAMA_1)
    return tmp_path


def lp(folder: Path, content: str) -> Path:
    path = folder / "ball.lp"
    path.write_bytes(content.encode())
    return path


def test_names_hold_spaces_and_windows_paths_and_any_case(folder: Path) -> None:
    path = lp(
        folder,
        "2\r\n\r\n"
        "C:\\RTI project\\jpeg exports\\ball 01.png\t0.0\t0.6\t0.8\r\n"
        "  some/where/BALL_02.PNG   0 0  1e0 \r\n\r\n",
    )
    capture = read_capture(path)
    assert capture.names == ("Ball 01.PNG", "ball_02.png")
    np.testing.assert_allclose(capture.images[0], codes(1) / 65535, rtol=1e-6)
    np.testing.assert_allclose(capture.scenes[0].lights[0].direction, (0, 0.6, 0.8), rtol=1e-6)
    assert float(capture.scenes[1].ambient) == 1
    assert not any("ball.lp" in note for note in capture.notes)


def test_directions_are_normalised(folder: Path) -> None:
    parsed = parse_lp(lp(folder, "2\nball_02.png 0 30 40\nball_02.png 0 0 1e-3\n"))
    np.testing.assert_allclose(parsed.directions, [(0, 0.6, 0.8), (0, 0, 1)])


def test_names_that_differ_in_case_only_are_told_apart(folder: Path) -> None:
    write_png(folder / "BALL_02.png", codes(3))
    parsed = parse_lp(lp(folder, "2\nball_02.png 0 0 1\nBALL_02.png 0 0 1\n"))
    assert parsed.images == ["ball_02.png", "BALL_02.png"]


@pytest.mark.parametrize("count", ["3\n", ""])
def test_a_wrong_or_absent_count_is_noted(folder: Path, count: str) -> None:
    capture = read_capture(lp(folder, count + "ball_02.png 0 0 1\nBall 01.PNG 0 0 1\n"))
    assert len(capture.images) == 2
    assert any(note.startswith("ball.lp: ") for note in capture.notes)


@pytest.mark.parametrize(
    ("content", "line", "told"),
    [
        ("1\nball_02.png 0 0 1e-9\n", ", line 2: ", "points nowhere"),
        ("1\n\nball_02.png 0 nan 1\n", ", line 3: ", "NaN or infinity"),
        ("1\nball_02.png 0 0 up\n", ", line 2: ", "are not numbers"),
        ("1\nball_02.png 0 1\n", ", line 2: ", "is not 'filename x y z'"),
        ("1\nball_03.png 0 0 1\n", ", line 2: ", "there is no ball_03.png beside it"),
        ("7\n", ": ", "lists no image"),
        ("", ": ", "lists no image"),
    ],
)
def test_what_cannot_be_used_is_refused(folder: Path, content: str, line: str, told: str) -> None:
    path = lp(folder, content)
    assert told in refusal(path, names=f"{path}{line}")


def test_files_say_how_they_are_encoded_or_the_user_does(folder: Path) -> None:
    path = lp(folder, "1\nball_02.png 0 0 1\n")
    write_png(folder / "ball_02.png", codes(2), chunk=SRGB)
    v = codes(2) / 65535
    srgb = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(read_capture(path).images[0], srgb, rtol=1e-5)
    write_png(folder / "ball_02.png", codes(2))
    assert "--encoding" in refusal(path, names=folder / "ball_02.png")
    np.testing.assert_allclose(read_capture(path, encoding=2.0).images[0], v**2, rtol=1e-6)
