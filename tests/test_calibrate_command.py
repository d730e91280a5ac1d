"""`diffshade calibrate`: the document, the status, and what it says of bad input."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mirror_scenes import degrees, mirror_image, unit
from shared import shared_data

from diffshade.cli import run
from diffshade.errors import BadInput
from diffshade.io.encoding import Encoding
from diffshade.io.image import write_png
from diffshade.io.lp import parse_lp
from diffshade.io.read_capture import read_capture
from diffshade.io.write_lights import write_lights

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
    row = next(line for line in told.splitlines() if line.startswith("lamp10.png"))
    assert re.fullmatch(r"lamp10.png( +-?\d\.\d{4}){3} +\d\.\d\d", row), row


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
        ("{folder} --circle 52,48,38 --out lights.csv", 3, "lights.csv: lights are not written"),
        ("{folder} --circle 52,48,38 --out {folder}/no/l.lp", 3, "no does not exist"),
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


def test_the_pasted_lights_are_fitted_with(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A matte ball in place of the mirror: k_d to 1 %, from lights to half a degree."""
    lights = tmp_path / "lights.toml"
    words = ["calibrate", str(folder), "--circle", "52.5,48.5,38.4", "--out", str(lights)]
    assert run(words) == 0
    assert f"written: {lights}" in capsys.readouterr().out
    y, x = np.mgrid[:40, :40] / 20 - 0.975
    hit = x**2 + y**2 < 1
    n = np.stack([x, -y, np.sqrt(np.where(hit, 1 - x**2 - y**2, 0))], axis=-1)
    for name, l in zip(("lamp2.png", "lamp10.png"), LIGHTS, strict=True):
        shade = np.where(hit, 0.6 * (n @ l).clip(0), 0)[..., None]
        write_png(tmp_path / name, shade, bits=16, encoding=Encoding.LINEAR)
    beginning = """schema = "diffshade.capture/1"
geometry = { kind = "sphere", center = [0, 0, 0], radius = 1.0 }
camera = { kind = "orthographic", width = 40, height = 40, extent = 2.0 }
"""
    (tmp_path / "capture.toml").write_text(beginning + lights.read_text(encoding="utf-8"))
    assert run(["fit", str(tmp_path), "--model", "lambert", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["coefficients"]["kd"] == pytest.approx([0.6], rel=0.01)
    assert found["relative_residual"] < 0.01


def test_lights_for_other_readers(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["calibrate", str(folder), "--circle", "52.5,48.5,38.4", "--json", "--out"]
    lights: list[dict[str, Any]] = []
    for name in ("ball.lp", "light_directions.txt"):
        assert run([*words, str(tmp_path / name)]) == 0
        lights = json.loads(capsys.readouterr().out)["lights"]
    expected = [light["direction"] for light in lights]
    for name in ("lamp2.png", "lamp10.png"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    read = parse_lp(tmp_path / "ball.lp")
    assert read.images == ["lamp2.png", "lamp10.png"]
    np.testing.assert_allclose(read.directions, expected, atol=1e-12)
    (tmp_path / "filenames.txt").write_text("lamp2.png\nlamp10.png\n")
    capture = read_capture(tmp_path, circle=(52.5, 48.5, 38.4), encoding="linear")
    found = [np.asarray(scene.lights[0].direction) for scene in capture.scenes]
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_a_name_that_does_not_print_is_not_written(tmp_path: Path) -> None:
    for name in ("a\nb.png", "a\x7f.png", "\udcff.png"):
        with pytest.raises(BadInput, match="rename it"):
            write_lights(tmp_path / "l.toml", [name], LIGHTS[:1])
    quoted = 'a "b" \\ c.png'
    write_lights(tmp_path / "l.toml", [quoted], LIGHTS[:1])
    assert tomllib.loads((tmp_path / "l.toml").read_text())["image"][0]["file"] == quoted


def test_what_is_doubtful_is_noted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A lamp behind the ball, where a pixel is 2 / (38.4 * 0.473) radians; and one in a bright room."""
    behind = mirror_image(SHAPE, CENTER, RADIUS, unit(np.array([0.9, 0.1, -0.6])), spread=0.2)
    front = mirror_image(SHAPE, CENTER, RADIUS, LIGHTS[0], spread=0.1)
    write_png(tmp_path / "a.png", behind, encoding=Encoding.UNKNOWN)
    write_png(tmp_path / "b.png", (front + 0.3).clip(0, 1), encoding=Encoding.UNKNOWN)
    assert run(["calibrate", str(tmp_path), "--circle", "52.5,48.5,38.4"]) == 0
    told = capsys.readouterr().err
    assert "b.png: the highlight is only 3.1 times as bright" in told
    assert "a.png: the light is behind the ball (z below 0)" in told
    assert "a.png: one pixel of the highlight makes 6 degrees" in told


@pytest.mark.parametrize("data", ["uw_psm/gray/gray.mask.png", "psbox/Objects/Image_01.png"])
def test_what_is_no_mirror_ball_is_refused_by_its_name(
    data: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = shared_data(*data.split("/"))
    where = ["--mask", str(file)] if "mask" in data else ["--circle", "215,275,190"]
    assert run(["calibrate", str(file.parent), *where]) == 3
    out, err = capsys.readouterr()
    first = "gray.0.png" if "mask" in data else "Image_01.png"
    assert out == ""
    assert err.startswith(
        f"diffshade: {file.parent / first}: this is no mirror ball under one lamp"
    )


def test_the_chrome_sphere_by_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    data = shared_data("uw_psm")
    mask = str(data / "chrome" / "chrome.mask.png")
    assert run(["calibrate", str(data / "chrome"), "--mask", mask, "--json"]) == 0
    lights = json.loads(capsys.readouterr().out)["lights"]
    assert [light["file"] for light in lights] == [f"chrome.{k}.png" for k in range(12)]
    found = np.array([light["direction"] for light in lights])
    assert degrees(found, np.loadtxt(data / "lights_from_chrome.txt")).max() < 0.5
