"""How much one file may claim, and who decides."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from handmade import RGB, png_of, saved
from malformed.case import Case
from malformed.cases import cases, refusal

from diffshade.errors import BadInput
from diffshade.io.contents import refusing
from diffshade.io.image import read_image
from diffshade.io.limits import VARIABLE, check_size, largest

BELIEVED = {
    "a short array in a long member",  # no more is read than the array has
    "less than is there",
    "16 x what is there",  # below the limit, and no more is unpacked than there is
    "4 GiB",
    "16,000 x 16,000 of one block",  # claims less than the limit; the rest is missing
    "a list of 255",  # trimesh compares with the size of the file
    "a list of 4e9",
    "tags",
    "nested lists",
    "nested tables",
    "nested objects",
    "nested",
    "a key of many parts",
    "nodes in a circle",
    "a star of 20,000 corners",
    "a star of 5,000 corners",
}
"""Bombs that are not of size, or that are no bombs for how they are read."""


@pytest.mark.parametrize(
    "case",
    [c for c in cases() if c.kind == "bomb" and c.name not in BELIEVED],
    ids=lambda c: f"{c.format.name}-{c.name}",
)
def test_bombs_are_refused_for_what_they_claim(case: Case, tmp_path: Path) -> None:
    """And not because memory ran out, or the data did."""
    assert "values, more than the" in refusal(case, tmp_path)
    assert VARIABLE in refusal(case, tmp_path)


def test_the_user_decides(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = saved(tmp_path, png_of(np.zeros((10, 20, 3), np.uint8), RGB))
    monkeypatch.setenv(VARIABLE, "600")
    assert read_image(path).values.shape == (10, 20, 3)
    monkeypatch.setenv(VARIABLE, "599")
    with pytest.raises(BadInput, match=r"claims 10 x 20 x 3 values, more than the 599"):
        read_image(path)
    monkeypatch.setenv(VARIABLE, "3")
    with pytest.raises(BadInput, match=r"bytes, more than the 24"):
        read_image(path)
    for wrong in ("many", "-1", "1e9", "9" * 30):
        monkeypatch.setenv(VARIABLE, wrong)
        with pytest.raises(BadInput, match=f"{VARIABLE} is '{wrong}': give a whole number"):
            largest()


def test_more_than_the_limit_is_refused() -> None:
    check_size((2**29,))
    check_size((0, 2**80))
    with pytest.raises(BadInput, match="claims 536870913 values"):
        check_size((2**29 + 1,))
    with pytest.raises(BadInput, match=r"claims 10\^18 or more x 2 values"):
        check_size((10**30, 2))


def test_an_exception_without_words_is_named(tmp_path: Path) -> None:
    with (
        pytest.raises(BadInput, match=r"is no such file \(EOFError\); save it again"),
        refusing(tmp_path / "a", "is no such file", "save it again"),
    ):
        raise EOFError


def test_nothing_is_said_beside_the_refusal(tmp_path: Path) -> None:
    """In a process in which nobody listens to logs: Python prints what is logged there."""
    (case,) = (c for c in cases() if (c.format.name, c.name) == ("png", "0 x 5"))
    read = "from diffshade.io.image import read_image; import sys; read_image(sys.argv[1])"
    command = [sys.executable, "-c", read, str(case.make(tmp_path))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "PNG warning" not in done.stderr
    assert "diffshade.errors.BadInput" in done.stderr
