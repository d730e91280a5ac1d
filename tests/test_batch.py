"""Several captures in one command, and shares of them."""

import json
import shutil
from pathlib import Path

import pytest
from command_line import make_capture, strict_json

from diffshade.cli import run


@pytest.fixture(scope="module")
def captures(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Three folders, of which the last has no capture.toml."""
    root = tmp_path_factory.mktemp("captures")
    for name in ("one", "two"):
        (root / name).mkdir()
    make_capture(root / "one")
    shutil.copytree(root / "one", root / "two", dirs_exist_ok=True)
    return [root / name / "capture.toml" for name in ("one", "two", "three")]


@pytest.mark.slow
def test_each_has_a_folder_of_its_name(
    captures: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [*map(str, captures), "--shard", "2/2", "--out", str(tmp_path), "--json"]
    assert run(["fit", *words]) == 0
    document = strict_json(capsys.readouterr().out)
    assert document["schema"] == "diffshade.fits/1"
    assert (document["shard"], document["captures"]) == ([2, 2], 3)
    (entry,) = document["fits"]
    assert (entry["name"], entry["status"], entry["error"]) == ("two", 0, None)
    assert json.loads((tmp_path / "two" / "fit.json").read_text()) == entry["fit"]
    assert [folder.name for folder in tmp_path.iterdir()] == ["two"]


@pytest.mark.slow
def test_a_bad_one_does_not_stop_the_others(
    captures: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    order = [captures[2], captures[0]]
    assert run(["fit", *map(str, order)]) == 3
    output = capsys.readouterr()
    assert "three" in output.err
    assert output.err.count("\n") == 1
    assert output.out.splitlines()[-1] == "2 of 2 captures: 1 fitted, 1 could not be used"


def test_a_share_may_be_empty(captures: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["fit", str(captures[0]), "--shard", "2/2", "--json"]) == 0
    assert strict_json(capsys.readouterr().out)["fits"] == []


@pytest.mark.parametrize("shard", ["0/2", "3/2", "2", "a/b", "-1/2"])
def test_a_share_that_cannot_be(shard: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["fit", "x", "--shard", shard]) == 2
    assert capsys.readouterr().err


def test_two_of_one_name(captures: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["fit", str(captures[0]), str(captures[0])]) == 2
    assert "one name, one" in capsys.readouterr().err
