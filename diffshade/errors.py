"""The one error that input from outside raises."""

__all__ = ["BadInput"]


class BadInput(ValueError):
    """Input that cannot be used; the message is one line: what was given, what is wrong, what to do."""
