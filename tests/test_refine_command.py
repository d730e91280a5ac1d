"""`diffshade fit` that finds gamma, circle and lights first: what was put in comes back."""

import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import (
    HEAD,
    LIGHTS,
    flat,
    image_entry,
    interrupted,
    light,
    make_capture,
    strict_json,
)
from mirror_scenes import degrees, unit
from shared import shared_data

import diffshade as ds
from diffshade.cli import run
from diffshade.io.circle import Circle, ball_gbuffer
from diffshade.io.write_photometric_stereo import write_photometric_stereo

KA, KD, KS, SHININESS = 0.05, 0.5, 0.3, 20.0
GLOSSY = ds.Material(KA, KD, ds.Phong(KS, SHININESS))
CIRCLE = Circle(20, 20, 17)
TRUE = unit(
    np.array([[0.4, 0.5, 1], [-0.6, 0.1, 1], [0.1, -0.7, 1], [0.0, 0.2, 1], [-0.3, -0.4, 1.0]])
)
TURNED = 2


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_capture(tmp_path_factory.mktemp("capture"))


def write_ball(
    folder: Path,
    directions: np.ndarray,
    *,
    circle: Circle = CIRCLE,
    gamma: float = 1.0,
    material: ds.Material = GLOSSY,
    **more: Any,
) -> Path:
    """A ball under the true lights, of which the folder says other things."""
    rng = np.random.default_rng(1)
    surface = ball_gbuffer(CIRCLE, (40, 40))
    powers = more.get("intensities", np.ones(len(TRUE)))
    images = []
    for l, power in zip(TRUE, powers, strict=True):
        scene = ds.Scene(ambient=power, lights=ds.ParallelLight(l, power))
        image = np.asarray(ds.render(surface, scene, material), float) ** (1 / gamma)
        images.append((image + rng.normal(0, 0.002, image.shape)).clip(0, 1))
    write_photometric_stereo(
        folder, images, directions, circle=tuple(circle), mask=np.asarray(surface.mask), **more
    )
    return folder


def turned(degrees: float) -> np.ndarray:
    """The true directions, but one."""
    lights, angle = TRUE.copy(), np.radians(degrees)
    across = unit(np.cross(TRUE[TURNED], [1.0, 0, 0]))
    lights[TURNED] = np.cos(angle) * TRUE[TURNED] + np.sin(angle) * across
    return lights


def fitted(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    """The document of a fit that goes well."""
    assert run(["fit", *map(str, arguments), "--json"]) == 0
    return strict_json(capsys.readouterr().out)


def check_material(found: dict[str, Any], within: float) -> None:
    lobe = found["coefficients"]["lobes"][0]
    assert found["coefficients"]["ka"] == pytest.approx([KA], abs=within)
    assert found["coefficients"]["kd"] == pytest.approx([KD], abs=within)
    assert lobe["ks"] == pytest.approx([KS], abs=within)
    assert lobe["shininess"] == pytest.approx(SHININESS, rel=5 * within)


def check_evaluated(
    capsys: pytest.CaptureFixture[str], out: Path, document: dict[str, Any]
) -> None:
    """The capture beside the fit has the residuals of the fit."""
    assert run(["evaluate", str(out / "fit.json"), str(out / "capture"), "--json"]) == 0
    again = strict_json(capsys.readouterr().out)
    for key in ("relative_residual", "fraction_excluded", "per_image"):
        assert flat(again[key]) == pytest.approx(flat(document[key]), rel=1e-5)


@pytest.mark.slow
def test_a_capture_of_somebody_is_never_touched(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = write_ball(tmp_path / "capture", TRUE)
    before = {path.name: path.read_bytes() for path in given.iterdir()}
    assert run(["fit", str(given), "--refine-lights", "--out", str(tmp_path)]) == 3
    told = capsys.readouterr().err
    assert told.startswith(f"diffshade: {given}: is there already, and not of an earlier fit")
    for _ in range(2):  # the second finds the fit of the first
        fitted(capsys, given, "--out", tmp_path)
    assert {path.name: path.read_bytes() for path in given.iterdir()} == before


def test_the_lamp_that_was_turned_is_named_and_the_material_comes_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    given, out = write_ball(tmp_path / "ball", turned(3.0)), tmp_path / "out"
    wrong = fitted(capsys, given)
    found = fitted(capsys, given, "--refine-lights", "--out", out)
    lights = found["lights"]
    rows = lights["per_image"]
    assert lights["converged"]
    assert lights["before"] == pytest.approx(wrong["relative_residual"], rel=0.1)
    assert lights["relative_residual"] == pytest.approx(found["relative_residual"], rel=0.01)
    assert found["relative_residual"] < 0.5 * wrong["relative_residual"]
    assert [row["file"] for row in rows if row["moved"]] == ["003.png"]
    assert rows[TURNED]["degrees"] == pytest.approx(3.0, abs=4 * rows[TURNED]["standard_error"])
    error = degrees(np.array([row["direction"] for row in rows]), TRUE)
    assert (error < 4 * np.array([row["standard_error"] for row in rows])).all()
    assert [row["gain"] for row in rows] == pytest.approx([1.0] * 5, abs=1e-3)
    check_material(found, 2e-3)
    check_evaluated(capsys, out, found)
    report, page = ((out / name).read_text() for name in ("report.txt", "report.html"))
    assert "003.png: its light is 3.0 +- " in report
    assert "the lamp of 003.png has moved" in page

    # A later fit that refines nothing takes that capture away with the pictures.
    fitted(capsys, given, "--out", out)
    assert not (out / "capture").exists()

    # What is interrupted at its first file leaves no folder.
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run(["fit", str(given), "--refine-lights", "--out", str(tmp_path / "new" / "fit")])
    assert not (tmp_path / "new").exists()

    # The circle goes before the lights, which follow a wrong one: no lamp stands out then.
    given = write_ball(tmp_path / "wrong", turned(3.0), circle=Circle(20.3, 19.8, 17.4))
    rows = fitted(capsys, given, "--refine-lights")["lights"]["per_image"]
    assert not any(row["moved"] for row in rows)
    found = fitted(capsys, given, "--refine-lights", "--refine-circle", "--out", out)
    moved = [row["file"] for row in found["lights"]["per_image"] if row["moved"]]
    assert moved == ["003.png"]
    check_material(found, 6e-3)
    check_evaluated(capsys, out, found)


@pytest.mark.slow
def test_an_unknown_gamma_is_found_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = write_ball(
        tmp_path / "ball",
        TRUE,
        gamma=1.8,
        material=ds.Material(KA, KD),
        intensities=np.array([0.9, 0.7, 0.8, 0.6, 1.1]),
    )
    out = tmp_path / "out"
    found = fitted(capsys, given, "--model", "lambert", "--fit-gamma", "--out", out)
    response = found["response"]
    assert response["converged"]
    low, high = response["interval"]
    assert low < 1.8 < high
    assert high - low < 0.1
    assert response["gamma"] == pytest.approx(1.8, abs=0.02)
    assert found["coefficients"]["kd"] == pytest.approx([KD], rel=0.01)
    check_evaluated(capsys, out, found)
    assert f"encoding = {response['gamma']!r}" in (out / "capture" / "capture.toml").read_text()
    told = (
        f"gamma found by the shading: {response['gamma']:.3f} +- {response['standard_error']:.3f}"
    )
    assert told in (out / "report.txt").read_text()


@pytest.mark.slow
def test_the_lamp_of_the_gray_sphere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its photographs under the chrome sphere's lights: the lamp of image 2 moved in between."""
    course = shared_data("uw_psm")
    names = [f"gray.{k}.png" for k in (0, 2, 4, 6, 8, 10)]
    for name in names:
        shutil.copy(course / "gray" / name, tmp_path)
    shutil.copy(course / "gray" / "gray.mask.png", tmp_path / "mask.png")
    lights = np.loadtxt(course / "lights_from_chrome.txt")[::2]
    np.savetxt(tmp_path / "light_directions.txt", lights)
    (tmp_path / "filenames.txt").write_text("\n".join(names))
    found = fitted(capsys, tmp_path, "--model", "lambert", "--refine-lights")
    rows = found["lights"]["per_image"]
    assert [row["file"] for row in rows if row["moved"]] == ["gray.2.png"]
    assert 5 < rows[1]["degrees"] < 8
    assert found["lights"]["before"] > 0.065
    assert found["relative_residual"] < 0.06


POINT = '{ kind = "point", position = [2, 2, 5], intensity = 1.0 }'

AROUND = '{ kind = "environment", harmonics = [0.8, 0.1, 0.2, 0.1] }'
LEAVE = (
    "(EnvironmentLight) where --refine-lights turns the one parallel light of an image: leave it out, or"
    " leave out --refine-lights"
)
ASKED = POINT.replace(" }", ', attenuation = { kind = "quadratic" } }')


@pytest.mark.parametrize(
    ("lights", "options", "status", "told"),
    [
        ([POINT] * 2, "--refine-lights", 3, "fitting.calibrate.refine_near_lights"),
        ([light(LIGHTS[0])], "--refine-lights", 3, "of one image"),
        ([light(LIGHTS[0]), AROUND], "--refine-lights", 3, f"toml: 1.png: has 1 lights {LEAVE}"),
        ([light(LIGHTS[0]), ""], "--refine-lights", 3, "toml: 1.png: has 0 lights (none)"),
        ([light(LIGHTS[0])], "--refine-circle", 3, "not made of a circle"),
        ([light(LIGHTS[0])], "--refine-lights --model auto", 2, "--refine-lights: is by one"),
        ([POINT, light(LIGHTS[0])], "--fit-gamma", 3, "different kinds or numbers of lights"),
        ([ASKED] * 2, "--fit-gamma", 3, "its attenuation is to be fitted"),
        ([light(LIGHTS[0])], "--fit-gamma --model auto", 2, "--fit-gamma: is by one"),
        ([light(LIGHTS[0])], "--fit-gamma --encoding 2.2", 2, "--encoding states"),
        pytest.param(
            [light((0, 0, -1))] * 2,
            "--fit-gamma --model lambert",
            3,
            "do not tell the gamma",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_what_is_refused(
    lights: list[str],
    options: str,
    status: int,
    told: str,
    capture: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    entries = (image_entry(f"{k}.png", one) for k, one in enumerate(lights))
    (capture / "other.toml").write_text(HEAD + "".join(entries))
    assert run(["fit", str(capture / "other.toml"), *options.split()]) == status
    output = capsys.readouterr()
    assert told in output.err
    assert output.err.count("\n") == 1
    assert output.out == ""
