"""How JAX is set up for a command. The library itself leaves global settings alone."""

import os
import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Literal

__all__ = ["Bits", "cache_folder", "cache_programs", "floats_of"]

Bits = Literal[32, 64]


def floats_of(bits: Bits | None) -> AbstractContextManager[None]:
    """Floats of so many bits inside the block; None: as JAX is set, 32 unless JAX_ENABLE_X64."""
    if bits is None:
        return nullcontext()
    import jax

    context: AbstractContextManager[None] = jax.enable_x64(bits == 64)
    return context


def cache_programs() -> None:
    """Keep compiled programs on disk, small ones too, for the rest of this process.

    JAX_COMPILATION_CACHE_DIR overrides the folder, JAX_ENABLE_COMPILATION_CACHE=0 turns it off.
    Does nothing where the folder cannot be written: the programs are then compiled every time.
    """
    try:
        folder = os.environ.get("JAX_COMPILATION_CACHE_DIR") or cache_folder()
        os.makedirs(folder, exist_ok=True)
    except (OSError, RuntimeError):  # RuntimeError: nobody's home
        return
    if not os.access(folder, os.W_OK):
        return
    # By the environment, which JAX reads when it is imported: a command that needs none stays quick.
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
    # XLA of JAX 0.10.0 logs an error for every program that it loads, about tuning flags that it
    # takes for features of the processor; what really fails is raised, not logged.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def cache_folder() -> Path:
    """Where this platform keeps what can be made again."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "diffshade" / "jax"
