"""Every row of `MODELS.md` names a function, a test and a notebook that are there."""

import importlib
import re
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]

ROWS = (
    *(f"R{k}" for k in range(1, 14)),
    *(f"S{k}" for k in range(1, 9)),
    *(f"C{k}" for k in range(1, 11)),
)
"""The systems of the texts."""


class Row(NamedTuple):
    name: str
    system: str
    functions: list[str]
    tests: list[str]
    notebook: str


def rows() -> list[Row]:
    lines = (ROOT / "MODELS.md").read_text(encoding="utf-8").splitlines()
    cells = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in lines if line[:1] == "|"
    ]
    named = [cell for cell in cells if re.fullmatch(r"[RSC]\d+", cell[0])]
    return [
        Row(name, system, re.findall("`(.*?)`", functions), re.findall("`(.*?)`", tests), notebook)
        for name, system, functions, tests, notebook in named
    ]


def test_every_row_is_there_once() -> None:
    assert tuple(row.name for row in rows()) == ROWS


@pytest.mark.parametrize("row", rows(), ids=lambda row: row.name)
def test_what_a_row_names_is_there(row: Row) -> None:
    assert row.functions
    for function in row.functions:
        module, _, name = function.rpartition(".")
        assert getattr(importlib.import_module(module), name, None) is not None, function
    assert row.tests
    for test in row.tests:
        file, _, name = test.partition("::")
        source = (ROOT / file).read_text(encoding="utf-8")
        assert not name or re.search(rf"^    def {name}\(|^def {name}\(", source, re.M), test
    assert (ROOT / "notebooks" / f"{row.notebook}.ipynb").exists(), row.notebook
