"""AliceVision's spheres and lights, in the shape that its writers give them (Boost's property trees)."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.io.alicevision import read_lights, read_spheres, write_lights, write_spheres
from diffshade.io.circle import Circle

SPHERES = """{
    "16498299": [
        {
            "x": "-120.25",
            "y": "35.5",
            "r": "210.5",
            "score": "0.998173",
            "type": "matte"
        }
    ],
    "32996598": [
        {
            "x": "-120",
            "y": "35",
            "r": "211",
            "type": "matte"
        }
    ]
}
"""

LIGHTS = """{
    "lights": [
        {
            "viewId": "16498299",
            "type": "directional",
            "direction": [
                "0.59999999999999998",
                "0",
                "-0.80000000000000004"
            ],
            "intensity": [
                "1",
                "1",
                "1"
            ]
        },
        {
            "viewId": "32996598",
            "type": "directional",
            "direction": [
                "0",
                "-0.600000024",
                "-0.800000012"
            ],
            "intensity": [
                "0.5",
                "0.5",
                "0.5"
            ]
        }
    ]
}
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "a.json"
    path.write_text(text)
    return path


def test_spheres_are_about_the_images_centre(tmp_path: Path) -> None:
    found = read_spheres(written(tmp_path, SPHERES), (3200, 6016))
    assert list(found) == ["16498299", "32996598"]
    assert found["16498299"] == Circle(3008 - 120.25, 1600 + 35.5, 210.5)


def test_lights_are_turned_to_our_axes(tmp_path: Path) -> None:
    """One to the right, and one above: y is down there, and z away from the camera."""
    found = read_lights(written(tmp_path, LIGHTS))
    assert found.views == ("16498299", "32996598")
    np.testing.assert_allclose(found.directions, [(0.6, 0, 0.8), (0, 0.6, 0.8)], rtol=1e-6)
    np.testing.assert_array_equal(found.intensities, [(1, 1, 1), (0.5, 0.5, 0.5)])
    assert found.notes == ()


def test_the_highlight_on_a_mirror_ball_by_alicevisions_formula(tmp_path: Path) -> None:
    """`lightCalibrationOneImage`: 2 (n.v) n - v of the brightest point, written and then read."""
    sphere = Circle(100.0, 80.0, 40.0)
    light = np.array([0.4, 0.5, 0.9]) / np.linalg.norm([0.4, 0.5, 0.9])
    camera = ds.OrthographicCamera(200, 160, 200 / 40)
    mirror = ds.Material(specular=ds.Phong(1.0, 500.0))
    image = np.asarray(
        ds.render(ds.gbuffer(ds.Sphere(), camera), ds.Scene(lights=ds.ParallelLight(light)), mirror)
    )[..., 0]
    row, column = np.unravel_index(image.argmax(), image.shape)
    x, y = column + 0.5 - sphere.cx, row + 0.5 - sphere.cy  # y down
    normal = np.array([x, y, -np.sqrt(sphere.radius**2 - x**2 - y**2)]) / sphere.radius
    view = np.array([0.0, 0.0, -1.0])
    direction = 2 * (normal @ view) * normal - view
    document = json.loads(LIGHTS)
    document["lights"][0]["direction"] = [str(np.float32(d)) for d in direction]
    found = read_lights(written(tmp_path, json.dumps(document))).directions[0]
    assert np.degrees(np.arccos(found @ light)) < 3  # of half a pixel on a ball of 40


def test_spherical_harmonics_keep_their_direction(tmp_path: Path) -> None:
    document = json.loads(LIGHTS)
    document["lights"][0] |= {
        "type": "SH",
        "direction": ["0.6", "0", "-0.8"] + 6 * ["1"],
    }
    for k, light in enumerate(document["lights"]):
        del light["viewId"]
        light["lightId"] = str(k)
    found = read_lights(written(tmp_path, json.dumps(document)))
    np.testing.assert_allclose(found.directions[0], (0.6, 0, 0.8))
    assert found.views == ("0", "1")
    assert found.for_any_scene
    assert "spherical harmonics" in found.notes[0]


def test_what_is_written_is_read_again_and_looks_like_theirs(tmp_path: Path) -> None:
    path = tmp_path / "b.json"
    circles = read_spheres(written(tmp_path, SPHERES), (3200, 6016))
    write_spheres(path, circles, (3200, 6016))
    assert read_spheres(path, (3200, 6016)) == circles
    theirs, ours = json.loads(SPHERES), json.loads(path.read_text())
    assert theirs["32996598"][0].keys() == ours["32996598"][0].keys()
    assert float(ours["16498299"][0]["x"]) == -120.25
    assert isinstance(ours["16498299"][0]["x"], str)

    lights = read_lights(written(tmp_path, LIGHTS))
    write_lights(path, lights.views, lights.directions, lights.intensities)
    again = read_lights(path)
    np.testing.assert_allclose(again.directions, lights.directions, rtol=1e-12)
    np.testing.assert_array_equal(again.intensities, lights.intensities)
    theirs, ours = json.loads(LIGHTS), json.loads(path.read_text())
    assert [list(light) for light in ours["lights"]] == [list(light) for light in theirs["lights"]]
    assert [float(x) for x in ours["lights"][0]["direction"]] == pytest.approx([0.6, 0, -0.8])


@pytest.mark.parametrize(
    ("views", "directions", "intensities", "told"),
    [
        (["1"], [(0, 0, 1), (0, 0, 1)], None, "2 directions"),
        (["1"], [(0, 0, 0)], None, "points nowhere"),
        (["1"], [(0, np.inf, 0)], None, "not finite"),
        (["1"], [(0, 0, 1)], [1.0], "three numbers each"),
    ],
)
def test_lights_that_are_none_are_not_written(
    views: Any, directions: Any, intensities: Any, told: str, tmp_path: Path
) -> None:
    with pytest.raises(BadInput, match=told):
        write_lights(tmp_path / "b.json", views, directions, intensities)
    with pytest.raises(BadInput, match="is no circle"):
        write_spheres(tmp_path / "b.json", {"1": Circle(0, 0, -1)}, (4, 5))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('"viewId": "32996598"', '"viewId": "16498299"', "two lights for one view"),
        ('"type": "directional"', '"type": "point"', "type is 'point'"),
        ('"0.5",\n', '"0.5"]}, {"a": [\n', "intensity is not a list of 3 numbers"),
        ('"-0.600000024"', '"minus"', "holds what is no number"),
        ('"-0.600000024"', '"nan"', "NaN"),
        ('"viewId": "16498299",', "", "neither viewId nor lightId"),
    ],
)
def test_lights_that_cannot_be_used_are_refused(
    old: str, new: str, told: str, tmp_path: Path
) -> None:
    text = LIGHTS.replace(old, new, 1)
    assert text != LIGHTS
    path = written(tmp_path, text)
    with pytest.raises(BadInput, match=told) as refused:
        read_lights(path)
    assert str(refused.value).startswith(f"{path}: ")
