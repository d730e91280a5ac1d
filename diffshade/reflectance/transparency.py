"""How a surface lets light through that comes from behind it, without refraction (text C; Foley, van Dam,
Feiner and Hughes, Computer Graphics, 1990, 16.5.1).

Light from behind goes straight on: the surface adds its own, and lets a part of the other through.
"""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diffshade.arrays import ArrayLike, coefficients, is_concrete, optional
from diffshade.channels import channels, pairs
from diffshade.errors import BadInput

__all__ = ["AbstractTransparency", "FilteredTransparency", "InterpolatedTransparency", "Share"]

Share = Float[Array, ""] | Float[Array, "C"]


class AbstractTransparency(eqx.Module):
    """How a surface's own light and that from behind it add up: I = a I_front + b I_behind."""

    @abstractmethod
    def shares(self) -> tuple[Share, Share]:
        """a and b, one number or one a channel each."""


def _share(name: str) -> Any:
    """A field converter for a part of light, in [0, 1]: one number, or one a channel."""
    to_coefficients = coefficients(name)

    def convert(value: ArrayLike) -> Share:
        array = to_coefficients(value)
        if array.ndim > 1:
            raise BadInput(f"{name} has shape {array.shape}: give one number, or one a channel [C]")
        if not isinstance(value, jax.Array) and is_concrete(array):
            numbers = np.asarray(array)
            if (numbers < 0).any() or (numbers > 1).any():
                raise BadInput(f"{name} is {numbers.tolist()}: give a part of the light, 0 to 1")
        return array

    return convert


class InterpolatedTransparency(AbstractTransparency):
    """I = (1 - k_t) I_front + k_t I_behind (Foley & van Dam 16.5.1), with k_t in [0, 1].

    0 is opaque; at 1 nothing is seen of the surface, its highlights included. As a fine mesh of opaque
    threads looks from afar, that covers a part 1 - k_t.

    >>> [share.item() for share in InterpolatedTransparency(0.25).shares()]
    [0.75, 0.25]
    """

    kt: Share = eqx.field(converter=_share("kt"))

    def shares(self) -> tuple[Share, Share]:
        return 1 - self.kt, self.kt


class FilteredTransparency(AbstractTransparency):
    """I = I_front + k_t O_t I_behind (Foley & van Dam 16.5.1), with k_t and the colour O_t in [0, 1].

    The surface is a filter of the transparency colour O_t, None for a grey one, and what it reflects is
    not less for it.

    >>> [share.item() for share in FilteredTransparency(0.5, colour=0.5).shares()]
    [1.0, 0.25]
    """

    kt: Share = eqx.field(converter=_share("kt"))
    colour: Share | None = eqx.field(converter=optional(_share("colour")), default=None)

    def __check_init__(self) -> None:
        if self.colour is not None:
            pairs(channels(self.kt), channels(self.colour))  # raises where they do not match

    def shares(self) -> tuple[Share, Share]:
        through = self.kt if self.colour is None else self.kt * self.colour
        return jnp.ones_like(self.kt), through
