"""GUIDE.md: its commands run, in order, and print what it says; its options, keys and pictures exist."""

import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from diffshade.cli import run
from diffshade.commands.usage import COMMANDS, parse
from diffshade.io.read_capture import read_capture

ROOT = Path(__file__).parents[1]
GUIDE = (ROOT / "GUIDE.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", GUIDE, re.MULTILINE | re.DOTALL)


def numbers_apart(line: str) -> tuple[str, list[float]]:
    """A line with a mark for each number, and its numbers."""
    number = r"(?<![\w.])\d+\.?\d*(?:e-?\d+)?"
    words = " ".join(re.sub(number, "#", line).split())
    return words, [float(text) for text in re.findall(number, line)]


@pytest.mark.slow
def test_its_commands_print_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    printed = ""
    for command in "".join(blocks("sh")).splitlines():
        program, *words = shlex.split(command)
        if program == "python":
            subprocess.run([sys.executable, *words], check=True)
        else:
            assert program == "diffshade"
            assert run(words) == 0
            printed += capsys.readouterr().out
    found: dict[str, list[list[float]]] = {}
    for line in printed.splitlines():
        words_of, numbers = numbers_apart(line)
        found.setdefault(words_of, []).append(numbers)
    for line in "".join(blocks("text")).splitlines():
        words_of, numbers = numbers_apart(line)
        assert words_of in found, line
        # Errors, which come from rounding too, differ among machines and precisions.
        values = [slice(None)] if "+/-" not in line else [slice(0, None, 2)]
        for chosen in values:
            told = np.array(numbers[chosen])
            assert any(np.allclose(told, n[chosen], rtol=0.02) for n in found[words_of]), line
    for file in ("my_fit/report.html", "my_fit/fit.html", "my_ball.mtl", "my_ball.gltf"):
        assert (tmp_path / file).stat().st_size > 0
        assert file in GUIDE


def test_its_capture_is_read(tmp_path: Path) -> None:
    (text,) = blocks("toml")
    (tmp_path / "capture.toml").write_text(text)
    stated = tomllib.loads(text)
    size = stated["camera"]["width"], stated["camera"]["height"]
    for image in stated["image"]:
        Image.new("RGB", size, (100, 80, 60)).save(tmp_path / image["file"])
    capture = read_capture(tmp_path)
    rows, columns = np.nonzero(np.asarray(capture.gbuffer.mask))
    # The edges that its arithmetic begins with.
    assert (columns.min(), columns.max() + 1) == (400, 840)
    assert (rows.min(), rows.max() + 1) == (250, 690)
    assert [len(scene.lights) for scene in capture.scenes] == [1, 1, 0]
    assert capture.fit_attenuation is not None
    light = re.search(r"Far lamps are `(\{.*?\})`", GUIDE)
    assert light is not None
    far = re.sub(r"lights = \[\{.*?\}\]", f"lights = [{light[1]}]", text.replace("\n\n", "\n"))
    (tmp_path / "capture.toml").write_text(far)
    assert read_capture(tmp_path).fit_attenuation is None


def test_its_options_exist() -> None:
    inline = re.findall(r"`([^`\n]+)`", GUIDE)
    commands = [
        words for words in inline if words.startswith("diffshade ") and len(words.split()) > 2
    ]
    assert len(commands) >= 3
    for words in commands:
        assert parse(shlex.split(words)[1:])["command"] in COMMANDS
    options = [words for words in inline if words.startswith("--")]
    assert len(options) >= 10
    for words in options:
        command = "calibrate" if words.startswith("--mask") else "fit"
        given = words.replace("CX,CY,R", "1,2,3").split()
        place = ["my_ball", *given] if "--hold" in words else [*given, "my_ball"]
        assert parse([command, *place])["command"] == command


def test_its_reasons_are_those_of_the_fit() -> None:
    reasons = "".join(
        "".join(re.findall(r'"([^"]*)"', (ROOT / "fitting" / file).read_text(encoding="utf-8")))
        for file in ("degeneracies.py",)
    )
    table = GUIDE.split('When it says "not identified"')[1].split("##")[0]
    for row in table.splitlines()[4:]:
        if row.startswith("|"):
            for phrase in row.split("|")[1].split(","):
                assert phrase.replace("...", "").strip().removeprefix("ks ") in reasons, phrase


def test_its_pictures_are_small() -> None:
    named = re.findall(r"\]\((guide/\w+\.png)\)", GUIDE)
    assert {ROOT / name for name in named} == set((ROOT / "guide").glob("*.png"))
    assert all((ROOT / name).stat().st_size < 60_000 for name in named)
