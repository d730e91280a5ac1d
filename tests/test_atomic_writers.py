"""Whatever is written goes to a temporary file that then takes its place."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from diffshade.io.atomic import TEMPORARY, replacing

ROOT = Path(__file__).parents[1]
FILES = [
    path
    for path in sorted((*ROOT.glob("diffshade/**/*.py"), *ROOT.glob("fitting/**/*.py")))
    if "captures" not in path.parts  # which make what the package ships with
]


def direct_writes(source: str) -> Iterator[int]:
    """The lines that write to anything but a path called `temporary`."""
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        is_method = isinstance(node.func, ast.Attribute)
        name = node.func.attr if is_method else getattr(node.func, "id", "")  # type: ignore[attr-defined]
        on = ast.unparse(node.func.value) if is_method else ast.unparse((*node.args, node)[0])  # type: ignore[attr-defined]
        modes = [a.value for a in node.args if isinstance(a, ast.Constant)]
        writes = name in ("write_text", "write_bytes") or (
            name == "open" and any(isinstance(m, str) and set(m) & set("wax+") for m in modes)
        )
        if writes and on not in ("temporary", "os.devnull"):
            yield node.lineno


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.relative_to(ROOT).as_posix())
def test_every_writer_replaces(file: Path) -> None:
    assert list(direct_writes(file.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(
    "source",
    ["p.write_text(x)", "p.write_bytes(x)", "p.open('wb')", "open(p, 'w')", "open(p, 'r+')"],
)
def test_direct_writes_are_seen(source: str) -> None:
    assert list(direct_writes(source)) == [1]


def test_an_interrupted_writer_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "fit.json"
    path.write_text("old")
    replaced = replacing(path)
    replaced.__enter__().write_text("half of the n")
    assert len(list(tmp_path.glob(TEMPORARY.format("*")))) == 1
    assert not replaced.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"fit.json": "old"}
