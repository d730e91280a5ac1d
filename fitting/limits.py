"""Bounds on every coefficient, and where the search may look."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from diffshade.errors import BadInput
from diffshade.reflectance.material import Material
from fitting.gauge import Node, PolynomialGauge
from fitting.model import Model, coefficient, full_names, linear_names, shininess_names

__all__ = ["Bounds", "Grid", "Limits", "ceiling_grid", "limits"]

Bound = float | int | None
Bounds = Mapping[str, tuple[Bound, Bound]]

REFLECTED = (0.0, 1.0)
"""Of k_a, k_d and k_s by default: a share of the light."""
SHININESS = (0.1, 1e5)

SHININESS_NODES = np.log(np.geomspace(1.0, 3000.0, 15))


class Grid(NamedTuple):
    """Nodes over u, and which of them are next to each other."""

    nodes: Float[np.ndarray, "N q"] | Float[Array, "N q"]
    adjacent: Bool[np.ndarray, "N N"] | Bool[Array, "N N"]


@dataclass(frozen=True)
class Limits:
    """Bounds of the linear coefficients [C, p] (equal where held), the box of u, and its grid.

    With a fitted attenuation k_d and k_s have no scale of their own, and `upper` does not bound them;
    `natural_upper` holds the bounds that they have once the scale is set.
    """

    lower: Float[np.ndarray, "C p"]
    upper: Float[np.ndarray, "C p"]
    natural_upper: Float[np.ndarray, "C p"]
    held: Bool[np.ndarray, "C p"]
    box: tuple[Float[np.ndarray, "q"], Float[np.ndarray, "q"]]
    grid: Grid

    @property
    def edges(self) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """Lower and upper bounds of k, channel after channel, and then of u."""
        lower, upper = self.box
        return np.append(self.lower, lower), np.append(self.upper, upper)

    def searched(self, dtype: np.dtype) -> tuple[Grid, tuple[Array, Array]]:
        """The grid and the box, on the device."""
        nodes = np.clip(self.grid.nodes, *self.box).astype(dtype)
        box = tuple(np.asarray(edge, dtype) for edge in self.box)
        nodes, adjacent, box = jax.device_put((nodes, self.grid.adjacent, box))
        return Grid(nodes, adjacent), box


def limits(
    model: Model, held: frozenset[str], start: Material, bounds: Bounds, *, start_given: bool
) -> Limits:
    """The limits of a model; `bounds` overrides the defaults by name."""
    given = _by_full_name(bounds, start)
    names = linear_names(start)
    columns = [_column(name, name in held, start, given, model.channel_count) for name in names]
    lower, natural = np.array(columns, float).reshape(-1, 2, model.channel_count).transpose(1, 2, 0)
    is_held = np.tile([name in held for name in names], (model.channel_count, 1))
    gauge = model.gauge
    floating = gauge is not None and gauge.floating
    open_above = np.array([floating and name != "ka" for name in names]) & (natural != 0)
    upper = np.where(open_above, np.inf, natural)

    edges = []
    for j in model.searched:
        low, high = given.get(f"specular.{j}.shininess", SHININESS)
        low, high = SHININESS[0] if low is None else low, SHININESS[1] if high is None else high
        if not 0 < low <= high:
            raise BadInput(
                f"bounds of specular.{j}.shininess are {low:g} to {high:g}: give 0 < lower <= upper"
            )
        edges.append((np.log(low), np.log(high)))
    if gauge is not None:
        edges += [(0.0, np.inf) if value is None else (value, value) for value in gauge.held]
    box = np.array(edges, float).reshape(-1, 2).T
    grid = _grid(len(model.searched), None if gauge is None else gauge.nodes)
    if start_given:
        # Where the start is the lowest of all it is a basin of its own.
        nodes = np.concatenate([grid.nodes, _start(model, start)[None]])
        adjacent = np.pad(grid.adjacent, (0, 1))
        adjacent[-1] = True
        grid = Grid(nodes, adjacent)
    return Limits(lower, upper, natural, is_held, (box[0], box[1]), grid)


def _column(
    name: str, held: bool, start: Material, given: Bounds, channel_count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bound of one linear coefficient, a number a channel."""
    if held:
        value = np.asarray(coefficient(start, name))
        if value.size not in (1, channel_count):
            raise BadInput(
                f"{name} is held at {value.size} numbers where the images have {channel_count}"
                " channels: give one, or one a channel"
            )
        return np.broadcast_to(value, channel_count), np.broadcast_to(value, channel_count)
    low, high = given.get(name, REFLECTED)
    low = -np.inf if low is None else low
    high = np.inf if high is None else high
    if not low <= high:
        raise BadInput(f"bounds of {name} are {low:g} to {high:g}: give lower <= upper")
    return np.full(channel_count, low), np.full(channel_count, high)


def _by_full_name(bounds: Bounds, start: Material) -> dict[str, tuple[Bound, Bound]]:
    known = (*linear_names(start), *shininess_names(start))
    full: dict[str, tuple[Bound, Bound]] = {}
    for name, pair in bounds.items():
        full |= dict.fromkeys(full_names(name, known, "bounds"), pair)
    return full


@cache
def _grid(lobe_count: int, laws: tuple[Node, ...] | None) -> Grid:
    """Coarse nodes over u; of two lobes the first is the sharper."""
    # What is varied, by its number on the axis: adjacent nodes differ by one at the most.
    steps: list[tuple[int, ...]] = [()]
    for _ in range(lobe_count):
        axis = range(len(SHININESS_NODES))
        steps = [(*node, n) for node in steps for n in axis if not node or n < node[-1]]
    values = [tuple(SHININESS_NODES[n] for n in node) for node in steps]
    if laws is not None:
        values = [(*node, *law) for node in values for _, law in laws]
        steps = [(*node, *number) for node in steps for number, _ in laws]
    return _grid_of(steps, values)


def ceiling_grid(model: Model, u: Float[np.ndarray, "q"], nearest: float, farthest: float) -> Grid:
    """Over attenuations whose clamp acts at some of the distances; the lobes stay at those of u."""
    assert isinstance(model.gauge, PolynomialGauge)
    lobes = tuple(u[: len(model.searched)].tolist())
    numbers, laws = zip(*model.gauge.ceiling_nodes(nearest, farthest), strict=True)
    return _grid_of(numbers, [(*lobes, *law) for law in laws])


def _grid_of(steps: Sequence[tuple[int, ...]], values: Sequence[tuple[float, ...]]) -> Grid:
    """Nodes; those are next to each other whose numbers on the axes differ by one at the most."""
    count = len(steps)
    at = np.array(steps, int).reshape(count, -1)
    adjacent = (np.abs(at[:, None] - at[None]) <= 1).all(-1)
    return Grid(np.array(values, float).reshape(count, -1), adjacent)


def _start(model: Model, start: Material) -> np.ndarray:
    """The u of the material as given; an attenuation starts in the middle of its triangle."""
    lobes = [np.log(float(coefficient(start, f"specular.{j}.shininess"))) for j in model.searched]
    law = () if model.gauge is None else model.gauge.middle
    return np.array([*lobes, *law], float)
