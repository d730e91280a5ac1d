"""What the commands say: messages on standard error, results on standard output.

Progress is drawn by `diffshade.progress`; what is said here goes above its bars.
"""

import json
import sys
from collections.abc import Mapping
from typing import IO, Any

__all__ = ["WrongUsage", "note", "said", "show", "to_text"]


class WrongUsage(ValueError):
    """Options that contradict each other, or what the command can do; the message is one line."""


def note(message: str) -> None:
    """Say what the user should know in one line, on standard error."""
    said(" ".join(["diffshade:", *message.splitlines()]), sys.stderr)


def show(document: Mapping[str, Any], report: str, *, as_json: bool) -> None:
    """Print a result on standard output: one JSON object, or the report for people."""
    said(to_text(document) if as_json else report, sys.stdout)


def said(text: str, file: IO[str]) -> None:
    """Print a text, above what bars of progress there are."""
    if "tqdm" in sys.modules:  # it is imported where a bar is drawn
        from tqdm import tqdm

        tqdm.write(text, file=file)
        file.flush()
    else:
        print(text, file=file, flush=True)


def to_text(document: Mapping[str, Any]) -> str:
    """A result as JSON, strictly: a NaN or an infinity in it is an error of this program."""
    return json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False)
