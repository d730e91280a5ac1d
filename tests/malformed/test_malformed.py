"""Every malformed file is refused in one line, and harms nothing."""

from collections import Counter
from pathlib import Path

import pytest
from malformed.case import CLASSES, Case, Format
from malformed.cases import cases, formats, refusal

ALL = list(cases())


@pytest.mark.parametrize("format", formats(), ids=lambda f: f.name)
def test_what_is_whole_is_read(format: Format, tmp_path: Path) -> None:
    assert format.read(format.write(tmp_path)) is not None


@pytest.mark.parametrize("case", ALL, ids=lambda c: f"{c.format.name}-{c.kind}-{c.name}")
def test_what_is_malformed_is_refused(
    case: Case, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    capfd.readouterr()
    refusal(case, tmp_path)
    assert capfd.readouterr() == ("", "")


def test_every_class_and_every_format_has_its_cases() -> None:
    counts = Counter((case.format.name, case.kind) for case in ALL)
    assert {kind for _, kind in counts} == set(CLASSES)
    for format in formats():
        for kind in ("truncated", "wrong magic", "empty", "too large"):
            without = {"mtl": ("wrong magic", "empty"), "stl, binary": ("wrong magic",)}
            if kind not in without.get(format.name, ()):
                assert counts[format.name, kind] >= 2, (format.name, kind)
    names = Counter((case.format.name, case.kind, case.name) for case in ALL)
    assert max(names.values()) == 1
