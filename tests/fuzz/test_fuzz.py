"""A few hundred mutated files a run; `fuzz.parsers` tries any number, guided by coverage."""

from pathlib import Path

import numpy as np
import pytest
from fuzz.mutate import mutated
from fuzz.parsers import fuzz
from fuzz.target import Target
from malformed.case import Format
from malformed.cases import formats

CASES = 25
"""A format."""


@pytest.mark.parametrize("format", formats(), ids=lambda f: f.name)
def test_mutated_files_are_read_or_refused(
    format: Format, tmp_path: Path, rng: np.random.Generator, capfd: pytest.CaptureFixture[str]
) -> None:
    target = Target(format, tmp_path)
    capfd.readouterr()
    for _ in range(CASES):
        content = mutated(target.valid, [target.valid], rng)
        try:
            target.attempt(content)
        except BaseException:
            print(f"broken by {content!r}")
            raise
    assert capfd.readouterr() == ("", "")


def test_a_broken_parser_is_seen(tmp_path: Path) -> None:
    """By a guard taken away: a warning, or an exception that is not ours."""
    format = formats()[0]
    target = Target(format, tmp_path)
    assert target.attempt(target.valid)
    target.read = lambda path: 1 / 0
    with pytest.raises(ZeroDivisionError):
        target.attempt(b"")
    target.read = lambda path: np.float64(1) / np.float64(0)
    with pytest.raises(AssertionError, match="divide by zero"):
        target.attempt(b"")
    target.read = lambda path: np.array([np.nan])
    with pytest.raises(AssertionError, match="NaN or infinity"):
        target.attempt(b"")


@pytest.mark.slow
def test_the_command_fuzzes_in_a_process_of_its_own(tmp_path: Path) -> None:
    outcome = fuzz("sphere.json", 200, 1, tmp_path / "kept")
    assert outcome.findings == ()
    assert outcome.cases >= 200
    assert outcome.read > 0
    assert outcome.refused > 0
