"""A hard scene, what must come of it, and what came."""

import time
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from diffshade.errors import BadInput

__all__ = ["HARMLESS", "LIMIT", "HardScene", "Verdict", "precision", "tried"]

HARMLESS = ("right", "not identified", "refused")
"""What may come of a scene. "not finite", "wrong" (and yet confident) and "too slow" may not."""
LIMIT = 120.0
"""Seconds a scene may take, compilation included."""


class Verdict(NamedTuple):
    """What came of a scene, and of what that was seen."""

    kind: str
    detail: str
    seconds: float = 0.0


class HardScene(NamedTuple):
    """A name, the one verdict of `HARMLESS` that is due, and what is done."""

    name: str
    due: str
    attempt: Callable[[], Verdict]
    large: bool = False
    """Gigabytes of memory: not in the tests."""


def tried(scene: HardScene) -> Verdict:
    """The verdict on a scene, in the precision that is set."""
    started = time.perf_counter()
    try:
        found = scene.attempt()
    except BadInput as error:
        found = Verdict("refused", str(error))
    seconds = time.perf_counter() - started
    if seconds > LIMIT:
        return Verdict("too slow", f"{seconds:.0f} s", seconds)
    return found._replace(seconds=seconds)


def precision() -> type[np.floating]:
    """The type of numbers."""
    return np.float64 if jnp.zeros(()).dtype == np.float64 else np.float32
