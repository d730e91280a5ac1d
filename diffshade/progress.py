"""Progress of what takes a while: told to a callback, and drawn on standard error if somebody watches."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import TypeVar

__all__ = ["Progress", "bar", "telling"]

Progress = Callable[[int, int], object]
"""Called with how much is finished, and how much there is."""

T = TypeVar("T")

DELAY = 1.0
"""Seconds: what is done by then is not drawn at all."""
TICK = 1.0
"""Seconds from one look at the clock to the next, where nothing else moves the bar."""
CLOCK = "{desc}: {elapsed}"
COUNTED = "{desc}: {n_fmt} of {total_fmt} |{bar}| {elapsed}, {remaining} left"


@contextmanager
def bar(what: str) -> Iterator[Progress | None]:
    """A bar on standard error while the block runs, by `tqdm`; gone afterwards.

    Gives what moves it, for a `progress=` of this library; until it is called, the time that has passed
    is shown. Gives None, and draws nothing, where standard error is not a terminal.

    >>> with bar("fitting maps") as progress:
    ...     print(progress)  # standard error of this example is a file
    None
    """
    if not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    done = Event()
    with tqdm(
        desc=what,
        bar_format=CLOCK,
        file=sys.stderr,
        leave=False,
        delay=DELAY,
        miniters=1,
        mininterval=0,  # each image or block takes long enough
    ) as drawn:

        def told(finished: int, count: int) -> None:
            drawn.bar_format, drawn.total = COUNTED, count
            drawn.update(finished - drawn.n)

        def tick() -> None:
            while not done.wait(TICK):
                drawn.refresh()

        clock = Thread(target=tick, daemon=True)
        clock.start()
        try:
            yield told
        finally:
            done.set()
            clock.join()


def telling(items: Iterable[T], count: int, progress: Progress | None) -> Iterator[T]:
    """The items, `progress` told of each of the `count` as the next is asked for.

    >>> list(telling("ab", 2, lambda finished, count: print(finished, "of", count)))
    1 of 2
    2 of 2
    ['a', 'b']
    """
    for finished, item in enumerate(items, 1):
        yield item
        if progress is not None:
            progress(finished, count)
