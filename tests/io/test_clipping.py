"""What counts as clipped, and what only looks like it."""

from pathlib import Path

import numpy as np
from capture_files import HEIGHT, WIDTH, codes, photometric_stereo

from diffshade.io.clipping import clipped, plateau
from diffshade.io.image import write_exr
from diffshade.io.read_capture import read_capture

EVERYWHERE = np.ones((40, 40), bool)


def bump(top: float, quantum: float) -> np.ndarray:
    """A smooth highlight in three channels, rounded as a camera does."""
    y, x = np.mgrid[:40, :40] - 19.3
    smooth = top * np.exp(-(x**2 + y**2) / 200)
    return (np.floor(smooth / quantum) * quantum)[..., None] * np.ones(3)


def test_any_channel_at_098_of_full_scale_clips_a_pixel() -> None:
    pixels = np.array([[[0.9799, 0, 0], [0, 0.98, 0], [0, 0, 1]]])
    assert clipped(pixels, 1.0).tolist() == [[False, True, True]]
    assert clipped(pixels, 0.9).tolist() == [[True, True, True]]
    assert not clipped(pixels, None).any()


def test_a_plateau_below_full_scale_is_found() -> None:
    image = np.minimum(bump(0.95, 1 / 65535), [0.8, 0.7, 1.0])
    found = plateau(image, EVERYWHERE, 1.0)
    assert found is not None
    assert found.level == 0.7
    assert found.pixels == int((image[..., 1] == 0.7).sum())
    assert plateau(image, EVERYWHERE, 0.7) is None  # now it counts as clipped


def test_a_plateau_at_full_scale_is_not_reported() -> None:
    assert plateau(np.minimum(bump(1.5, 1 / 255), 1.0), EVERYWHERE, 1.0) is None


def test_rounding_to_8_bits_makes_no_plateau() -> None:
    for top in np.linspace(0.1, 0.97, 30):
        assert plateau(bump(top, 1 / 255), EVERYWHERE, 1.0) is None


def test_neither_black_nor_constant_images_have_one() -> None:
    assert plateau(np.zeros((40, 40, 3)), EVERYWHERE, 1.0) is None
    assert plateau(np.full((40, 40, 3), 0.5), EVERYWHERE, 1.0) is None
    assert plateau(np.full((40, 40, 3), np.nan), EVERYWHERE, 1.0) is None


def test_a_plateau_is_noted_with_the_level_to_give(tmp_path: Path) -> None:
    image = np.minimum(codes(1), 30000).astype(np.uint16)
    photometric_stereo(tmp_path, {"a.png": image, "b.png": codes(2)})
    capture = read_capture(tmp_path, circle=(8.0, 6.0, 6.0))
    (note,) = [note for note in capture.notes if note.startswith("plateau")]
    assert "in a.png" in note
    assert "--white 0.4578" in note
    assert not capture.clipped[0].any()
    told = read_capture(tmp_path, circle=(8.0, 6.0, 6.0), white=0.4578)
    assert told.clipped[0].sum() > 20
    assert not any(note.startswith("plateau") for note in told.notes)


def test_floating_point_has_no_full_scale_until_it_is_given(tmp_path: Path) -> None:
    image = codes(1).astype(np.float32) / 1000
    image[6, 8, 1] = 90.0
    image[6, 9, 0] = np.nan
    photometric_stereo(tmp_path, {}, filenames_txt="a.exr", light_directions_txt="0 0 1")
    write_exr(tmp_path / "a.exr", image)
    (tmp_path / "light_intensities.txt").unlink()
    capture = read_capture(tmp_path, circle=(8.0, 6.0, 6.0))
    inside = np.asarray(capture.gbuffer.mask)
    assert inside.shape == (HEIGHT, WIDTH)
    assert not capture.clipped[0].any()
    assert np.argwhere(inside & ~capture.valid[0]).tolist() == [[6, 9]]
    assert any("full scale of a.exr is unknown" in note for note in capture.notes)
    assert any("1 pixels of a.exr are not finite" in note for note in capture.notes)
    told = read_capture(tmp_path, circle=(8.0, 6.0, 6.0), white=90.0)
    assert np.argwhere(told.clipped[0]).tolist() == [[6, 8]]
