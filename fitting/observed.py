"""All that was observed in a fit: photographs in stacks, their pages on devices, and a sample of them."""

from collections.abc import Sequence
from functools import cached_property

import jax
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Float, Int

from fitting.distances import sample_distances
from fitting.inputs import Photograph
from fitting.observation import Group, stacks
from fitting.pages import Pages

__all__ = ["Observed"]


class Observed:
    """The photographs of a fit, on one device or on a mesh of several.

    With a `fitted_law` the attenuation of point lights is searched; `fair` asks for a sample that
    has no more bright points than the whole.
    """

    def __init__(
        self,
        photographs: Sequence[Photograph],
        mesh: Mesh | None = None,
        *,
        fitted_law: bool = False,
        fair: bool = False,
    ) -> None:
        self.photographs = tuple(photographs)
        self.stacks, self.order = stacks(photographs, fitted_law=fitted_law)
        self.pages = Pages(self.stacks, mesh)
        self.fair = fair
        self.dtype = np.dtype(photographs[0].gbuffer.normal.x.dtype)
        self.channel_count = photographs[0].channel_count

    @cached_property
    def used(self) -> Int[np.ndarray, "K"]:
        """How many pixels of each photograph are used, clipped ones among them."""
        counts = [
            p.gbuffer.pixel_count if p.given is None else int(p.valid.sum())
            for p in self.photographs
        ]
        return np.array(counts)

    @property
    def count(self) -> int:
        """How many observations there are: used pixels times channels."""
        return int(self.used.sum()) * self.channel_count

    @cached_property
    def _sample(self) -> tuple[Group, ...]:
        return tuple(stack.sample(bright=not self.fair) for stack in self.stacks)

    @cached_property
    def sample(self) -> tuple[Group, ...]:
        """Some points of every stack, on a device."""
        return jax.device_put(self._sample)

    @cached_property
    def norm(self) -> float:
        """|I| over the sample, which is the unit of a search; 1 where all is dark."""
        squares = [
            np.einsum("kcp,kcp,kp->", g.observed, g.observed, g.weight) for g in self._sample
        ]
        return float(sum(squares)) ** 0.5 or 1.0

    @cached_property
    def distance(self) -> float | None:
        """The geometric mean of the distances of the sample's points to the lights they are lit by."""
        logarithms = np.concatenate([sample_distances(group) for group in self._sample])
        return float(np.exp(np.mean(logarithms))) if logarithms.size else None

    def in_order(self, of_images: Float[np.ndarray, "K"]) -> Float[np.ndarray, "K"]:
        """From numbers in the order of the stacks to that of the photographs."""
        return of_images[np.argsort(self.order)]
