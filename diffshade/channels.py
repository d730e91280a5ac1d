"""Colour channels: any number of them, and one value for all wherever they do not differ.

A tuple of planes holds one for every channel, or one that all channels share: a grey light on a grey
lobe is summed once, not three times.
"""

from typing import TypeVar

from jaxtyping import Array, Float

from diffshade.errors import BadInput

__all__ = ["Channels", "channels", "pairs", "per_channel", "plus", "times"]

Plane = Float[Array, "..."]
Channels = tuple[Plane, ...]
T = TypeVar("T")


def channels(coefficient: Plane) -> Channels:
    """A coefficient channel by channel: one number for all, [C] numbers, or [C, P] planes."""
    return (coefficient,) if coefficient.ndim == 0 else tuple(coefficient)


def per_channel(values: tuple[T, ...], count: int) -> tuple[T, ...]:
    """One value a channel, from one a channel already or one for all."""
    if len(values) not in (1, count):
        raise BadInput(
            f"{len(values)} channels meet {count}: give lights, coefficients and colours one number"
            " for all channels, or the same number of channels each"
        )
    return values * count if len(values) == 1 else values


def pairs(a: Channels, b: Channels) -> tuple[tuple[Plane, Plane], ...]:
    """Both channel by channel."""
    count = max(len(a), len(b))
    return tuple(zip(per_channel(a, count), per_channel(b, count), strict=True))


def plus(a: Channels, b: Channels) -> Channels:
    """The sum channel by channel."""
    return tuple(p + q for p, q in pairs(a, b))


def times(a: Channels, b: Channels) -> Channels:
    """The product channel by channel."""
    return tuple(p * q for p, q in pairs(a, b))
