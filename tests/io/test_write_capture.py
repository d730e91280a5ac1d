"""Captures as they are written: the photometric-stereo layout, `.lp` files, and whole ones."""

from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np
import pytest
from capture_files import codes, disc

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.io.image import read_image, write_png
from diffshade.io.lp import parse_lp, write_lp
from diffshade.io.read_capture import read_capture
from diffshade.io.write_capture import write_capture
from diffshade.io.write_photometric_stereo import write_photometric_stereo

IMAGES = [codes(k) / 65535 for k in range(2)]
DIRECTIONS: Any = [(0.0, 0.0, 2.0), (0.3, -0.4, 1.2)]


def test_a_folder_is_read_as_it_was_written(tmp_path: Path) -> None:
    powers: Any = [(0.9, 0.8, 0.7), (1.1, 1.2, 1.3)]
    folder = tmp_path / "new" / "ball"
    mask = disc(8, 6, 4)
    write_photometric_stereo(
        folder, IMAGES, DIRECTIONS, intensities=powers, mask=mask, circle=(8.0, 6.0, 4.5)
    )
    capture = read_capture(folder)
    assert capture.names == ("001.png", "002.png")
    for k in range(2):
        np.testing.assert_allclose(capture.images[k], IMAGES[k] / powers[k], rtol=1e-6)
        unit = np.array(DIRECTIONS[k]) / np.linalg.norm(DIRECTIONS[k])
        np.testing.assert_allclose(capture.scenes[k].lights[0].direction, unit, rtol=1e-6)
    np.testing.assert_array_equal(capture.gbuffer.mask, mask)
    assert any("radius 4.50 about (8.00, 6.00)" in note for note in capture.notes)
    assert read_image(folder / "001.png").bits == 16


def test_normals_come_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(12, 16, 3)) + np.array([0.0, 0.0, 3.0])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    write_photometric_stereo(tmp_path, IMAGES, DIRECTIONS, normals=normals, intensities=[0.5, 2])
    capture = read_capture(tmp_path)
    n = capture.gbuffer.normal
    found = np.asarray(capture.gbuffer.to_image((n.x, n.y, n.z)))
    np.testing.assert_allclose(found, normals, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(capture.images[0], IMAGES[0] / 0.5, rtol=1e-6)
    assert not (tmp_path / "mask.png").exists()


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"images": IMAGES[:1]}, r"directions has shape \(2, 3\) for 1 images"),
        ({"images": []}, "directions has shape"),
        ({"images": [IMAGES[0], IMAGES[1][:5]]}, "all of one shape"),
        ({"directions": [(0, 0, 1), (0, 0, 0)]}, "no length"),
        ({"directions": [(0, 0, 1), (0, np.nan, 0)]}, "NaN"),
        ({"intensities": [1.0, 0.0]}, "not above 0"),
        ({"intensities": [1.0]}, "intensities has shape"),
        ({"mask": np.ones((3, 4))}, "mask has shape"),
        ({"normals": np.ones((12, 16))}, "normals has shape"),
    ],
)
def test_what_does_not_fit_is_refused(changes: Any, told: str, tmp_path: Path) -> None:
    given = {"images": IMAGES, "directions": DIRECTIONS, **changes}
    with pytest.raises(BadInput, match=told):
        write_photometric_stereo(
            tmp_path / "a", given.pop("images"), given.pop("directions"), **given
        )
    assert not (tmp_path / "a").exists()


def test_values_beyond_a_png_leave_no_folder_that_is_whole(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"clip or scale"):
        write_photometric_stereo(tmp_path / "a", [IMAGES[0], 2 * IMAGES[1]], DIRECTIONS)
    assert not (tmp_path / "a" / "filenames.txt").exists()


def test_an_lp_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    for name in ("first one.png", "b.png"):
        (tmp_path / name).write_bytes(b"")
    write_lp(tmp_path / "a.lp", ["first one.png", "b.png"], DIRECTIONS)
    text = (tmp_path / "a.lp").read_text().splitlines()
    assert text[:2] == ["2", "first one.png 0.0 0.0 1.0"]
    found = parse_lp(tmp_path / "a.lp")
    assert found.images == ["first one.png", "b.png"]
    assert found.notes == ()
    expected = np.array(DIRECTIONS) / np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
    np.testing.assert_allclose(found.directions, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("names", "lights", "told"),
    [
        (["a.png"], DIRECTIONS, "2 directions for 1 images"),
        ([], [], "0 directions"),
        (["a\nb.png"], [(0, 0, 1)], "one line"),
        (["a.png"], [(0, 0, 0)], "points nowhere"),
        (["a.png"], [(0, np.nan, 0)], "not finite"),
    ],
)
def test_an_lp_file_that_would_be_none_is_not_written(
    names: Any, lights: Any, told: str, tmp_path: Path
) -> None:
    with pytest.raises(BadInput, match=told):
        write_lp(tmp_path / "a.lp", names, lights)
    assert not list(tmp_path.iterdir())


TOP = """schema = "diffshade.capture/1"
white = 0.75
ambient = [0.5, 0.6, 0.7]
geometry = { kind = "sphere", center = [0.1, 0.0, 0.0], radius = 1.0 }
camera = { kind = "perspective", width = 16, height = 12, fov = 0.5, position = [0, 0, 5] }
"""
LIGHTS = (
    '{ kind = "parallel", direction = [0, 0.1, 2], intensity = 2 }',
    '{ kind = "point", position = [1, 2, 3.5], intensity = [0.9, 0.8, 0.7],'
    ' attenuation = { kind = "quadratic", c0 = 1, c1 = 0.1, c2 = 0.3, reach = 9 } }',
    '{ kind = "point", position = [1, 2, 3.5], intensity = 1,'
    ' attenuation = { kind = "inverse_square" } }',
    '{ kind = "point", position = [1, 2, 3.5], intensity = 1 }',
)


def write_toml(folder: Path, *lights: str, top: str = TOP) -> Path:
    """Two images of one name, each under these lights."""
    text = f"encoding = 1.8\n{top}"
    for k in range(2):
        (folder / f"{k}").mkdir()
        write_png(folder / f"{k}" / "a.png", IMAGES[k], bits=16)
        text += f'[[image]]\nfile = "{k}/a.png"\nlights = [{", ".join(lights)}]\n'
        text += f"exposure = {[[2.0, 0.5, 0.1], 1.5][k]}\n"
    (folder / "capture.toml").write_text(text)
    return folder


def test_a_whole_capture_is_read_as_it_was_written(tmp_path: Path) -> None:
    given = read_capture(write_toml(tmp_path, *LIGHTS))
    write_capture(tmp_path / "new", given)
    capture = read_capture(tmp_path / "new")
    assert capture.names == ("001_a.png", "002_a.png")
    for name in ("images", "valid", "clipped"):
        for ours, theirs in zip(getattr(capture, name), getattr(given, name), strict=True):
            np.testing.assert_array_equal(ours, theirs)
    assert 0 < given.clipped[0].sum() < given.gbuffer.pixel_count
    linear = IMAGES[0].astype(np.float32) ** 1.8 / np.array([2.0, 0.5, 0.1])
    np.testing.assert_allclose(capture.images[0], linear, rtol=1e-5)
    assert eqx.tree_equal(capture.scenes, given.scenes)
    glossy = ds.Material(0.1, 0.5, ds.Phong(0.3, 9.0))
    seen, before = (ds.render(c.gbuffer, c.scenes[0], glossy) for c in (capture, given))
    np.testing.assert_allclose(seen, before, rtol=1e-5)


def test_what_is_to_be_fitted_stays_so(tmp_path: Path) -> None:
    asked = (
        '{ kind = "point", position = [1, 2, 3], intensity = 1, attenuation = { kind = "linear" } }'
    )
    given = read_capture(write_toml(tmp_path, asked))
    write_capture(tmp_path / "new", given)
    assert read_capture(tmp_path / "new").fit_attenuation is given.fit_attenuation is not None


def test_a_light_that_cannot_be_written_leaves_no_folder(tmp_path: Path) -> None:
    spot = '{ kind = "spot", position = [1, 2, 3], direction = [0, 0, -1], intensity = 1 }'
    capture = read_capture(write_toml(tmp_path, spot))
    with pytest.raises(BadInput, match="SpotLight is not written"):
        write_capture(tmp_path / "new", capture)
    assert not (tmp_path / "new").exists()
