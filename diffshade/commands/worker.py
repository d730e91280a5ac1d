"""One of several processes that make one fit; started by `diffshade.commands.processes`.

Its order comes as one line of JSON on standard input, which then stays open as long as the parent lives.
It answers on standard output: that it has joined the others, and how it ended.
"""

from __future__ import annotations

import json
import os
import sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from threading import Thread
from typing import IO, Any

from diffshade.commands.console import WrongUsage, note
from diffshade.commands.fault import tell_fault
from diffshade.commands.processes import LOST
from diffshade.commands.settings import Bits, cache_programs, floats_of
from diffshade.errors import BadInput

__all__ = ["main"]

LEAST_HEARTBEAT = 10
"""Seconds in which JAX wants to hear of a process."""


def main() -> None:
    """Do as ordered."""
    order = json.loads(sys.stdin.readline())
    Thread(target=_end_with_parent, daemon=True).start()
    # Gloo, by which processes exchange numbers, writes to standard output on its own.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    output, errors = StringIO(), StringIO()
    with redirect_stdout(output), redirect_stderr(errors):
        status = _status(order, answers)
    _tell(answers, {"status": status, "output": output.getvalue(), "errors": errors.getvalue()})


def _status(order: dict[str, Any], answers: IO[str]) -> int:
    cache_programs()
    import jax

    process, patience = order["process"], int(order["patience"])
    try:
        jax.distributed.initialize(
            order["coordinator"],
            num_processes=order["count"],
            process_id=process,
            # Of the graphics cards of a machine that all share, each takes one.
            local_device_ids=[process] if order["shares_machine"] else None,
            # The parent, which started earlier, is the first to lose patience.
            initialization_timeout=patience + LEAST_HEARTBEAT,
            heartbeat_timeout_seconds=max(patience, LEAST_HEARTBEAT),
            shutdown_timeout_seconds=max(patience, LEAST_HEARTBEAT),
        )
        devices = jax.devices()  # waits for the others too
        _tell(answers, {"joined": True})
        return _fit(process, devices, **order["command"])
    except WrongUsage as error:
        note(f"{error}")
        return 2
    except BadInput as error:
        note(f"{error}")
        return 3
    except jax.errors.JaxRuntimeError as error:
        print(str(error).splitlines()[0][:200], end="", file=sys.stderr)
        return LOST
    except Exception as error:
        return tell_fault(error)


def _fit(
    process: int,
    devices: list[Any],
    *,
    path: str,
    out: str | None,
    precision: Bits | None,
    **options: Any,
) -> int:
    """The command; the first process alone writes the folder."""
    from diffshade.commands.fit import fit

    folder = None if out is None or process > 0 else Path(out)
    with floats_of(precision):
        return fit(Path(path), out=folder, devices=devices, **options)


def _tell(answers: IO[str], message: dict[str, Any]) -> None:
    print(json.dumps(message), file=answers, flush=True)


def _end_with_parent() -> None:
    while os.read(sys.stdin.fileno(), 1):
        pass
    os._exit(1)


if __name__ == "__main__":
    main()
