"""Mitsuba 3, one ray at a time: an independent renderer, where the extra `compare` is installed."""

from functools import cache
from typing import Any

import pytest

__all__ = ["mitsuba"]


@cache
def mitsuba() -> Any:
    """The module; a test that asks for it skips where it is not installed."""
    found = pytest.importorskip("mitsuba", reason="Mitsuba 3 is not installed: the extra `compare`")
    found.set_variant("scalar_rgb")
    return found
