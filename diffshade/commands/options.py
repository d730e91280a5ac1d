"""Options that are more than a word: parsed, checked, and refused in one line."""

import math
import re

from diffshade.commands.console import WrongUsage

__all__ = [
    "parse_circle",
    "parse_coordinator",
    "parse_encoding",
    "parse_hold",
    "parse_share",
    "parse_white",
]


def parse_white(text: str | None) -> float | None:
    """A level above 0."""
    if text is None:
        return None
    (level,) = _numbers("--white", text, 1, "a number above 0")
    if level <= 0:
        raise WrongUsage(f"--white {text}: give a number above 0")
    return level


def parse_circle(text: str | None) -> tuple[float, float, float] | None:
    """A centre and a radius in pixels, "cx,cy,r"."""
    if text is None:
        return None
    cx, cy, radius = _numbers("--circle", text, 3, "cx,cy,r in pixels")
    if radius <= 0:
        raise WrongUsage(f"--circle {text}: give a radius above 0")
    return cx, cy, radius


def parse_encoding(text: str | None) -> str | float | None:
    """ "linear", "srgb" or a gamma."""
    if text is None or text in ("linear", "srgb"):
        return text
    wanted = "linear, srgb or a gamma such as 2.2"
    (gamma,) = _numbers("--encoding", text, 1, wanted)
    if gamma <= 0:
        raise WrongUsage(f"--encoding {text}: give {wanted}")
    return gamma


def parse_hold(text: str) -> tuple[str, tuple[float, ...]]:
    """A coefficient and the value it is held at, "kd=0.5" or "kd=0.5,0.4,0.3"."""
    name, _, value = text.partition("=")
    wanted = f"{name}=VALUE, one number or one a channel, none below 0"
    values = _numbers("--hold", text, None, wanted, value)
    if min(values) < 0:
        raise WrongUsage(f"--hold {text}: give {wanted}")
    return name, values


def parse_share(option: str, text: str | None) -> tuple[int, int] | None:
    """One of several, counted from 1: "2/4"."""
    if text is None:
        return None
    found = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text)
    share, shares = map(int, found.groups()) if found else (0, 0)
    if not 1 <= share <= shares:
        raise WrongUsage(f"{option} {text}: give I/N with I from 1 to N, such as 2/4")
    return share, shares


def parse_coordinator(text: str | None) -> str | None:
    """A host and a port, "host:port"."""
    if text is not None:
        found = re.fullmatch(r"[^\s:]+:(\d{1,5})|\[[^\s\]]+\]:(\d{1,5})", text)
        port = int(found[1] or found[2]) if found else 0
        if not 1 <= port <= 65535:
            raise WrongUsage(f"--coordinator {text}: give host:port, such as 10.0.0.1:5000")
    return text


def _numbers(
    option: str, text: str, count: int | None, wanted: str, value: str | None = None
) -> tuple[float, ...]:
    """Finite numbers between commas, as many as `count` says if it does."""
    try:
        values = tuple(map(float, (text if value is None else value).split(",")))
    except ValueError:
        values = ()
    if not values or count not in (None, len(values)) or not all(map(math.isfinite, values)):
        raise WrongUsage(f"{option} {text}: give {wanted}")
    return values
