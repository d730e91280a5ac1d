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

    def broken(options: trust.Options) -> Iterator[tuple[str, list[str]]]:
        yield "so far", []
        raise KeyError("gone")

    parts = {"part": part, "broken": broken, "none": lambda options: iter(())}
    monkeypatch.setattr(trust, "PARTS", parts)
    monkeypatch.setattr(sys, "argv", ["trust", "--kills", "3"])
    assert trust.main() == 1
    said = capsys.readouterr().out
    assert "## part\n- 3 tried\n- one of two \n  FAILED: the other" in said
    assert "## broken\n- so far\n- not finished \n  FAILED: KeyError: 'gone'\n\n## none" in said
    assert "\n2 failures\n" in said
    monkeypatch.setattr(sys, "argv", ["trust", "--only", "none"])
    assert trust.main() == 0


def test_malformed_files_are_counted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["trust", "--only", "malformed"])
    assert trust.main() == 0
    assert "bomb" in capsys.readouterr().out
