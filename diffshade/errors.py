"""The one error that input from outside raises."""

from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["BadInput", "naming"]

_LONGEST = 1000
"""Characters of a message: a file may hold a line of any length."""


class BadInput(ValueError):
    """Input that cannot be used; the message is one line: what was given, what is wrong, what to do.

    Parts of it come from files: line ends and other control characters are shown as escapes, and the
    middle of what is very long is left out.

    >>> str(BadInput("a\\nb.png: is empty"))
    'a\\\\nb.png: is empty'
    """

    def __init__(self, message: str) -> None:
        shown = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in message)
        if len(shown) > _LONGEST:
            shown = f"{shown[: _LONGEST // 2]} ... {shown[-_LONGEST // 2 :]}"
        super().__init__(shown)


@contextmanager
def naming(path: object, place: str = "") -> Iterator[None]:
    """Complaints about values, which know no file, get the name of theirs, and the place in it; others
    have it already.

    >>> with naming("a.toml"):
    ...     raise BadInput("is empty")
    Traceback (most recent call last):
    diffshade.errors.BadInput: a.toml: is empty
    """
    try:
        yield
    except BadInput as error:
        if str(error).startswith(str(path)):
            raise
        inside = f"{place}: " if place else ""
        raise BadInput(f"{path}: {inside}{error}") from None
