"""Ctrl-C at a known moment: status 130, one line, no traceback, and whole files or none."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import make_capture, scene

from diffshade import cli
from diffshade.io.atomic import TEMPORARY

SAID = "diffshade: interrupted; every file that is there is whole\n"
ROOT = Path(__file__).parents[1]

PAUSING = """
import sys
from importlib import import_module

module, name, words = sys.argv.pop(1).split(":")
module = import_module(module)
whole = getattr(module, name)

def pausing(*arguments, **options):
    if words in repr(arguments):
        print("here", flush=True)
        sys.stdin.read()
    return whole(*arguments, **options)

setattr(module, name, pausing)
from diffshade.cli import main
sys.exit(main())
"""
"""The program, which says so and waits where it calls a function with certain words."""

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGINT to send")


def interrupted_at(call: str, *arguments: object, below: Path) -> list[Path]:
    """Interrupt the program where it makes this call; the files that were not whole then."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    with subprocess.Popen(
        [sys.executable, "-c", PAUSING, call, *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": path, "XDG_CACHE_HOME": str(below.parent / "cache")},
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "here\n", process.communicate()
        unfinished = list(below.rglob(TEMPORARY.format("*")))
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate()
    assert (process.returncode, output, errors) == (130, "", SAID)
    assert list(below.rglob(TEMPORARY.format("*"))) == []
    return unfinished


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_capture(tmp_path_factory.mktemp("captures"))


def test_as_it_reads(capture: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    call = "diffshade.io.photographs:read_image:1.png"
    assert interrupted_at(call, "fit", capture, "--out", out, below=tmp_path) == []
    assert not out.exists()


@pytest.mark.parametrize("name", ["ball.png", "ball.npy", "ball.exr"])
def test_as_it_writes_an_image(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "scene.toml").write_text(scene((0, 0, 1)))
    (folder / name).write_text("what was there")
    words = ("render", folder / "scene.toml", "--out", folder / name)
    (half,) = interrupted_at(f"os:replace:{name}", *words, below=folder)
    assert half.parent == folder
    assert (folder / name).read_text() == "what was there"


@pytest.mark.slow
def test_a_batch_keeps_what_is_fitted(capture: Path, tmp_path: Path) -> None:
    captures, out = [tmp_path / "one", tmp_path / "two"], tmp_path / "out"
    for copy in captures:
        shutil.copytree(capture, copy)
    words = ("fit", *captures, "--out", out, "--json")
    (half,) = interrupted_at("os:replace:two/fit.json", *words, below=out)
    assert half.parent == out / "two"
    assert json.loads((out / "one" / "fit.json").read_text())["schema"] == "diffshade.fit/1"
    assert "report.html" in {file.name for file in (out / "two").iterdir()}
    assert not (out / "two" / "fit.json").exists()  # by which it is known not to be whole


def test_what_another_library_makes_of_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """XLA reports what was raised in a callback as an error of its own."""

    def run(_: object) -> int:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise RuntimeError("a callback failed") from None
        return 0

    monkeypatch.setattr(cli, "run", run)
    monkeypatch.setattr(cli, "cache_programs", lambda: None)
    monkeypatch.setattr("warnings.showwarning", None)  # and so it is put back
    before = signal.getsignal(signal.SIGINT)
    try:
        assert cli.main() == 130
    finally:
        signal.signal(signal.SIGINT, before)
    assert capsys.readouterr() == ("", SAID)
