"""What the commands say: progress to a person at a terminal, results to standard output."""

import json
import sys
from collections.abc import Mapping
from typing import Any

__all__ = ["WrongUsage", "note", "progress", "show", "to_text"]


class WrongUsage(ValueError):
    """Options that contradict each other, or what the command can do; the message is one line."""


def progress(message: str) -> None:
    """Say what goes on, on standard error, if somebody watches."""
    if sys.stderr.isatty():
        print(message, file=sys.stderr, flush=True)


def note(message: str) -> None:
    """Say what the user should know in one line, on standard error."""
    print("diffshade:", *message.splitlines(), file=sys.stderr, flush=True)


def show(document: Mapping[str, Any], report: str, *, as_json: bool) -> None:
    """Print a result on standard output: one JSON object, or the report for people."""
    print(to_text(document) if as_json else report, flush=True)


def to_text(document: Mapping[str, Any]) -> str:
    """A result as JSON, strictly: a NaN or an infinity in it is an error of this program."""
    return json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False)
