"""`diffshade calibrate`: the document, the status, and what it says of bad input."""

import json
from pathlib import Path

import numpy as np
import pytest
from mirror_scenes import degrees, mirror_image, unit
from shared import shared_data

from diffshade.cli import run
from diffshade.io.encoding import Encoding
from diffshade.io.image import write_png

SHAPE, CENTER, RADIUS = (90, 100), np.array([2.5, -3.5, 0.0]), 38.4
LIGHTS = unit(np.array([[0.3, 0.4, 1.0], [-0.5, 0.2, 0.9]]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two photographs, the second named so that letters would put it first, a mask, and notes."""
    path = tmp_path_factory.mktemp("mirror")
    for name, l in zip(("lamp2.png", "lamp10.png"), LIGHTS, strict=True):
        write_png(path / name, mirror_image(SHAPE, CENTER, RADIUS, l), encoding=Encoding.UNKNOWN)
    mask = mirror_image(SHAPE, CENTER, RADIUS, LIGHTS[0])[..., 0] > 0.01
    write_png(path / "mask.png", mask, encoding=Encoding.UNKNOWN)
    (path / "notes.txt").write_text("nothing")
    return path


def test_the_document(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["calibrate", str(folder), "--mask", str(folder / "mask.png"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "diffshade.calibrate/1"
    circle = document["circle"]
    assert circle == pytest.approx({"cx": 52.5, "cy": 48.5, "radius": RADIUS}, abs=0.3)
    assert [light["file"] for light in document["lights"]] == ["lamp2.png", "lamp10.png"]
    found = np.array([light["direction"] for light in document["lights"]])
    assert degrees(found, LIGHTS).max() < 0.5


def test_the_report_and_a_given_circle(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["calibrate", str(folder), "--mask", str(folder / "mask.png")]
    assert run([*words, "--circle", "52.5,48.5,38.4", "--fov", "10"]) == 0
    told = capsys.readouterr().out
    assert "radius 38.40" in told
    assert "lamp10.png" in told


def test_named_files_go_before_what_is_there(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.png").write_bytes((folder / "lamp2.png").read_bytes())
    (tmp_path / "b.png").write_text("no image")
    (tmp_path / "filenames.txt").write_text("a.png\n")
    assert run(["calibrate", str(tmp_path), "--circle", "52.5,48.5,38.4", "--json"]) == 0
    assert [light["file"] for light in json.loads(capsys.readouterr().out)["lights"]] == ["a.png"]


@pytest.mark.parametrize(
    ("words", "status", "told"),
    [
        ("nowhere --mask m.png", 3, "nowhere: there is no such folder"),
        ("{folder} --mask {folder}/none.png", 3, "none.png: there is no such file"),
        ("{folder} --mask {folder}/lamp2.png", 3, "lamp2.png: the mask has no outline"),
        ("{folder}", 3, "give a mask or a circle"),
        ("{folder} --circle 500,500,10", 3, "no pixel lies on the ball"),
        ("{folder} --fov 200", 2, "--fov 200"),
        ("{folder} --mask", 2, "--mask"),
        ("", 2, "FOLDER"),
    ],
)
def test_one_line_says_what_is_wrong(
    folder: Path, words: str, status: int, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["calibrate", *words.format(folder=folder).split()]) == status
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert told in err


def test_the_chrome_sphere_by_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    data = shared_data("uw_psm")
    mask = str(data / "chrome" / "chrome.mask.png")
    assert run(["calibrate", str(data / "chrome"), "--mask", mask, "--json"]) == 0
    lights = json.loads(capsys.readouterr().out)["lights"]
    assert [light["file"] for light in lights] == [f"chrome.{k}.png" for k in range(12)]
    found = np.array([light["direction"] for light in lights])
    assert degrees(found, np.loadtxt(data / "lights_from_chrome.txt")).max() < 0.5
