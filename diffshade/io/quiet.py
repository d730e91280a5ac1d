"""Libraries that say what they think of a damaged file on standard output and error: our caller's."""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout, suppress
from io import StringIO

__all__ = ["quietly"]


@contextmanager
def quietly() -> Iterator[None]:
    """Nothing that Python code prints, and nothing that C code writes to standard error, is seen.

    For the whole process: other threads are silenced too while the block runs.
    """
    with ExitStack() as stack:
        stack.enter_context(redirect_stdout(StringIO()))
        with suppress(OSError):  # there may be no standard error
            kept = os.dup(2)
            stack.callback(os.close, kept)
            stack.callback(os.dup2, kept, 2)
            with open(os.devnull, "wb") as nowhere:
                os.dup2(nowhere.fileno(), 2)
        yield
