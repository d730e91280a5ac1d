"""Files that are named by others lie in their folder, unless they may lie elsewhere."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from command_line import scene
from malformed.case import Case
from malformed.cases import cases
from mesh_files import written

import diffshade as ds
from diffshade.cli import run
from diffshade.io.read_capture import read_capture
from diffshade.io.scene_toml import read_scene_toml

READERS: dict[str, Callable[..., Any]] = {
    "capture": read_capture,
    "scene": read_scene_toml,
    "dome": lambda path, **o: read_capture(path, encoding="linear", **o),
    "AliceVision scene": lambda path, **o: read_capture(
        path.parent / "lights.json", encoding="linear", **o
    ),
    "lp": lambda path, **o: read_capture(path, encoding="linear", **o),
    "filenames.txt": lambda path, **o: read_capture(path.parent, **o),
    "sphere.json": lambda path, **o: read_capture(path.parent, **o),
    "obj": ds.load_mesh,
    "gltf": ds.load_mesh,
}
ESCAPES = [case for case in cases() if case.kind == "path escape"]


def test_each_format_that_names_files_has_cases() -> None:
    assert {case.format.name for case in ESCAPES} == set(READERS)


@pytest.mark.parametrize("case", ESCAPES, ids=lambda c: f"{c.format.name}-{c.name}")
def test_outside_only_where_it_is_allowed(case: Case, tmp_path: Path) -> None:
    """So that what refuses it is where it lies."""
    path = case.make(tmp_path)
    read = READERS[case.format.name]
    with pytest.raises(ds.BadInput, match=r"--allow-outside, allow_outside=True") as refused:
        read(path)
    assert "lies outside this folder" in str(refused.value)
    assert read(path, allow_outside=True) is not None


def test_a_folder_may_be_reached_by_a_link(tmp_path: Path) -> None:
    """Only what leaves it counts, and not where it is."""
    written(tmp_path, "m.mtl", "newmtl a\nKd 1 0 0\n")
    text = "mtllib ../{}/m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n"
    written(tmp_path, "m.obj", text.format(tmp_path.name))
    with tempfile.TemporaryDirectory() as elsewhere:
        (Path(elsewhere) / "link").symlink_to(tmp_path, target_is_directory=True)
        assert len(ds.load_mesh(Path(elsewhere) / "link" / "m.obj").materials) == 1


@pytest.mark.parametrize("command", ["render", "fit", "evaluate"])
def test_commands_allow_it_too(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is wrong then is the next thing: that the file there is none."""
    (tmp_path / "own").mkdir()
    written(tmp_path, "m.obj", "nothing")
    geometry = '{ kind = "mesh", file = "../m.obj" }'
    path = written(tmp_path / "own", "scene.toml", scene((0, 0, 1), geometry=geometry))
    words = ["render", str(path), "--out", str(tmp_path / "a.png")]
    if command != "render":
        written(tmp_path / "own", "filenames.txt", "../m.obj\n")
        written(tmp_path / "own", "light_directions.txt", "0 0 1\n")
        words = [command, str(path.parent)]
    if command == "evaluate":
        fit = '{"schema": "diffshade.fit/1", "coefficients": {"kd": 0.5}}'
        words.insert(1, str(written(tmp_path, "fit.json", fit)))
    assert run(words) == 3
    assert "lies outside" in capsys.readouterr().err
    assert run([*words, "--allow-outside"]) == 3
    error = capsys.readouterr().err
    assert "lies outside" not in error
    assert "m.obj" in error
