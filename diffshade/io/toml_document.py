"""TOML files read strictly: complaints name the file, the place, what is wrong and the choices."""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

from diffshade.errors import BadInput, naming
from diffshade.io.contents import read_text, within

__all__ = ["Table", "read_toml"]


_MANY_PARTS = re.compile(r"""(?<![\w"'-])(?:[\w"'-]+[ \t]*\.[ \t]*){100}""")
"""`a.a.a. ...`: tomllib takes the square of their number to read them."""


def read_toml(path: Path, *, allow_outside: bool = False) -> Table:
    """The top table of a TOML file; raises `BadInput` for what is not there or not TOML.

    The files that it names lie in its folder, unless `allow_outside`.
    """
    text = read_text(path)
    if _MANY_PARTS.search(text):
        raise BadInput(f"{path}: has a key of 100 parts; there is none in this format")
    try:
        return Table(path, "", tomllib.loads(text), allow_outside)
    except (ValueError, RecursionError) as error:  # tomllib's own, and that of a number too long
        raise BadInput(f"{path}: is not valid TOML: {error}; correct it") from None


@dataclass(frozen=True)
class Table:
    """One table, and where it stands: `place` is empty at the top, else such as "image 2, light 1".

    Each reader of a key raises `BadInput` where the value has the wrong type or is out of range;
    `expect` says which keys there may be. Numbers are typed `Any`: they go to field converters,
    which type checkers do not see.
    """

    path: Path
    place: str
    values: Mapping[str, Any]
    allow_outside: bool = False
    """Whether files that it names may lie outside its folder."""

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def fail(self, complaint: str) -> NoReturn:
        """Raise `BadInput` for this table."""
        place = f"{self.place}: " if self.place else ""
        raise BadInput(f"{self.path}: {place}{complaint}")

    def naming(self) -> AbstractContextManager[None]:
        """Complaints about values, which know no file, get the file and place of this table."""
        return naming(self.path, self.place)

    def expect(self, required: Iterable[str], optional: Iterable[str] = ()) -> None:
        """Refuse unknown keys, then missing ones."""
        required = tuple(required)
        known = (*required, *optional)
        for key in self.values:
            if key not in known:
                self.fail(f'unknown key "{key}"; the keys here are {", ".join(known)}')
        for key in required:
            if key not in self.values:
                self.fail(f'the key "{key}" is missing; the keys here are {", ".join(known)}')

    def text(self, key: str) -> str:
        """A string."""
        value = self.values[key]
        return value if isinstance(value, str) else self._wrong(key, "a text in quotes")

    def choice(self, key: str, choices: Iterable[str]) -> str:
        """One of several strings; the key has to be there."""
        quoted = ", ".join(f'"{name}"' for name in choices)
        if key not in self.values:
            self.fail(f'the key "{key}" is missing; give one of {quoted}')
        value = self.values[key]
        return value if value in choices else self._wrong(key, f"one of {quoted}")

    def truth(self, key: str) -> bool:
        """true or false."""
        value = self.values[key]
        return value if isinstance(value, bool) else self._wrong(key, "true or false")

    def whole(self, key: str) -> int:
        """A whole number of at least 1, and below 2^31."""
        value = self.values[key]
        if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value < 2**31:
            self._wrong(key, "a whole number of at least 1, below 2^31")
        return value

    def number(self, key: str, *, least: float | None = None, above: float | None = None) -> Any:
        """A finite number, at least `least` or above `above`."""
        value = self.values[key]
        if not _in_range(value, least, above):
            self._wrong(key, f"a number{_range(least, above)}")
        return float(value)

    def vector(self, key: str) -> Any:
        """Three finite numbers."""
        value = self.values[key]
        if not isinstance(value, list) or len(value) != 3 or not all(map(_in_range, value)):
            self._wrong(key, "three numbers [x, y, z]")
        return tuple(map(float, value))

    def per_channel(self, key: str, *, above: float | None = None) -> Any:
        """A number for all channels or a list with one each, of at least 0, or above `above`."""
        value = self.values[key]
        least = 0.0 if above is None else None
        each = value if isinstance(value, list) else [value]
        if not each or not all(_in_range(x, least, above) for x in each):
            self._wrong(key, f"a number{_range(least, above)}, or a list with one a channel")
        return tuple(map(float, value)) if isinstance(value, list) else float(value)

    def rows(self, key: str) -> Any:
        """A list of finite numbers, or of lists of as many of them each."""
        value = self.values[key]
        rows = value if isinstance(value, list) else []
        numbers = [row if isinstance(row, list) else [row] for row in rows]
        shapes = {len(row) if isinstance(row, list) else None for row in rows}
        if len(shapes) != 1 or not all(_in_range(x) for row in numbers for x in row):
            self._wrong(key, "a list of numbers, or of lists of one number a channel")
        return value

    def file(self, key: str) -> Path:
        """A path, relative to the folder of this file, and in it."""
        return within(self.path.parent, self.text(key), allow_outside=self.allow_outside)

    def table(self, key: str) -> Table:
        """A table inside this one."""
        value = self.values[key]
        if not isinstance(value, dict):
            self._wrong(key, "a table, such as { kind = ... }")
        return replace(self, place=self._inside(key), values=value)

    def tables(self, key: str, called: str) -> list[Table]:
        """A list of tables, each `called` so and numbered from 1."""
        value = self.values[key]
        if isinstance(value, dict) and self.path.suffix.lower() == ".toml":
            header = ".".join([*re.findall("[a-z_]+", self.place), key])
            self.fail(
                f"{key} is one table, and there may be several: write [[{header}]] with two brackets,"
                f" or {key} = [{{ ... }}]"
            )
        if not isinstance(value, list) or not all(isinstance(entry, dict) for entry in value):
            self._wrong(key, "a list of tables, [{ ... }, { ... }]")
        return [
            replace(self, place=self._inside(f"{called} {number}"), values=entry)
            for number, entry in enumerate(value, 1)
        ]

    def _inside(self, name: str) -> str:
        return f"{self.place}, {name}" if self.place else name

    def _wrong(self, key: str, wanted: str) -> NoReturn:
        given = _shown(self.values[key])
        given = given if len(given) <= 60 else f"{given[:57]}..."
        self.fail(f"{key} is {given}; give {wanted}")


def _in_range(value: Any, least: float | None = None, above: float | None = None) -> bool:
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) <= sys.float_info.max  # NaN is not, nor an integer that is no float
        and (least is None or value >= least)
        and (above is None or value > above)
    )


def _shown(value: Any) -> str:
    try:
        return repr(value)
    except ValueError:  # a whole number of thousands of digits
        return "a number too long to show"


def _range(least: float | None, above: float | None) -> str:
    if above is not None:
        return f" above {above:g}"
    return "" if least is None else f" of at least {least:g}"
