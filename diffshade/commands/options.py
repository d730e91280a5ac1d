"""Options that are more than a word: parsed, checked, and refused in one line."""

import math
import re
from argparse import ArgumentTypeError

__all__ = ["circle", "coordinator", "encoding", "held", "level", "share"]


def level(text: str) -> float:
    """A level above 0."""
    value = _numbers(text)
    _check(len(value) == 1 and value[0] > 0, text, "a number above 0")
    return value[0]


def circle(text: str) -> tuple[float, float, float]:
    """A centre and a radius in pixels, "cx,cy,r"."""
    value = _numbers(text)
    _check(len(value) == 3 and value[2] > 0, text, "cx,cy,r in pixels, with r above 0")
    return value[0], value[1], value[2]


def encoding(text: str) -> str | float:
    """ "linear", "srgb" or a gamma."""
    if text in ("linear", "srgb"):
        return text
    value = _numbers(text)
    _check(len(value) == 1 and value[0] > 0, text, "linear, srgb or a gamma such as 2.2")
    return value[0]


def held(text: str) -> tuple[str, tuple[float, ...]]:
    """A coefficient and the value it is held at, "kd=0.5" or "kd=0.5,0.4,0.3"."""
    name, _, number = text.partition("=")
    value = _numbers(number)
    wanted = "NAME=VALUE, one number or one a channel, none below 0"
    if "=" not in text:
        wanted += " (a CAPTURE goes before --hold)"
    _check(min(value, default=-1) >= 0, text, wanted)
    return name, value


def share(text: str) -> tuple[int, int]:
    """One of several, counted from 1: "2/4"."""
    found = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text)
    i, n = map(int, found.groups()) if found else (0, 0)
    _check(1 <= i <= n, text, "I/N with I from 1 to N, such as 2/4")
    return i, n


def coordinator(text: str) -> str:
    """A host and a port, "host:port"."""
    found = re.fullmatch(r"[^\s:]+:(\d{1,5})|\[[^\s\]]+\]:(\d{1,5})", text)
    port = int(found[1] or found[2]) if found else 0
    _check(1 <= port <= 65535, text, "host:port, such as 10.0.0.1:5000")
    return text


def _numbers(text: str) -> tuple[float, ...]:
    """Finite numbers between commas; none where anything else is among them."""
    try:
        values = tuple(map(float, text.split(",")))
    except ValueError:
        return ()
    return values if all(map(math.isfinite, values)) else ()


def _check(holds: bool, text: str, wanted: str) -> None:
    if not holds:
        raise ArgumentTypeError(f"{text.strip()}: give {wanted}")
