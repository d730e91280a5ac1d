"""A hard scene, what must come of it, and what came."""

import time
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import jax
import numpy as np

from diffshade.errors import BadInput

__all__ = ["HARMLESS", "LIMIT", "HardScene", "Verdict", "precision", "timed", "tried"]

HARMLESS = ("right", "not identified", "refused")
"""What may come of a scene. "not finite", "wrong" (and yet confident) and "too slow" may not."""
LIMIT = 120.0
"""Seconds that ours may take of a scene, compilation included."""

T = TypeVar("T")


class Verdict(NamedTuple):
    """What came of a scene, of what that was seen, and how long ours took."""

    kind: str
    detail: str
    seconds: float = 0.0


def timed(ours: Callable[[], T]) -> tuple[T, float]:
    """The result, and the seconds that it took."""
    started = time.perf_counter()
    result = jax.block_until_ready(ours())
    return result, time.perf_counter() - started


class HardScene(NamedTuple):
    """A name, the one verdict of `HARMLESS` that is due, and what is done."""

    name: str
    due: str
    attempt: Callable[[], Verdict]
    large: bool = False
    """Gigabytes of memory: not in the tests."""


def tried(scene: HardScene) -> Verdict:
    """The verdict on a scene, in the precision that is set."""
    try:
        found = scene.attempt()
    except BadInput as error:
        return Verdict("refused", str(error))
    return found if found.seconds <= LIMIT else found._replace(kind="too slow")


def precision() -> type[np.floating]:
    """The type of numbers."""
    return jax.dtypes.canonicalize_dtype(float).type
