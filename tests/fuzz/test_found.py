"""What the fuzzer found, kept: each broke a parser once, by an exception, a warning or a bad message."""

import struct
from pathlib import Path

import jax
import pytest
from fuzz.target import Target
from malformed.cases import formats

FOUND = {
    "a length whose square overflows": ("light_directions.txt", "0.1", "1e308", True),
    "the same in an .lp": ("lp", "0.1", "1e308", True),
    "an intensity that is 0 in float32": ("light_intensities.txt", "0.8", "1e-320", False),
    "one that images divided by are 0": ("light_intensities.txt", "0.8", "1e300", False),
    "a coefficient that overflows float32": ("fit.json", "32.5", "1" + "0" * 156, False),
    "a constant that does": ("fit.json", "0.25", "1e60", False),
    "a colour that does": ("mtl", "0.8", "6" * 90, False),
    "a name that is too long": ("obj", "v 0 0 0", f"mtllib {'a' * 300}\nusemtl a\nv 0 0 0", True),
    "one of an image": ("lp", "b.png", "b" * 300, False),
    "an absolute path": ("capture", '"a.png"', '"/a.png"', False),
    "one that no file can have": ("filenames.txt", "a.png", "/a\0.png", False),
}
"""The parser, the change of its valid file, and whether it is read then."""


@pytest.mark.parametrize("name", FOUND)
def test_what_was_found_stays_mended(name: str, tmp_path: Path) -> None:
    parser, old, new, is_read = FOUND[name]
    (format,) = (f for f in formats() if f.name == parser)
    target = Target(format, tmp_path)
    assert old.encode() in target.valid
    with jax.enable_x64(False):
        assert target.attempt(target.valid.replace(old.encode(), new.encode(), 1)) is is_read


@pytest.mark.parametrize("parser", ["npy", "mat", "npz"])
def test_normals_that_overflow_float32_are_refused(parser: str, tmp_path: Path) -> None:
    (format,) = (f for f in formats() if f.name == parser)
    target = Target(format, tmp_path)
    number, huge = b"333333\xe3?", b"333333\xe3\x7f"  # 0.6, and 1e307 or so
    assert number in target.valid
    with jax.enable_x64(False):
        assert not target.attempt(target.valid.replace(number, huge, 1))


def test_a_signalling_nan_outside_the_object_is_a_nan(tmp_path: Path) -> None:
    (format,) = (f for f in formats() if f.name == "npy")
    target = Target(format, tmp_path)
    number, signalling = b"333333\xe3?", b"\x9a\x99\x99\x99\x99\x99\xf0\x7f"
    assert number in target.valid
    with jax.enable_x64(False):
        assert target.attempt(target.valid.replace(number, signalling, 1))


def test_exposures_that_are_no_number_are_refused(tmp_path: Path) -> None:
    """1e300 twice, and then 0."""
    (format,) = (f for f in formats() if f.name == "hdr")
    target = Target(format, tmp_path)
    lines = b"\nEXPOSURE=1e300\nEXPOSURE=1e300\nEXPOSURE=0\n"
    assert not target.attempt(target.valid.replace(b"\n", lines, 1))


def test_what_scipy_warns_of_is_refused(tmp_path: Path) -> None:
    """A file without a header, whose first number says that it is of a VAX."""
    (format,) = (f for f in formats() if f.name == "mat")
    target = Target(format, tmp_path)
    vax = struct.pack("<5i", 2000, 1, 1, 0, 10) + b"Normal_gt\0" + bytes(8)
    assert not target.attempt(vax)
