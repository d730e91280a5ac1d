"""The list of guards is that of the source; `fuzz.without_guards` takes them out."""

from pathlib import Path

import pytest
from fuzz import guards
from fuzz.guards import GUARDS, PACKAGE, unlisted


def test_every_guard_stands_once_in_its_file() -> None:
    for guard in GUARDS:
        assert (PACKAGE / guard.file).read_text().count(guard.source) == 1, guard.name


def test_no_guard_is_unlisted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert unlisted() == []
    (tmp_path / "new.py").write_text("\ny = jnp.where(x > 0, 1 / jnp.where(x > 0, x, 1), 0)\n")
    monkeypatch.setattr(guards, "PACKAGE", tmp_path)
    assert unlisted() == ["new.py:2", "new.py:2"]
