"""What the command line says of itself, and of what is typed wrong."""

import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from command_line import program

from diffshade.cli import run
from diffshade.commands.usage import COMMANDS


def test_the_program_answers_help(tmp_path: Path) -> None:
    done = program("--help", XDG_CACHE_HOME=str(tmp_path))
    assert (done.returncode, done.stderr) == (0, "")
    assert all(command in done.stdout for command in COMMANDS)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("demo", "--out DIR|--json|--precision {32,64}"),
        ("render", "SCENE.toml|--out FILE|--precision {32,64}"),
        ("view", "FIT_OR_SCENE|--out FILE|--allow-outside|--precision {32,64}"),
        (
            "fit",
            "CAPTURE|--out DIR|--json|--precision {32,64}|--model {phong,blinn-phong,lambert,phong2,ggx,"
            "|--white LEVEL|--circle CX,CY,R|--encoding|--hold NAME=VALUE"
            "|--robust|--censor|--fit-gamma|--refine-circle|--refine-lights|--gains"
            "|--certify|--shard I/N|--processes N|--process I/N"
            "|--coordinator HOST:PORT|--patience SECONDS|(default: phong)|(default: 60)",
        ),
        (
            "export",
            "FIT.json|--to {mtl,gltf,threejs,mitsuba}|--out FILE|--irradiance E|--json"
            "|--precision {32,64}",
        ),
        (
            "evaluate",
            "FIT.json|CAPTURE|--json|--precision {32,64}|--white LEVEL|--circle CX,CY,R|--encoding",
        ),
        (
            "calibrate",
            "FOLDER|--mask FILE|--circle CX,CY,R|--fov DEGREES|--json|--precision {32,64}",
        ),
    ],
)
def test_help_names_what_a_command_takes(
    command: str,
    words: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    assert run([command, "--help"]) == 0
    told = capsys.readouterr().out
    assert told.startswith(f"usage: diffshade {command}")
    listed = told[told.index("\n\n") :]  # behind the usage
    for word in words.split("|"):
        assert word in listed, word


def test_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == f"diffshade {version('diffshade')}\n"


def test_help_whose_reader_is_gone(tmp_path: Path) -> None:
    here, there = os.pipe()
    os.close(here)
    own = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
    done = subprocess.run(
        [sys.executable, "-m", "diffshade", "--help"],
        cwd=Path(__file__).parents[1],
        env={**own, "XDG_CACHE_HOME": str(tmp_path)},
        stdout=there,
        stderr=subprocess.PIPE,
        check=False,
    )
    os.close(there)
    assert (done.returncode, done.stderr) == (141, b"")


@pytest.mark.parametrize(
    "words",
    [
        "",
        "paint",
        "fit",
        "fit x --bogus",
        "fit x --model ward",
        "fit x --precision 16",
        "fit x --white no",
        "fit x --white 0",
        "fit x --circle 1,2",
        "fit x --circle 1,2,-3",
        "fit x --circle 1,2,nan",
        "fit x --encoding rec709",
        "fit x --encoding -2.2",
        "fit x --hold kd",
        "fit x --hold kd=-1",
        "fit x --hold",
        "fit x --js",
        "fit x --processes 1.5",
        "fit x --patience soon",
        "evaluate fit.json",
        "render scene.toml",
        "view",
        "view scene.toml --json",
        "export fit.json --out a.mtl",
        "export fit.json --to fbx --out a.fbx",
        "export fit.json --to mtl",
        "export fit.json --to gltf --out a.gltf --irradiance 0",
    ],
)
def test_wrong_usage_is_status_2(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(words.split()) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("diffshade: ")
    assert output.err.count("\n") == 1
    assert "--help" in output.err


def test_a_misspelt_option_is_named_with_what_was_meant(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["fit", "x", "--circel", "1,2,3"]) == 2
    assert "--circel (did you mean --circle?); see diffshade fit" in capsys.readouterr().err
    assert run(["fit", "--hold", "kd=0.5", "x"]) == 2
    assert "a CAPTURE goes before --hold" in capsys.readouterr().err


def test_an_outline_may_begin_with_a_minus(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    absent = str(tmp_path / "absent")
    assert run(["fit", absent, "--circle", "-5,10,30"]) == 3
    assert absent in capsys.readouterr().err
