"""`diffshade export`: a fitted material for other tools, from the command line."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import strict_json

from diffshade.cli import run
from diffshade.commands.usage import EXPORTS
from diffshade.io.mtl import read_mtl

FIT: dict[str, Any] = {
    "schema": "diffshade.fit/1",
    "coefficients": {
        "ka": [0.1, 0.1, 0.1],
        "kd": [0.5, 0.4, 0.3],
        "lobes": [{"kind": "phong", "ks": [0.3, 0.3, 0.3], "shininess": 32.0}],
        "body": None,
        "attenuation": {"kind": "quadratic", "c0": 1.0, "c1": 0.25, "c2": 0.125},
    },
}


@pytest.fixture
def fit(tmp_path: Path) -> Path:
    path = tmp_path / "fit.json"
    path.write_text(json.dumps(FIT))
    return path


@pytest.mark.parametrize("to", EXPORTS)
def test_each_format_is_written_with_its_error(
    to: str, fit: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = fit.parent / "shiny.out"
    assert run(["export", str(fit), "--to", to, "--out", str(out), "--json"]) == 0
    output = capsys.readouterr()
    assert output.err == ""
    document = strict_json(output.out)
    assert document["schema"] == "diffshade.export/1"
    assert (document["format"], document["file"]) == (to, str(out))
    assert document["error"]["incidence"] == [0, 30, 60, 80]
    assert 0 < document["error"]["relative_rms"][0] < 0.05
    assert any("attenuation is left out" in note for note in document["notes"])
    assert any("ambient" in note for note in document["notes"]) == (to != "mtl")
    if to == "mtl":
        assert read_mtl(out)["shiny"].ns == 128
    else:
        strict_json(out.read_text())


def test_the_report_for_people(fit: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = fit.parent / "a.mtl"
    assert run(["export", str(fit), "--to", "mtl", "--out", str(out)]) == 0
    told = capsys.readouterr().out
    assert f"written: {out}" in told
    assert "4 times the exponent" in told
    assert "error, root mean square, relative: " in told


def test_irradiance(fit: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = fit.parent / "a.gltf"
    words = ["export", str(fit), "--to", "gltf", "--out", str(out)]
    assert run([*words, "--irradiance", "1"]) == 3
    error = capsys.readouterr().err
    assert error.startswith(f"diffshade: {fit}: baseColorFactor would be above 1")
    assert error.count("\n") == 1
    assert not out.exists()
    assert run([*words, "--irradiance", "6.2831853"]) == 0
    base = json.loads(out.read_text())["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"]
    np.testing.assert_allclose(base[:3], [0.2523, 0.2019, 0.1514], rtol=2e-3)
    words[3] = "mtl"
    assert run([*words, "--irradiance", "1"]) == 2
    assert "leave it out" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "out", "told"),
    [
        ("{}", "a.mtl", "schema"),
        ("[1]", "a.mtl", "holds no JSON object; give a fit.json"),
        (None, "a.mtl", "no such file"),
        (json.dumps(FIT), "absent/a.mtl", "does not exist"),
        (json.dumps(FIT).replace("0.5, 0.4, 0.3", "0.5, 0.4"), "a.mtl", "red, green and blue"),
    ],
)
def test_bad_input_is_status_3_in_one_line(
    content: str | None, out: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "fit.json"
    if content is not None:
        path.write_text(content)
    assert run(["export", str(path), "--to", "mtl", "--out", str(tmp_path / out)]) == 3
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1
    assert told in output.err
    assert str(path if out == "a.mtl" else tmp_path / out) in output.err
