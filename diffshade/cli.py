"""The command line: options and exit status. No command is imported before it runs.

Exit status: 0 done; 1 ran but did not converge; 2 wrong usage; 3 bad input, with one line on standard
error that names the file, what is wrong and what to do; 69 a process of several was lost; 70 an error
of this program, with one line and then its traceback; 130 interrupted, with one line and every written
file whole; 141 its reader gone.
"""

import os
import signal
import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from diffshade.commands.console import WrongUsage, note
from diffshade.commands.settings import Bits, cache_programs, floats_of
from diffshade.commands.usage import parse
from diffshade.errors import BadInput

__all__ = ["main", "run"]


def main() -> int:
    """The program `diffshade`; returns its exit status."""
    cache_programs()
    warnings.showwarning = lambda message, *_, **__: note(f"warning: {message}")
    interrupts = _interrupts()
    try:
        return run(sys.argv[1:])
    except KeyboardInterrupt:
        return _interrupted()
    except (
        BrokenPipeError
    ):  # who read the output has gone; nor can Python's own last flush reach it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except Exception as error:
        if interrupts:  # what was interrupted said so in its own way
            return _interrupted()
        from diffshade.commands.fault import tell_fault

        return tell_fault(error)


def _interrupts() -> list[int]:
    """Grows with every interrupt (Ctrl-C), which raises KeyboardInterrupt as it did."""
    received: list[int] = []

    def receive(number: int, frame: Any) -> None:
        received.append(number)
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, receive)
    return received


def _interrupted() -> int:
    note("interrupted; every file that is there is whole")
    return 130


def run(arguments: Sequence[str]) -> int:
    """One command in this process, whose settings stay as they are; returns the exit status."""
    try:
        return _run(**parse(arguments))
    except SystemExit:  # argparse has printed the help
        sys.stdout.flush()
        return 0
    except WrongUsage as error:
        note(f"{error}")
        return 2
    except BadInput as error:
        note(f"{error}")
        return 3


def _run(command: str, *, precision: Bits | None, **options: Any) -> int:
    """The function of this name in the module of this name, in this precision."""
    if command == "fit":
        return _fit(precision=precision, **options)
    with floats_of(precision):
        module = import_module(f"diffshade.commands.{command}")
        status: int = getattr(module, command)(**options)
        return status


def _fit(
    captures: Sequence[Path],
    *,
    out: Path | None,
    precision: Bits | None,
    shard: tuple[int, int] | None,
    processes: int | None,
    process: tuple[int, int] | None,
    coordinator: str | None,
    patience: float,
    **options: Any,
) -> int:
    """One capture, by one process or several; or several captures, one after the other."""
    from diffshade.commands.processes import fit_together, team_of

    several = len(captures) > 1 or shard is not None
    team = team_of(processes, process, coordinator, patience)
    if team is not None:
        if several:
            raise WrongUsage(
                "--processes and --process make one fit together: give one CAPTURE, or else --shard"
            )
        out_name = None if out is None else str(out)
        return fit_together(
            team, {"path": str(captures[0]), "out": out_name, "precision": precision, **options}
        )
    with floats_of(precision):
        if several:
            from diffshade.commands.batch import fit_batch

            return fit_batch(captures, shard=shard or (1, 1), out=out, **options)
        from diffshade.commands.fit import fit

        return fit(captures[0], out=out, **options)
