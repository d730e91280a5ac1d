"""The command line as a user meets it: results and files."""

import os
import re
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from command_line import (
    KA,
    KD,
    KS,
    SHININESS,
    SIZE,
    flat,
    interrupted,
    make_capture,
    program,
    scene,
    shape,
    strict_json,
)
from shared import shared_data

from diffshade.cli import run
from diffshade.io.image import read_image
from diffshade.plot.pictures import BAR, GAP


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A folder for compiled programs, so that tests leave none in the user's."""
    return str(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_capture(tmp_path_factory.mktemp("capture"))


@pytest.fixture(scope="module")
def results(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `fit --out` writes for it."""
    folder = tmp_path_factory.mktemp("results") / "new" / "folder"
    told = StringIO()
    with redirect_stdout(told):
        assert run(["fit", str(capture), "--out", str(folder)]) == 0
    assert told.getvalue().splitlines()[-1] == (
        f"written into {folder}: report.html, report.txt, fit.json, comparison_1.png, comparison_2.png"
    )
    return folder


# Render


@pytest.mark.parametrize("suffix", [".png", ".exr", ".npy"])
def test_render_writes_the_three_formats(suffix: str, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(scene((0, 0, 1)))
    out = tmp_path / f"image{suffix}"
    assert run(["render", str(tmp_path / "scene.toml"), "--out", str(out)]) == 0
    values = np.load(out) if suffix == ".npy" else read_image(out).values
    assert values.shape == (SIZE, SIZE, 3)
    assert values[SIZE // 2, SIZE // 2, 0] > 0.8
    assert values[0, 0].max() == 0


def test_render_says_where_a_png_is_too_narrow_to_hold_the_light(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scene.toml").write_text(scene((0, 0, 1), ambient="20.0"))
    arguments = ["render", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "image.png")]
    assert run(arguments) == 0
    assert "brighter than 1" in capsys.readouterr().err


@pytest.mark.parametrize("out", ["image.jpg", "absent/image.png"])
def test_render_refuses_what_it_cannot_write(
    out: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scene.toml").write_text(scene((0, 0, 1)))
    assert run(["render", str(tmp_path / "scene.toml"), "--out", str(tmp_path / out)]) == 3
    assert out in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["scene.toml"]


# Fit and evaluate


def test_fit_json(capture: Path, results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["fit", str(capture), "--json"]) == 0
    output = capsys.readouterr()
    assert output.err == ""
    document = strict_json(output.out)
    assert document["schema"] == "diffshade.fit/1"
    assert document["model"] == "phong"
    found = document["coefficients"]
    lobe = found["lobes"][0]
    assert found["ka"] == pytest.approx(KA, abs=1e-4)
    assert found["kd"] == pytest.approx(KD, abs=1e-4)
    assert lobe["ks"] == pytest.approx([KS] * 3, abs=1e-4)
    assert lobe["shininess"] == pytest.approx(SHININESS, rel=1e-3)
    assert lobe["kind"] == "phong"
    assert found["body"] is found["attenuation"] is None
    assert shape(document["standard_errors"]) == shape(found)
    assert document["converged"] is True
    assert document["fraction_excluded"] == 0
    assert {"load", "fit"} == set(document["seconds"])
    rows = document["per_image"]
    assert [row["file"] for row in rows] == ["0.png", "1.png"]
    assert all(row["pixels_clipped"] == 0 and row["pixels_used"] > 900 for row in rows)
    # The file is the same object, but for the time that it took.
    written = strict_json((results / "fit.json").read_text())
    assert {**written, "seconds": 0} == {**document, "seconds": 0}


def test_the_folder_of_results(results: Path) -> None:
    names = {"comparison_1.png", "comparison_2.png", "fit.json", "report.html", "report.txt"}
    assert {file.name for file in results.iterdir()} == names
    report = (results / "report.txt").read_text()
    assert "shininess" in report
    assert "written into" not in report
    assert "linear x" in report  # the exposure
    assert "the ends of the colour bar are +/- " in report
    page = (results / "report.html").read_text()
    assert page.count('src="data:image/png;base64,') == 2 * 4
    assert "0.png: relative residual" in re.sub("<.*?>", "", page)
    # Three panels of the whole image, as it fills it, and a bar; eight times as large.
    picture = read_image(results / "comparison_2.png").values
    width = 3 * (SIZE + GAP) + BAR
    assert picture.shape == (8 * SIZE, 8 * width, 3)
    assert len(np.unique(picture[:, : 8 * SIZE].reshape(-1, 3), axis=0)) > 200


def test_evaluate_repeats_the_residual_of_the_fit(
    capture: Path, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fitted = strict_json((results / "fit.json").read_text())
    assert run(["evaluate", str(results / "fit.json"), str(capture), "--json"]) == 0
    document = strict_json(capsys.readouterr().out)
    assert document["schema"] == "diffshade.evaluate/1"
    for key in ("relative_residual", "fraction_excluded", "per_image"):
        # Both round in units of what was observed, which is 1 here, whatever is left of it.
        rounding = 16 * float(jnp.finfo(jnp.zeros(()).dtype).eps)
        assert flat(document[key]) == pytest.approx(flat(fitted[key]), rel=1e-6, abs=rounding)


def test_evaluate_finds_the_fit_in_its_folder(
    capture: Path, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["evaluate", str(results), str(capture), "--json"]) == 0
    assert strict_json(capsys.readouterr().out)["schema"] == "diffshade.evaluate/1"
    assert run(["evaluate", str(results.parent), str(capture)]) == 3
    told = capsys.readouterr().err
    assert f"{results.parent}: this folder has no fit.json" in told
    assert f"give one of those below it, as {results}" in told


@pytest.mark.parametrize("file", ["", "capture.toml"])
@pytest.mark.parametrize("fit", ["", "fit.json"])
def test_evaluate_of_what_is_swapped(
    file: str, fit: str, capture: Path, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, last = capture / file, results / fit
    assert run(["evaluate", str(first), str(last)]) == 3
    assert capsys.readouterr().err == (
        f"diffshade: {first} and {last}: seem to be swapped; the fit goes first, and then the capture\n"
    )


def test_lights_of_another_program_are_no_fit(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """AliceVision's lights end in `.json`, as a fit does."""
    lights, empty = tmp_path / "lights.json", tmp_path / "empty"
    lights.write_text('{"lights": []}')
    empty.mkdir()
    assert run(["evaluate", str(empty), str(lights)]) == 3
    assert f"{empty}: this folder has no fit.json" in capsys.readouterr().err
    assert run(["evaluate", str(lights), str(results)]) == 3
    assert f"{lights} and {results}: seem to be swapped" in capsys.readouterr().err


def test_the_page_of_a_folder(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "fit.json").write_bytes((results / "fit.json").read_bytes())
    assert run(["view", str(tmp_path)]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'fit.html'}\n"
    assert (tmp_path / "fit.html").stat().st_size > 10_000
    (tmp_path / "fit.json").unlink()
    assert run(["view", str(tmp_path)]) == 3
    assert f"{tmp_path}: this folder has no fit.json" in capsys.readouterr().err
    (tmp_path / "scene.toml").write_text(scene((0.0, 0.0, 1.0)))
    assert run(["view", str(tmp_path)]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'scene.html'}\n"


def test_what_ends_before_a_file_is_whole_leaves_no_folder(
    capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "replace", interrupted)
    (tmp_path / "mine").mkdir()
    for folder in (tmp_path / "new" / "folder", tmp_path / "mine"):
        with pytest.raises(KeyboardInterrupt):
            run(["fit", str(capture), "--out", str(folder)])
        assert list(tmp_path.rglob("*")) == [tmp_path / "mine"]


@pytest.mark.parametrize(
    "hold", ["kx=1", "specular.1.ks=0.2", "specular.shininess=1,2,3", "kd=1,2", "shininess=9"]
)
def test_holding_what_the_model_lacks_is_wrong_usage(
    hold: str, capture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["fit", str(capture), "--hold", hold]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert hold.partition("=")[0] in error


def test_hold_and_model(capture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["fit", str(capture), "--json", "--model", "lambert", "--hold", "ka=0.1,0.05,0.02"]
    assert run(arguments) == 0
    document = strict_json(capsys.readouterr().out)
    assert document["coefficients"]["ka"] == pytest.approx(KA)
    assert document["standard_errors"]["ka"] == [None] * 3
    assert document["held"] == ["ka"]
    assert document["coefficients"]["lobes"] == []
    assert document["relative_residual"] > 0.01


def test_auto_takes_what_the_images_speak_for(
    capture: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from fitting import named_models

    some = {name: named_models.MODELS[name] for name in ("lambert", "phong")}
    monkeypatch.setattr(named_models, "MODELS", some)
    assert run(["fit", str(capture), "--model", "auto", "--json"]) == 0
    output = capsys.readouterr()
    assert output.err.splitlines() == [
        "diffshade: fitting lambert, model 1 of 2",
        "diffshade: fitting phong, model 2 of 2",
    ]
    document = strict_json(output.out)
    assert document["model"] == "phong"
    first, second = document["compared"]
    assert (first["model"], second["model"]) == ("phong", "lambert")
    assert first["bic"] < second["bic"]
    assert first["relative_residual"] == document["relative_residual"]
    assert run(["fit", str(capture), "--model", "auto", "--hold", "ka=0"]) == 2
    assert "names coefficients of one model" in capsys.readouterr().err


def test_a_search_that_does_not_converge_is_status_1(
    capture: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from fitting import estimate

    attempted = estimate.attempted

    def stopped(*arguments: Any) -> Any:
        found = attempted(*arguments)
        return replace(found, minimum=replace(found.minimum, converged=False))

    monkeypatch.setattr(estimate, "attempted", stopped)
    assert run(["fit", str(capture)]) == 1
    assert "DID NOT CONVERGE" in capsys.readouterr().out


@pytest.mark.slow
def test_precision_is_of_the_command_alone(
    capture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import jax

    before = jax.config.jax_enable_x64
    found = []
    for bits in ("32", "64"):
        assert run(["fit", str(capture), "--json", "--precision", bits]) == 0
        found.append(strict_json(capsys.readouterr().out)["coefficients"]["kd"])
        assert found[-1] == pytest.approx(KD, abs=1e-4)
        assert jax.config.jax_enable_x64 == before
    assert found[0] != found[1]


def test_many_images_share_a_sheet(
    capture: Path, results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from diffshade.commands.fit import Fitted, fit_capture

    fitted = fit_capture(capture, model="lambert")
    many = 8
    several = replace(
        fitted.capture,
        **{
            name: getattr(fitted.capture, name)[:1] * many
            for name in ("names", "images", "valid", "clipped", "scenes")
        },
    )
    found: Any = SimpleNamespace(material=fitted.fit.material, scene=fitted.fit.scene[:1] * many)
    # Into a folder that holds an earlier fit, and something of the user's.
    for file in results.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / "comparison_of_mine.png").write_text("mine")
    document = {**fitted.document, "per_image": fitted.document["per_image"][:1] * many}
    Fitted(several, found, document).write(tmp_path, document, "report", "title")
    names = {"comparison.png", "comparison_of_mine.png", "fit.json", "report.html", "report.txt"}
    assert {file.name for file in tmp_path.iterdir()} == names


# The main job on real and shipped data


@pytest.mark.slow
def test_demo_recovers_the_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["demo", "--json", "--out", str(tmp_path)]) == 0
    document = strict_json(capsys.readouterr().out)
    truth, found, error = (document[k] for k in ("truth", "coefficients", "standard_errors"))
    flat = [
        *((found[k], error[k], truth[k]) for k in ("ka", "kd")),
        *((found["lobes"][0][k], error["lobes"][0][k], truth[k]) for k in ("ks", "shininess")),
        *(
            (found["attenuation"][k], error["attenuation"][k], truth["attenuation"][k])
            for k in ("c0", "c1", "c2")
        ),
    ]
    for value, spread, known in (map(np.asarray, each) for each in flat):
        # c0 is 1 by convention, exactly; the rounding of 1 is no error.
        assert np.all(np.abs(value - known) <= 3 * spread + 1e-15)
        # c1 is 0: its share of 1/f at d = 1 is what a part in a thousand refers to.
        assert np.all(np.abs(value - known) <= 1e-3 * np.where(known == 0, 1, known))
    assert strict_json((tmp_path / "fit.json").read_text())["truth"] == truth
    assert "in std. errors" in (tmp_path / "report.txt").read_text()


@pytest.mark.slow
def test_the_ball_of_diligent(tmp_path: Path, cache: str) -> None:
    ball = shared_data("diligent_ball")
    done = program("fit", ball, "--json", "--out", tmp_path / "ball", XDG_CACHE_HOME=cache)
    assert (done.returncode, done.stderr) == (0, "")
    document = strict_json(done.stdout)
    assert document["relative_residual"] <= 0.095
    assert document["coefficients"]["kd"] == pytest.approx([0.162, 0.137, 0.089], rel=0.02)
    assert 480 <= document["coefficients"]["lobes"][0]["shininess"] <= 640
    assert len(document["per_image"]) == 24
    assert all(row["pixels_clipped"] > 0 for row in document["per_image"])

    done = program("evaluate", tmp_path / "ball" / "fit.json", ball, "--json", XDG_CACHE_HOME=cache)
    assert (done.returncode, done.stderr) == (0, "")
    again = strict_json(done.stdout)
    for key in ("relative_residual", "per_image"):
        assert flat(again[key]) == pytest.approx(flat(document[key]), rel=1e-4)
