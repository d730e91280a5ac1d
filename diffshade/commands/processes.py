"""One fit by several processes: this one starts those that run on this machine, and watches over them.

Each is a `diffshade.commands.worker`; JAX joins them, and they share the pixels out. This process does
no work of its own, so that it can always tell what became of the others: if one dies, or if not all have
come in time, it ends the rest and says so. If it ends itself, so do they.
"""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from queue import Empty, Queue
from threading import Thread
from time import monotonic
from typing import IO, Any

from diffshade.commands.console import WrongUsage, note
from diffshade.progress import bar

__all__ = ["LOST", "Team", "fit_together", "team_of"]

LOST = 69
"""The exit status of a fit that lost a process; that of an unavailable service in BSD's sysexits.h."""
GRACE = 3.0
"""Seconds: what one process says it lost is another that dies just now."""


Events = Queue[tuple[int, dict[str, Any]]]
"""A process, and what of it: {"joined": true}, its status and what it wrote, or {"ended": code}."""


@dataclass(frozen=True)
class Team:
    """Processes 0 to `count` - 1, of which `here` run on this machine, and where they meet.

    `patience` is how many seconds they wait for one that does not come, or gives no sign of life.
    """

    count: int
    here: tuple[int, ...]
    coordinator: str
    patience: float

    @staticmethod
    def local(count: int, patience: float) -> Team:
        """All processes on this machine, which meet at a port that is free."""
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        return Team(count, tuple(range(count)), f"127.0.0.1:{port}", patience)

    def named(self, process: int) -> str:
        return f"process {process + 1} of {self.count}"


def team_of(
    processes: int | None, process: tuple[int, int] | None, coordinator: str | None, patience: float
) -> Team | None:
    """The team that options ask for: all of it here, or one process of it; None for none."""
    if not 0 < patience < float("inf"):
        raise WrongUsage(f"--patience {patience:g}: give a number of seconds above 0")
    if processes is not None:
        if process is not None or coordinator is not None:
            raise WrongUsage(
                "--processes starts all of them here: leave out --process, --coordinator"
            )
        if processes < 1:
            raise WrongUsage(f"--processes {processes}: give 1 or more")
        return Team.local(processes, patience)
    if (process is None) != (coordinator is None):
        raise WrongUsage("--process and --coordinator are given together, or neither")
    if process is None or coordinator is None:
        return None
    return Team(process[1], (process[0] - 1,), coordinator, patience)


class _Lost(Exception):
    """What became of a process, for people."""


def fit_together(team: Team, command: Mapping[str, Any]) -> int:
    """`diffshade fit` with these options by all processes of a team; returns the exit status."""
    events: Events = Queue()
    what = f"fitting by {team.count} processes, which meet at {team.coordinator}"
    with bar(what), ExitStack() as running:
        errors = {i: running.enter_context(_running(team, i, command, events)) for i in team.here}
        try:
            last = _watched(team, events, errors)
        except _Lost as lost:
            note(f"{lost}; the fit is lost, and its processes here are ended")
            return LOST
    sys.stderr.write(last["errors"])
    sys.stdout.write(last["output"])
    sys.stdout.flush()
    return int(last["status"])


def _watched(team: Team, events: Events, errors: Mapping[int, IO[bytes]]) -> dict[str, Any]:
    """How the first process here ended, or another that failed; raises `_Lost` where one is lost."""
    deadline = monotonic() + team.patience
    joined: set[int] = set()
    ended: set[int] = set()
    done: dict[int, dict[str, Any]] = {}
    while len(done) < len(team.here):
        # JAX itself notices one that hangs later.
        waiting = len(joined) < len(team.here)
        try:
            process, event = events.get(timeout=max(deadline - monotonic(), 0) if waiting else None)
        except Empty:
            raise _Lost(_absent(team, joined)) from None
        if "joined" in event:
            joined.add(process)
        elif "ended" in event:
            ended.add(process)
            if process not in done:
                ending = _ending(event["ended"], errors[process])
                raise _Lost(f"{team.named(process)} {ending}")
        else:
            done[process] = event
            if event["status"] == LOST:
                _blame_the_dead(team, events, errors, done)
                raise _Lost(f"{team.named(process)} could not go on: {event['errors']}")
            if event["status"] not in (0, 1):
                return event
    _await_the_end(team, events, ended)
    return done[team.here[0]]


def _await_the_end(team: Team, events: Events, ended: set[int]) -> None:
    """Let them take leave of the others, which may not be done yet."""
    deadline = monotonic() + team.patience
    while len(ended) < len(team.here):
        try:
            process, event = events.get(timeout=max(deadline - monotonic(), 0))
        except Empty:
            return
        if "ended" in event:
            ended.add(process)


def _absent(team: Team, joined: set[int]) -> str:
    """Who did not come."""
    waited = f"within {team.patience:g} s"
    if len(team.here) < team.count:
        return (
            f"not all {team.count} processes came to {team.coordinator} {waited}: start each, with the"
            " same --coordinator and its own --process, or give more --patience"
        )
    absent = ", ".join(str(i + 1) for i in team.here if i not in joined)
    return f"process {absent} of {team.count} did not come {waited}: give more --patience"


def _blame_the_dead(
    team: Team,
    events: Events,
    errors: Mapping[int, IO[bytes]],
    done: Mapping[int, dict[str, Any]],
) -> None:
    """Raise `_Lost` for a process that ended without a word, if one does so now."""
    until = monotonic() + GRACE
    while (left := until - monotonic()) > 0:
        try:
            process, event = events.get(timeout=left)
        except Empty:
            return
        if "ended" in event and process not in done:
            ending = _ending(event["ended"], errors[process])
            raise _Lost(f"{team.named(process)} {ending}")


def _ending(code: int, errors: IO[bytes]) -> str:
    """How a process ended that said nothing, by its exit code and its standard error."""
    errors.seek(0)
    said = [line for line in errors.read().decode(errors="replace").splitlines() if line.strip()]
    if any("JAX distributed service detected" in line for line in said):
        return "lost touch with the others: one of them has died, or cannot be reached any more"
    if code < 0:
        known = {s.value: s.name for s in signal.Signals}
        ending, told = f"was ended by {known.get(-code, f'signal {-code}')}", said[:1]
    else:
        ending, told = f"ended before it was done, with status {code}", said[-1:]
    return ending + "".join(f" ({line.strip()[:200]})" for line in told)


@contextmanager
def _running(
    team: Team, process: int, command: Mapping[str, Any], events: Queue[Any]
) -> Iterator[IO[bytes]]:
    """A worker that runs, whose messages become events; gives its standard error. Ended at the end."""
    order = {
        "process": process,
        "count": team.count,
        "coordinator": team.coordinator,
        "patience": team.patience,
        "shares_machine": len(team.here) == team.count,
        "command": dict(command),
    }
    with (
        tempfile.TemporaryFile() as errors,
        subprocess.Popen(
            [sys.executable, "-m", "diffshade.commands.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            encoding="utf-8",
        ) as worker,
    ):
        assert worker.stdin is not None
        try:
            worker.stdin.write(json.dumps(order) + "\n")
            worker.stdin.flush()  # and it stays open: its end is that of this process
            Thread(target=_listen, args=(process, worker, events), daemon=True).start()
            yield errors
        finally:
            worker.kill()


def _listen(process: int, worker: subprocess.Popen[str], events: Queue[Any]) -> None:
    assert worker.stdout is not None
    for line in worker.stdout:
        events.put((process, json.loads(line)))
    events.put((process, {"ended": worker.wait()}))
