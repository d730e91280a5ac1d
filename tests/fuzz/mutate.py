"""Random damage to files, from a seed: bytes, numbers in binary and in text, pieces moved about."""

import re
from collections.abc import Sequence

import numpy as np

__all__ = ["mutated"]

LARGEST = 20_000
INTEGERS = (0, 1, 127, 128, 255, 256, 32767, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 100_000)
FLOATS = (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-40, 1e30, 3e38)
WORDS = (
    *("nan", "inf", "-inf", "-1", "0", "1e308", "1e-320", "4294967296", "9" * 25, "1e999", "0x7f"),
    *("true", "null", '"x"', "[1]", "{}", "1.5", "#", "''", "..", "/", "\\", "\n", "=", ","),
)
NUMBER = re.compile(rb"-?\d+(\.\d+)?")


def mutated(content: bytes, others: Sequence[bytes], rng: np.random.Generator) -> bytes:
    """The content after one to four kinds of damage, some of it by pieces of others."""
    for _ in range(int(rng.integers(1, 5))):
        damage = DAMAGES[int(rng.integers(len(DAMAGES)))]
        content = damage(content, others, rng)[:LARGEST]
    return content


def _bit(content: bytes, others: Sequence[bytes], rng: np.random.Generator) -> bytes:
    at, bit = _place(content, rng), 1 << int(rng.integers(8))
    return (
        content[:at] + bytes([(content[at] if at < len(content) else 0) ^ bit]) + content[at + 1 :]
    )


def _binary(content: bytes, others: Sequence[bytes], rng: np.random.Generator) -> bytes:
    order = "<>"[int(rng.integers(2))]
    if rng.integers(3):
        size = int(rng.choice([1, 2, 4, 8]))
        number = int(rng.choice(INTEGERS)) % 2 ** (8 * size)
        piece = number.to_bytes(size, "little" if order == "<" else "big")
    else:
        kind = f"{order}f{int(rng.choice([4, 8]))}"
        with np.errstate(over="ignore"):
            piece = np.array(rng.choice(FLOATS)).astype(kind).tobytes()
    at = _place(content, rng)
    return content[:at] + piece + content[at + len(piece) :]


def _number(content: bytes, others: Sequence[bytes], rng: np.random.Generator) -> bytes:
    found = list(NUMBER.finditer(content))
    if not found:
        return _word(content, others, rng)
    chosen = found[int(rng.integers(len(found)))]
    return content[: chosen.start()] + _any_word(rng) + content[chosen.end() :]


def _word(content: bytes, others: Sequence[bytes], rng: np.random.Generator) -> bytes:
    at = _place(content, rng)
    return content[:at] + _any_word(rng) + content[at:]


def _removed(content: bytes, others: Sequence[bytes], rng: np.random.Generator) -> bytes:
    start, end = _span(content, rng)
    return content[:start] + content[end:]


def _repeated(content: bytes, others: Sequence[bytes], rng: np.random.Generator) -> bytes:
    start, end = _span(content, rng)
    return content[:end] + content[start:end] * int(rng.integers(1, 4)) + content[end:]


def _cut(content: bytes, others: Sequence[bytes], rng: np.random.Generator) -> bytes:
    return content[: _place(content, rng)]


def _spliced(content: bytes, others: Sequence[bytes], rng: np.random.Generator) -> bytes:
    other = others[int(rng.integers(len(others)))]
    return content[: _place(content, rng)] + other[_place(other, rng) :]


DAMAGES = (
    _bit,
    _bit,
    _binary,
    _binary,
    _number,
    _number,
    _word,
    _removed,
    _repeated,
    _cut,
    _spliced,
)


def _place(content: bytes, rng: np.random.Generator) -> int:
    """Anywhere, at the start more often: headers stand there."""
    return int(len(content) * rng.random() ** 2)


def _span(content: bytes, rng: np.random.Generator) -> tuple[int, int]:
    start = _place(content, rng)
    return start, start + int(rng.geometric(0.1))


def _any_word(rng: np.random.Generator) -> bytes:
    return WORDS[int(rng.integers(len(WORDS)))].encode()
