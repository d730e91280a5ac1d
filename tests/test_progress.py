"""Progress: told to callbacks, drawn on standard error for those who watch, and gone afterwards."""

import io
import sys
from pathlib import Path
from threading import Event

import pytest
from command_line import make_capture, strict_json

import diffshade as ds
import fitting
from diffshade import progress
from diffshade.cli import run
from diffshade.commands.console import said
from diffshade.io.read_capture import read_capture


class Terminal(io.StringIO):
    """Somebody watches. `written` is set when a text is written that holds the `awaited`."""

    def __init__(self, awaited: str = "") -> None:
        super().__init__()
        self.awaited, self.written = awaited, Event()

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        if self.awaited in text:
            self.written.set()
        return super().write(text)


def watch(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Standard error from now on (pytest has its own for each phase), of which nothing is held back."""
    watched = Terminal()
    monkeypatch.setattr(sys, "stderr", watched)
    monkeypatch.setattr(progress, "DELAY", 0)
    return watched


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_capture(tmp_path_factory.mktemp("capture"))


def shown_at_the_end(text: str) -> list[str]:
    """The lines that a terminal shows: what follows a carriage return goes over what was there."""
    lines = []
    for line in text.split("\n"):
        shown = ""
        for part in line.split("\r"):
            shown = part + shown[len(part) :]
        lines.append(shown.rstrip())
    return lines


def test_a_bar_counts_and_goes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    terminal = watch(monkeypatch)
    with progress.bar("reading images") as told:
        assert told is not None
        for finished in (1, 2, 3):
            told(finished, 3)
            assert f"reading images: {finished} of 3" in terminal.getvalue()
    assert shown_at_the_end(terminal.getvalue()) == [""]
    assert capsys.readouterr().out == ""


def test_where_nothing_counts_the_clock_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = watch(monkeypatch)
    monkeypatch.setattr(progress, "TICK", 0.001)
    with progress.bar("fitting"):
        terminal.awaited = "fitting: 00:0"
        terminal.written.clear()
        assert terminal.written.wait(60)


def test_what_is_soon_done_is_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = watch(monkeypatch)
    monkeypatch.setattr(progress, "DELAY", 3600)
    with progress.bar("reading") as told:
        assert told is not None
        told(1, 1)
    assert terminal.getvalue().strip() == ""


def test_nobody_watches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with progress.bar("reading") as told:
        assert told is None
    assert sys.stderr.getvalue() == ""


def test_what_is_said_goes_above_the_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = watch(monkeypatch)
    with progress.bar("fitting captures") as told:
        assert told is not None
        told(1, 2)
        said("one: cannot be used", terminal)
    assert shown_at_the_end(terminal.getvalue()) == ["one: cannot be used", ""]


def test_callbacks_are_told_of_each(capture: Path) -> None:
    told: list[tuple[int, int]] = []

    def tell(finished: int, count: int) -> None:
        told.append((finished, count))

    found = read_capture(capture, progress=tell)
    assert told == [(1, 2), (2, 2)]
    told.clear()
    material = ds.Material(kd=0.5)
    fitting.evaluate(material, found.images, found.gbuffer, found.scenes, progress=tell)
    assert told == [(1, 2), (2, 2)]


def test_a_comparison_tells_of_each_model(capture: Path) -> None:
    told: list[tuple[int, int]] = []
    found = read_capture(capture)
    fitting.compare(
        found.images,
        found.gbuffer,
        found.scenes,
        materials=["lambert", ds.Material(kd=0.5)],
        progress=lambda finished, count: told.append((finished, count)),
    )
    assert told == [(1, 2), (2, 2)]


@pytest.mark.slow
def test_a_watched_command_prints_its_result_alone(
    capture: Path,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    terminal = watch(monkeypatch)
    assert run(["fit", str(capture), "--json", "--out", str(tmp_path)]) == 0
    assert strict_json(capsys.readouterr().out)["schema"] == "diffshade.fit/1"
    for drawn in (
        f"reading {capture}: 2 of 2",
        "fitting 2 images: 00:",
        f"writing {tmp_path}: 00:",
    ):
        assert drawn in terminal.getvalue()
    assert shown_at_the_end(terminal.getvalue()) == [""]


def test_an_interrupt_ends_the_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = watch(monkeypatch)

    def read() -> None:
        with progress.bar("reading") as told:
            assert told is not None
            for finished in progress.telling(range(3), 3, told):
                if finished == 1:
                    raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        read()
    assert "reading: 1 of 3" in terminal.getvalue()
    assert shown_at_the_end(terminal.getvalue()) == [""]
