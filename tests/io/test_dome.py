"""Relight's `.dome` files. The fixture has the shape that `Dome::toJson` of Relight writes."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from capture_files import codes, disc, refusal, write_mask, write_png

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.io.dome import parse_dome, write_dome
from diffshade.io.read_capture import read_capture

RELIGHT = {
    "directions": [
        {"x": 0, "y": 0.6000000238418579, "z": 0.800000011920929},
        {"x": 0.3, "y": -0.2, "z": 1.1},
    ],
    "domeDiameter": 600,
    "imageWidth": 80,
    "label": "the dome",
    "ledAdjust": [],
    "lightConfiguration": "directional",
    "notes": "",
    "positions3d": [{"x": 0, "y": 180, "z": 240}, {"x": -100, "y": 0, "z": 270}],
    "positionsSphere": [{"x": 0, "y": 180, "z": 250}, {"x": 80, "y": -50, "z": 290}],
    "verticalOffset": 10,
}


def dome(folder: Path, **changes: Any) -> Path:
    path = folder / "lights.dome"
    path.write_text(json.dumps({**RELIGHT, **changes}, indent=4))
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two images of a ball; the order of the names is not that of bytes."""
    write_mask(tmp_path / "mask.png", disc(8.0, 6.0, 4.6))
    (tmp_path / "sphere.json").write_text('{"cx": 7.5, "cy": 5.5, "R": 4.0}')
    write_png(tmp_path / "a1.png", codes(1))
    write_png(tmp_path / "B2.PNG", codes(2))
    (tmp_path / "thumbnail.jpg").write_bytes(b"of no account")
    return tmp_path


def test_images_are_sorted_by_name_and_lit_by_directions(folder: Path) -> None:
    capture = read_capture(dome(folder), encoding="linear")
    assert capture.names == ("a1.png", "B2.PNG")
    np.testing.assert_allclose(capture.images[1], codes(2) / 65535, rtol=1e-6)
    first, second = (scene.lights[0] for scene in capture.scenes)
    assert isinstance(first, ds.ParallelLight)
    np.testing.assert_allclose(first.direction, (0, 0.6, 0.8), rtol=1e-6)
    length = np.sqrt(0.3**2 + 0.2**2 + 1.1**2)
    np.testing.assert_allclose(second.direction, np.array([0.3, -0.2, 1.1]) / length, rtol=1e-6)
    assert float(capture.scenes[0].ambient) == 1
    assert any("from a1.png to B2.PNG" in note for note in capture.notes)


def test_led_adjust_multiplies_pixels(folder: Path) -> None:
    """ "multiply pixel value to correct for led differences" (Relight, `dome.h`)."""
    adjust = [{"r": 1, "g": 1, "b": 1}, {"r": 1.5, "g": 0.5, "b": 2}]
    capture = read_capture(dome(folder, ledAdjust=adjust), encoding="linear")
    np.testing.assert_allclose(capture.images[0], codes(1) / 65535, rtol=1e-6)
    np.testing.assert_allclose(
        capture.images[1], codes(2) / 65535 * np.array([1.5, 0.5, 2]), rtol=1e-6
    )


def test_near_lights_by_the_formulas_of_relight(folder: Path) -> None:
    """`ImageSet::relativeLight` and `compensateIntensity`, pixel by pixel, on a surface in z = 0."""
    (folder / "sphere.json").unlink()
    import scipy.io

    normals = np.zeros((12, 16, 3)) + np.array([0.0, 0.0, 1.0])
    scipy.io.savemat(folder / "Normal_gt.mat", {"Normal_gt": normals})
    capture = read_capture(dome(folder, lightConfiguration="lights3d"), encoding="linear")
    lights = np.array([[0, 180, 240], [-100, 0, 270]], float)
    usual = (lights**2).sum(axis=1).mean()
    row, column = np.nonzero(np.asarray(capture.gbuffer.mask))
    size = 80 / 16
    # The centre of a pixel, where Relight has its corner
    pixel = size * np.stack([column + 0.5 - 8, (12 - 1 - row) + 0.5 - 6, 0 * row], axis=-1)
    for k in range(2):
        away = lights[k] - pixel
        square = (away**2).sum(axis=1)
        expected = usual / square * (away[:, 2] / np.sqrt(square))
        image = ds.render(
            capture.gbuffer, ds.Scene(lights=capture.scenes[k].lights), ds.Material(kd=1.0)
        )
        np.testing.assert_allclose(np.asarray(image)[row, column, 0], expected, rtol=1e-5)


def test_a_ball_is_brought_to_the_unit_of_the_lights(folder: Path) -> None:
    capture = read_capture(dome(folder, lightConfiguration="spherical"), encoding="linear")
    light = capture.scenes[0].lights[0]
    assert isinstance(light, ds.PointLight)
    np.testing.assert_allclose(light.position, np.array([0, 180, 250]) / 80, rtol=1e-6)
    place = capture.gbuffer.position
    assert place is not None
    radius = 4.0 / 16
    away = np.sqrt(np.asarray(place.x) ** 2 + np.asarray(place.y) ** 2 + np.asarray(place.z) ** 2)
    np.testing.assert_allclose(away, radius, rtol=1e-5)  # the ball is in the image's centre
    assert float(np.max(np.asarray(place.z))) > 0.9 * radius


def test_a_dome_without_its_positions_has_them_of_its_radius(tmp_path: Path) -> None:
    """`Dome::recomputePositions`."""
    found = parse_dome(dome(tmp_path, lightConfiguration="spherical", positionsSphere=[]))
    np.testing.assert_allclose(found.lights[0] * 80, [0, 180, 250], rtol=1e-6)
    assert found.near


def test_positions_without_a_width_are_in_widths(tmp_path: Path) -> None:
    place = [{"x": 0.5, "y": 0, "z": 2}]
    found = parse_dome(
        dome(tmp_path, imageWidth=0, lightConfiguration="lights3d", positions3d=place)
    )
    np.testing.assert_allclose(found.lights, [[0.5, 0, 2]])


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    lights = np.array([[0, 100, 300], [30, -20, 250.5]])
    adjust = [[1, 1.25, 0.75], [0.5, 1, 1]]
    path = tmp_path / "a.dome"
    write_dome(path, directions=lights, led_adjust=adjust, label="mine")
    far = parse_dome(path)
    np.testing.assert_allclose(
        far.lights, lights / np.linalg.norm(lights, axis=1, keepdims=True), rtol=1e-12
    )
    np.testing.assert_allclose(far.led_adjust, adjust)
    write_dome(path, positions=lights, image_width=50)
    near = parse_dome(path)
    np.testing.assert_allclose(near.lights, lights / 50)
    assert near.near
    assert near.led_adjust is None
    # It has the keys that Relight writes
    assert set(json.loads(path.read_text())) == set(RELIGHT)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({}, "give directions, or else positions"),
        ({"directions": [(0, 0, 1)], "positions": [(0, 0, 1)]}, "give directions, or else"),
        ({"directions": []}, "holds no light"),
        ({"positions": [(0, np.nan, 1)]}, "not finite"),
        ({"positions": [(0, 0, 1)], "led_adjust": [(1, 1, 1)] * 2}, "2 colours for 1 lights"),
    ],
)
def test_what_cannot_be_written_is_refused(given: Any, told: str, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=told):
        write_dome(tmp_path / "a.dome", **given)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"directions": RELIGHT["directions"][:1]}, "1 lights where 2 images"),  # type: ignore[index]
        ({"directions": []}, '"directions" holds no light'),
        ({"directions": [{"x": 0, "y": 0, "z": 0}] * 2}, "points nowhere"),  # as Relight leaves it
        ({"lightConfiguration": "lights3d", "positions3d": []}, '"positions3d" holds no light'),
        ({"ledAdjust": [{"r": 1, "g": 1, "b": 1}]}, "1 colours for 2 lights"),
        ({"ledAdjust": [{"r": 0, "g": 1, "b": 1}] * 2}, "not above 0"),
        ({"lightConfiguration": "lights3d", "imageWidth": 1e-300}, "image widths"),
    ],
)
def test_what_cannot_be_used_is_refused(folder: Path, changes: Any, told: str) -> None:
    path = dome(folder, **changes)
    assert told in refusal(path, encoding="linear")


def test_a_colour_is_none_of_one_channel(folder: Path) -> None:
    for name in ("a1.png", "B2.PNG"):
        write_png(folder / name, codes(1)[..., 0])
    adjust = [{"r": 1, "g": 1, "b": 1}, {"r": 1.5, "g": 0.5, "b": 2}]
    assert "of one channel" in refusal(dome(folder, ledAdjust=adjust), encoding="linear")
    grey = [{"r": 2, "g": 2, "b": 2}] * 2
    found = read_capture(dome(folder, ledAdjust=grey), encoding="linear")
    np.testing.assert_allclose(found.images[0][..., 0], codes(1)[..., 0] / 65535 * 2, rtol=1e-6)
    for name in ("a1.png", "B2.PNG"):
        (folder / name).unlink()
    (folder / "thumbnail.jpg").unlink()
    assert "holds no image" in refusal(dome(folder), names=folder)
