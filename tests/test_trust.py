"""The trust report says what fails."""

import sys
from collections.abc import Iterator

import pytest
import trust


def test_every_part_is_explained() -> None:
    assert trust.__doc__ is not None
    assert all(f"- {name}: " in trust.__doc__ for name in trust.PARTS)


def test_a_failure_is_said_and_counted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def part(options: trust.Options) -> Iterator[tuple[str, list[str]]]:
        yield f"{options.kills} tried", []
        yield "one of two", ["the other"]

    monkeypatch.setattr(trust, "PARTS", {"part": part, "none": lambda options: iter(())})
    monkeypatch.setattr(sys, "argv", ["trust", "--kills", "3"])
    assert trust.main() == 1
    said = capsys.readouterr().out
    assert "## part\n- 3 tried\n- one of two \n  FAILED: the other" in said
    assert "\n1 failures\n" in said
    monkeypatch.setattr(sys, "argv", ["trust", "--only", "none"])
    assert trust.main() == 0


def test_malformed_files_are_counted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["trust", "--only", "malformed"])
    assert trust.main() == 0
    assert "bomb" in capsys.readouterr().out
