"""The process of the command line: faults of ours, and what it sets up."""

import os
import signal
import sys
from pathlib import Path

import pytest

from diffshade import cli
from diffshade.commands import settings


def test_a_fault_of_ours_is_said_to_be_ours(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(_: object) -> int:
        error = IndexError("out of\nrange")
        error.add_note("---\nFor simplicity, ... Set JAX_TRACEBACK_FILTERING=off to include these.")
        raise error

    monkeypatch.setattr(cli, "run", run)
    monkeypatch.setattr(cli, "cache_programs", lambda: None)
    monkeypatch.setattr("warnings.showwarning", None)  # and so it is put back
    before = signal.getsignal(signal.SIGINT)
    try:
        assert cli.main() == 70
    finally:
        signal.signal(signal.SIGINT, before)
    output = capsys.readouterr()
    assert output.out == ""
    first, second, *_, last = output.err.splitlines()
    assert first.startswith(
        "diffshade: a fault of diffshade itself, not of what you gave it (IndexError: out of range);"
        " please report it, with the command"
    )
    assert f"Python {sys.version.split()[0]}" in first
    assert second == "Traceback (most recent call last):"
    assert last == "range"


def test_the_cache_of_compiled_programs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(os, "environ", {"XDG_CACHE_HOME": str(tmp_path), "HOME": str(tmp_path)})
    settings.cache_programs()
    folder = Path(os.environ["JAX_COMPILATION_CACHE_DIR"])
    assert folder.is_dir()
    assert tmp_path in folder.parents

    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(tmp_path / "mine")
    settings.cache_programs()
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == str(tmp_path / "mine")

    (tmp_path / "file").write_text("")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(tmp_path / "file")
    os.environ.pop("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS")
    settings.cache_programs()  # cannot be made: no cache, and no complaint
    assert "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS" not in os.environ
