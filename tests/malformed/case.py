"""What a malformed file is: of which format, damaged in which way, and how it is made."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

__all__ = ["CLASSES", "Case", "Format", "any_file"]

CLASSES = (
    "truncated",
    "wrong magic",
    "wrong dtype",
    "wrong shape",
    "NaN",
    "absurd header",
    "bomb",
    "wrong encoding",
    "missing key",
    "wrong type",
    "path escape",
    "empty",
    "too large",
)


class Format(NamedTuple):
    """A format that is read, and a small valid file of it."""

    name: str
    file: str
    """The name of the file that is damaged."""
    valid: Callable[[Path], object]
    """Writes the valid file into a folder, and what it needs beside it."""
    read: Callable[[Path], object]
    """Reads the file of this path."""
    text: bool = False

    def write(self, folder: Path) -> Path:
        self.valid(folder)
        return folder / self.file


class Case(NamedTuple):
    """One malformed file; `make` writes it into an empty folder and returns its path."""

    format: Format
    kind: str
    """One of `CLASSES`."""
    name: str
    make: Callable[[Path], Path]


def damaged(format: Format, kind: str, name: str, change: Callable[[bytes], bytes]) -> Case:
    """The valid file with its content changed."""

    def make(folder: Path) -> Path:
        path = format.write(folder)
        path.write_bytes(change(path.read_bytes()))
        return path

    return Case(format, kind, name, make)


def replaced(format: Format, kind: str, name: str, old: str, new: str) -> Case:
    """The valid text with one part of it replaced."""

    def change(content: bytes) -> bytes:
        assert old.encode() in content, f"{format.name} has no {old!r}"
        return content.replace(old.encode(), new.encode(), 1)

    return damaged(format, kind, name, change)


def any_file(
    format: Format, *, cuts: tuple[float, ...] = (0.05, 0.3, 0.6), magic_at: int | None = 0
) -> Iterator[Case]:
    """The damage that any format can have; a text may be whole again where it is cut elsewhere.

    `magic_at` is where the format says what it is, None where it does not.
    """
    yield damaged(format, "empty", "no byte", lambda _: b"")
    yield damaged(format, "empty", "one zero byte", lambda _: b"\0")
    for share in cuts:
        yield damaged(format, "truncated", f"at {share}", lambda c, s=share: c[: int(s * len(c))])
    magics = {
        "zeros": bytes(16),
        "of an ELF program": b"\x7fELF" + bytes(60),
        "of a gzip file": b"\x1f\x8b\x08",
    }
    for name, magic in magics.items() if magic_at is not None else ():
        yield damaged(
            format,
            "wrong magic",
            name,
            lambda c, m=magic: c[:magic_at] + m + c[magic_at + len(m) :],
        )
    yield damaged(format, "wrong magic", "a web page", lambda _: b"<!DOCTYPE html><html></html>\n")
    if format.text:
        yield damaged(format, "wrong encoding", "UTF-16", _as("utf-16"))
        yield damaged(format, "wrong encoding", "UTF-32", _as("utf-32"))
        yield damaged(format, "wrong encoding", "bytes", lambda c: c + b"\xff\xfe\x80 \xc3\x28\n")

    def sparse(size: int) -> Callable[[Path], Path]:
        def make(folder: Path) -> Path:
            path = format.write(folder)
            os.truncate(path, size)  # takes no room on the disk
            return path

        return make

    def endless(folder: Path) -> Path:
        path = format.write(folder)
        path.unlink()
        path.symlink_to("/dev/zero")
        return path

    yield Case(format, "too large", "5 GiB", sparse(5 * 2**30))
    yield Case(format, "too large", "1 TiB", sparse(2**40))
    yield Case(format, "too large", "a device without end", endless)


def _as(encoding: str) -> Callable[[bytes], bytes]:
    return lambda content: content.decode().encode(encoding)


def escapes(
    format: Format, inside: str, name: Callable[[Path, str], None], *, links_only: bool = False
) -> Iterator[Case]:
    """Ways out of the folder: `name(path, other)` makes the file at `path` name `other` for `inside`.

    What is named is there, and valid.
    """

    def outside(folder: Path) -> Path:
        whole = folder / "whole"
        whole.mkdir(parents=True)
        format.valid(whole)
        return whole / inside

    def case(how: str, named: Callable[[Path, Path], str]) -> Case:
        def make(folder: Path) -> Path:
            target = outside(folder)
            own = folder / "own"
            own.mkdir()
            path = format.write(own)
            (own / inside).unlink()
            name(path, named(own, target))
            return path

        return Case(format, "path escape", f"{inside}: {how}", make)

    def link(own: Path, target: Path) -> str:
        (own / inside).symlink_to(target)
        return inside

    def link_to_folder(own: Path, target: Path) -> str:
        (own / "linked").symlink_to(target.parent, target_is_directory=True)
        return f"linked/{inside}"

    yield case("a symbolic link", link)
    if not links_only:
        yield case("two dots", lambda own, target: f"../whole/{inside}")
        yield case("two dots within", lambda own, target: f"../own/../whole/{inside}")
        yield case("absolute", lambda own, target: str(target))
        yield case("a linked folder", link_to_folder)
