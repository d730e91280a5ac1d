"""Bounds on every coefficient, and where the search may look."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from diffshade.errors import BadInput
from diffshade.reflectance.material import Material
from fitting.arrays import Array
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
    """Nodes over u: every choice of lobes' shapes with every law of attenuation.

    `shapes` are those that each searched lobe may have, `chosen` which of them go together, a row a
    choice; `laws` the constants of an attenuation, a row each (one without columns where none is
    fitted). `near_shapes` and `near_laws` say which rows are next to each other.
    """

    shapes: tuple[Float[np.ndarray, "_"] | Float[Array, "_"], ...]
    chosen: Int[np.ndarray, "N l"] | Int[Array, "N l"]
    laws: Float[np.ndarray, "M s"] | Float[Array, "M s"]
    near_shapes: Bool[np.ndarray, "N N"] | Bool[Array, "N N"]
    near_laws: Bool[np.ndarray, "M M"] | Bool[Array, "M M"]


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

    def searched(self, dtype: np.dtype) -> tuple[Grid, tuple[np.ndarray, np.ndarray]]:
        """The grid within the box, and the box, in that precision."""
        lower, upper = (np.asarray(edge, dtype) for edge in self.box)
        grid, count = self.grid, len(self.grid.shapes)
        shapes = tuple(
            np.clip(nodes, lower[j], upper[j]).astype(dtype) for j, nodes in enumerate(grid.shapes)
        )
        laws = np.clip(grid.laws, lower[count:], upper[count:]).astype(dtype)
        return grid._replace(shapes=shapes, laws=laws), (lower, upper)


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
    if start_given and model.searched:
        grid = _with_start(grid, [float(np.log(_shininess(start, j))) for j in model.searched])
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
    chosen: list[tuple[int, ...]] = [()]
    for _ in range(lobe_count):
        axis = range(len(SHININESS_NODES))
        chosen = [(*node, n) for node in chosen for n in axis if not node or n < node[-1]]
    return _grid_of((SHININESS_NODES,) * lobe_count, chosen, laws or (((), ()),))


def ceiling_grid(
    gauge: PolynomialGauge, nearest: float, farthest: float, lobes: Grid | Sequence[float]
) -> Grid:
    """Over attenuations whose clamp acts at some of the distances: with the shapes of another grid, or
    the lobes as they are.
    """
    laws = gauge.ceiling_nodes(nearest, farthest)
    if isinstance(lobes, Grid):
        only = _grid_of(lobes.shapes, [tuple(row) for row in lobes.chosen.tolist()], laws)
        return only._replace(near_shapes=lobes.near_shapes)
    return _grid_of(tuple(np.array([lobe]) for lobe in lobes), [(0,) * len(lobes)], laws)


def _grid_of(
    shapes: tuple[np.ndarray, ...], chosen: Sequence[tuple[int, ...]], laws: Sequence[Node]
) -> Grid:
    """Rows are next to each other whose numbers on the axes differ by one at the most."""
    numbers = np.array(chosen, np.int32).reshape(len(chosen), -1)
    steps = np.array([number for number, _ in laws], int).reshape(len(laws), -1)
    near_shapes, near_laws = (
        (np.abs(at[:, None] - at[None]) <= 1).all(-1) for at in (numbers, steps)
    )
    values = np.array([law for _, law in laws], float).reshape(len(laws), -1)
    return Grid(shapes, numbers, values, near_shapes, near_laws)


def _with_start(grid: Grid, start: list[float]) -> Grid:
    """A grid with the lobes of a start; where that is the lowest of all it is a basin of its own."""
    shapes = tuple(np.append(nodes, value) for nodes, value in zip(grid.shapes, start, strict=True))
    chosen = np.append(grid.chosen, [[len(nodes) - 1 for nodes in shapes]], axis=0)
    near = np.pad(grid.near_shapes, (0, 1))
    near[-1] = True
    return grid._replace(shapes=shapes, chosen=chosen.astype(np.int32), near_shapes=near)


def _shininess(material: Material, lobe: int) -> float:
    return float(coefficient(material, f"specular.{lobe}.shininess"))
