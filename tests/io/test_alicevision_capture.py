"""A capture of AliceVision: `lights.json`, the scene of `CameraInit` and photographs, as its writers
(`lightingCalibration.cpp`, `sfmDataIO/jsonIO.cpp`) give them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from capture_files import codes, disc, refusal, write_mask, write_png

from diffshade.io.read_capture import read_capture

LIGHTS = """{
    "lights": [
        {
            "viewId": "32996598",
            "type": "directional",
            "direction": ["0.600000024", "0", "-0.800000012"],
            "intensity": ["0.5", "0.5", "0.5"]
        },
        {
            "viewId": "16498299",
            "type": "directional",
            "direction": ["0", "-0.600000024", "-0.800000012"],
            "intensity": ["2", "2", "2"]
        }
    ]
}
"""
SFM = """{
    "version": ["1", "2", "8"],
    "views": [
        {
            "viewId": "16498299",
            "poseId": "16498299",
            "frameId": "1",
            "intrinsicId": "2208274417",
            "path": "C:/shots/ps_owl/IMG_0001.PNG",
            "width": "16",
            "height": "12",
            "metadata": {"Exif:DateTimeDigitized": "2024:05:02 10:00:09", "Make": "Canon"}
        },
        {
            "viewId": "32996598",
            "poseId": "16498299",
            "frameId": "2",
            "intrinsicId": "2208274417",
            "path": "C:/shots/ps_owl/IMG_0002.PNG",
            "width": "16",
            "height": "12",
            "metadata": {"Exif:DateTimeDigitized": "2024:05:02 10:00:03", "Make": "Canon"}
        },
        {
            "viewId": "55598213",
            "poseId": "16498299",
            "intrinsicId": "2208274417",
            "path": "C:/shots/ps_owl/IMG_Ambient.PNG",
            "width": "16",
            "height": "12",
            "metadata": {"Exif:DateTimeDigitized": "2024:05:02 10:00:00", "Make": "Canon"}
        }
    ],
    "intrinsics": [{"intrinsicId": "2208274417", "width": "16", "height": "12", "type": "pinhole"}]
}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_png(tmp_path / "img_0001.png", codes(1))
    write_png(tmp_path / "img_0002.png", codes(2))
    write_mask(tmp_path / "mask.png", disc(8.0, 6.0, 4.6))
    (tmp_path / "sphere.json").write_text('{"cx": 7.5, "cy": 5.5, "R": 4.0}')
    (tmp_path / "lights.json").write_text(LIGHTS)
    (tmp_path / "cameraInit.sfm").write_text(SFM)
    return tmp_path


def read(folder: Path, **options: Any) -> Any:
    return read_capture(folder / "lights.json", encoding="linear", **options)


def test_lights_go_to_the_photographs_of_their_views(folder: Path) -> None:
    capture = read(folder)
    assert capture.names == ("img_0001.png", "img_0002.png")
    directions = [scene.lights[0].direction for scene in capture.scenes]
    np.testing.assert_allclose(directions, [(0, 0.6, 0.8), (0.6, 0, 0.8)], atol=1e-6)
    np.testing.assert_allclose(capture.images[0], codes(1) / 65535 / 2, rtol=1e-6)
    np.testing.assert_allclose(capture.images[1], codes(2) / 65535 / 0.5, rtol=1e-6)
    assert "IMG_Ambient.PNG: shows ambient light alone: left out" in capture.notes


def test_it_is_the_capture_of_the_same_folder_in_the_other_layout(
    folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The pixels that a fit sees and the lights are those of DiLiGenT's layout, written apart."""
    other = tmp_path_factory.mktemp("ps")
    for name in ("img_0001.png", "img_0002.png", "mask.png", "sphere.json"):
        (other / name).write_bytes((folder / name).read_bytes())
    (other / "filenames.txt").write_text("img_0001.png\nimg_0002.png\n")
    (other / "light_directions.txt").write_text("0 0.6 0.8\n0.6 0 0.8\n")
    (other / "light_intensities.txt").write_text("2 2 2\n0.5 0.5 0.5\n")
    theirs, ours = read_capture(other), read(folder)
    for a, b in zip(theirs.images, ours.images, strict=True):
        np.testing.assert_array_equal(a, b)
    for a, b in zip(theirs.scenes, ours.scenes, strict=True):
        np.testing.assert_allclose(a.lights[0].direction, b.lights[0].direction, atol=1e-7)
    assert theirs.circle == ours.circle


def test_a_model_goes_to_the_views_by_the_time_they_were_taken(folder: Path) -> None:
    """ "saveAsModel": a lightId counts the lights; AliceVision sorts views by Exif:DateTimeDigitized."""
    document = json.loads(LIGHTS)
    for k, light in enumerate(document["lights"]):
        del light["viewId"]
        light["lightId"] = str(k)
    (folder / "lights.json").write_text(json.dumps(document))
    capture = read(folder)
    assert capture.names == ("img_0002.png", "img_0001.png")
    np.testing.assert_allclose(capture.scenes[0].lights[0].direction, (0.6, 0, 0.8), atol=1e-6)
    assert any("by the time they were taken" in note for note in capture.notes)
    scene = SFM.replace("Exif:DateTimeDigitized", "DateTime")
    (folder / "cameraInit.sfm").write_text(scene)
    assert read(folder).names == ("img_0001.png", "img_0002.png"), "else by path"
    (folder / "cameraInit.sfm").write_text(SFM.replace("Ambient", "0003"))
    told = refusal(folder / "lights.json", encoding="linear")
    assert "a model of 2 lights where cameraInit.sfm has 3 views" in told


def test_normals_of_alicevision_are_turned_to_our_axes(folder: Path) -> None:
    """Towards the camera is z = -1 there, and outside the mask there is NaN."""
    normals = np.full((12, 16, 3), np.nan, np.float32)
    normals[2:10, 3:12] = (0.48, -0.6, -0.64)
    OpenEXR.File(
        {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, {"RGB": normals}
    ).write(str(folder / "normals.exr"))
    assert "sphere.json" in " ".join(read(folder).notes), "a stated ball goes before it"
    (folder / "sphere.json").unlink()
    capture = read(folder)
    assert "geometry from AliceVision's normals.exr" in capture.notes
    n = capture.gbuffer.normal
    np.testing.assert_allclose([n.x.min(), n.y.max(), n.z.max()], (0.48, 0.6, 0.64), rtol=1e-6)
    assert not np.asarray(capture.gbuffer.mask)[:, :3].any()
    write_png(folder / "img_0001.png", codes(1)[:6])
    write_png(folder / "img_0002.png", codes(2)[:6])
    told = refusal(folder / "lights.json", names=folder / "normals.exr", encoding="linear")
    assert "both must have one size" in told


def test_a_view_without_a_light_is_left_out(folder: Path) -> None:
    (folder / "lights.json").write_text(LIGHTS.replace("16498299", "77"))
    capture = read(folder)
    assert capture.names == ("img_0002.png",)
    assert "IMG_0001.PNG: lights.json has no light for it: left out" in capture.notes
    assert "1 lights of lights.json have no view in cameraInit.sfm: passed over" in capture.notes


def test_intensities_of_display_referred_photographs_are_doubted(folder: Path) -> None:
    def warned(encoding: str) -> bool:
        notes = read_capture(folder / "lights.json", encoding=encoding).notes
        return any("values as encoded" in note for note in notes)

    assert warned("srgb")
    assert not warned("linear")


@pytest.mark.parametrize(
    ("file", "old", "new", "names", "told"),
    [
        (
            "cameraInit.sfm",
            "/IMG_0002.PNG",
            "/IMG_9.PNG",
            "cameraInit.sfm",
            "there is no IMG_9.PNG",
        ),
        ("cameraInit.sfm", '"views"', '"shots"', "cameraInit.sfm", '"views" is missing'),
        (
            "cameraInit.sfm",
            '"viewId": "32996598"',
            '"viewId": []',
            "cameraInit.sfm",
            "viewId is not",
        ),
        ("cameraInit.sfm", "32996598", "16498299", "cameraInit.sfm", "has a view twice"),
        (
            "cameraInit.sfm",
            '"poseId": "16498299",\n            "frameId": "2"',
            '"poseId": "2"',
            "cameraInit.sfm",
            "are of 2 poses",
        ),
        ("lights.json", '"viewId": "1', '"lightId": "1', "lights.json", "others with a lightId"),
    ],
)
def test_what_cannot_be_a_capture_is_refused(
    file: str, old: str, new: str, names: str, told: str, folder: Path
) -> None:
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new, 1))
    assert told in refusal(folder / "lights.json", names=folder / names, encoding="linear")


def test_the_scene_has_to_be_there_once(folder: Path) -> None:
    (folder / "sfm.sfm").write_text(SFM)
    assert "several scenes lie beside it" in refusal(folder / "lights.json")
    (folder / "sfm.sfm").unlink()
    (folder / "cameraInit.sfm").unlink()
    assert "no scene lies beside it" in refusal(folder / "lights.json")
    assert "it holds lights.json: give that file" in refusal(folder)


def test_a_fit_is_no_capture(folder: Path) -> None:
    path = folder / "fit.json"
    path.write_text('{"schema": "diffshade.fit/1", "lights": {"before": 0.1, "per_image": []}}')
    assert "this is a fit, not a capture" in refusal(path)


def test_other_lights_than_those_of_the_scene_are_refused(folder: Path) -> None:
    other = LIGHTS.replace("16498299", "1").replace("32996598", "2")
    (folder / "lights.json").write_text(other)
    assert "none of its views is in cameraInit.sfm" in refusal(folder / "lights.json")
