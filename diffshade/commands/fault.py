"""What is said of an error of this program itself (exit status 70)."""

from __future__ import annotations

import platform
import sys
import traceback
from importlib.metadata import PackageNotFoundError, version

from diffshade.commands.console import note, said

__all__ = ["FAULT", "tell_fault"]

FAULT = 70
"""The exit status; that of an internal software error in BSD's sysexits.h."""


def tell_fault(error: Exception) -> int:
    """Say in one line that it is ours, and what to send; the traceback follows. Returns the status."""
    told = " ".join(str(error).split())
    kind = type(error).__name__ + f": {told[:200]}" * bool(told)
    note(
        f"a fault of diffshade itself, not of what you gave it ({kind}); please report it, with the"
        " command, the files if they may be shared, and everything from this line on"
        f" ({', '.join(_versions())})"
    )
    trace = traceback.TracebackException.from_exception(error)
    notes = getattr(error, "__notes__", [])
    # JAX's word on how it shortens tracebacks would be the last that the user reads.
    trace.__notes__ = [text for text in notes if "JAX_TRACEBACK_FILTERING" not in text]
    said("".join(trace.format()).rstrip(), sys.stderr)
    return FAULT


def _versions() -> list[str]:
    found = [f"Python {platform.python_version()}", platform.platform(terse=True)]
    for package in ("jaxlib", "jax", "diffshade"):
        try:
            found.insert(0, f"{package} {version(package)}")
        except PackageNotFoundError:  # run from a folder, not installed
            continue
    return found
