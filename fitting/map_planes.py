"""What the fit of a block of pixels gives, whoever fits it: planes in one order."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from diffshade.reflectance.material import Material
from fitting.model import linear_names
from fitting.shapes import is_shape, shape_names

__all__ = ["MapPlanes", "map_names", "width"]


class MapPlanes(NamedTuple):
    """Of n pixels: m numbers each, and what is found of the pixels themselves.

    The m numbers are those of `map_names`, one a channel or one. `left` and `square` are |r|^2 and
    |observed|^2 over the used observations.
    """

    values: Float[np.ndarray, "m n"]
    standard_errors: Float[np.ndarray, "m n"]
    nominal_errors: Float[np.ndarray, "m n"]
    identified: Bool[np.ndarray, "m n"]
    noise: Float[np.ndarray, "n"]
    converged: Bool[np.ndarray, "n"]
    left: Float[np.ndarray, "n"]
    square: Float[np.ndarray, "n"]


def map_names(material: Material) -> tuple[str, ...]:
    """The coefficients of a material that have maps."""
    return (*linear_names(material), *shape_names(material))


def width(name: str, channel_count: int) -> int:
    """How many planes a coefficient has: the channels share a shape."""
    return 1 if is_shape(name) else channel_count
