"""Bounds on every coefficient, and where the search may look."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from diffshade.errors import BadInput
from diffshade.reflectance.material import Material
from diffshade.reflectance.names import coefficient
from fitting.arrays import Array
from fitting.gauge import Node, PolynomialGauge
from fitting.model import Model, full_names, linear_names
from fitting.shapes import SHAPES, kind_of, shape_names

__all__ = ["Bounds", "Grid", "Limits", "ceiling_grid", "limits"]

Bound = float | int | None
Bounds = Mapping[str, tuple[Bound, Bound]]

REFLECTED = (0.0, 1.0)
"""Of k_a, k_d and k_s by default: a share of the light."""


class Grid(NamedTuple):
    """Nodes over u: every choice of shapes with every law of attenuation.

    `shapes` are the choices, a row each; `distinct` the rows that show all there are of each column
    that depends on some of them, `chosen` which of these a choice has; `laws` the constants of an
    attenuation, a row each (one without columns where none is fitted). `near_shapes` and `near_laws`
    say which rows are next to each other.
    """

    shapes: Float[np.ndarray, "N l"] | Float[Array, "N l"]
    distinct: tuple[Int[np.ndarray, "_"] | Int[Array, "_"], ...]
    chosen: Int[np.ndarray, "N c"] | Int[Array, "N c"]
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
        grid, count = self.grid, self.grid.shapes.shape[1]
        shapes = np.clip(grid.shapes, lower[:count], upper[:count]).astype(dtype)
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
    for names in model.searched:
        pairs = [_edges(kind_of(start, name), name, given.get(name)) for name in names]
        low, high = max(low for low, _ in pairs), min(high for _, high in pairs)
        if low > high:
            raise BadInput(
                f"bounds of {' and '.join(names)}, which are one number, leave nothing between"
                f" {low:g} and {high:g}: give them bounds that overlap"
            )
        edges.append((np.log(low), np.log(high)))
    if gauge is not None:
        edges += [(0.0, np.inf) if value is None else (value, value) for value in gauge.held]
    box = np.array(edges, float).reshape(-1, 2).T
    reads = tuple(model.reads.values())
    grid = _grid(_axes(model), reads, None if gauge is None else gauge.nodes)
    if start_given and model.searched:
        grid = _with_start(grid, reads, [_log_start(start, names[0]) for names in model.searched])
    return Limits(lower, upper, natural, is_held, (box[0], box[1]), grid)


def _edges(kind: str, name: str, given: tuple[Bound, Bound] | None) -> tuple[float, float]:
    """Lower and upper bound of one shape."""
    least, most = SHAPES[kind].bounds
    low, high = given or (None, None)
    low, high = least if low is None else float(low), most if high is None else float(high)
    if not 0 < low <= high:
        raise BadInput(f"bounds of {name} are {low:g} to {high:g}: give 0 < lower <= upper")
    return low, high


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
    known = (*linear_names(start), *shape_names(start))
    full: dict[str, tuple[Bound, Bound]] = {}
    for name, pair in bounds.items():
        full |= dict.fromkeys(full_names(name, known, "bounds"), pair)
    return full


def _axes(model: Model) -> tuple[tuple[str, str], ...]:
    """Of each unknown which of `SHAPES` it is, and of a width the type of its lobe, else nothing."""
    axes = []
    for name, *_ in model.searched:
        kind = kind_of(model.material, name)
        of_width = kind in ("shininess", "alpha")
        lobe = model.material.specular[int(name.split(".")[1])] if of_width else None
        axes.append((kind, "" if lobe is None else type(lobe).__name__))
    return tuple(axes)


@cache
def _grid(
    axes: tuple[tuple[str, str], ...],
    reads: tuple[tuple[int, ...], ...],
    laws: tuple[Node, ...] | None,
) -> Grid:
    """Coarse nodes over u; of lobes of one type the first is the sharper."""
    chosen: list[tuple[int, ...]] = [()]
    for k, (kind, lobe) in enumerate(axes):
        # A larger exponent and a smaller alpha are sharper
        last = max((j for j in range(k) if lobe and axes[j][1] == lobe), default=None)
        chosen = [
            (*node, n)
            for node in chosen
            for n in range(len(SHAPES[kind].nodes))
            if last is None or (n < node[last] if kind == "shininess" else n > node[last])
        ]
    nodes = [np.log(SHAPES[kind].nodes) for kind, _ in axes]
    rows = [[values[n] for values, n in zip(nodes, row, strict=True)] for row in chosen]
    return _grid_of(np.array(rows).reshape(len(chosen), -1), chosen, reads, laws or (((), ()),))


def ceiling_grid(
    model: Model, nearest: float, farthest: float, lobes: Grid | Sequence[float]
) -> Grid:
    """Over attenuations whose clamp acts at some of the distances: with the shapes of another grid, or
    the lobes as they are.
    """
    assert isinstance(model.gauge, PolynomialGauge)
    laws = model.gauge.ceiling_nodes(nearest, farthest)
    if isinstance(lobes, Grid):
        values, near = _laws(laws)
        return lobes._replace(laws=values, near_laws=near)
    shapes = np.array([lobes], float).reshape(1, -1)
    return _grid_of(shapes, [(0,) * len(lobes)], tuple(model.reads.values()), laws)


def _grid_of(
    shapes: Float[np.ndarray, "N l"],
    chosen: Sequence[tuple[int, ...]],
    reads: tuple[tuple[int, ...], ...],
    laws: Sequence[Node],
) -> Grid:
    """Rows are next to each other whose numbers on the axes differ by one at the most."""
    values, near_laws = _laws(laws)
    near_shapes = _near(np.array(chosen, int).reshape(len(chosen), -1))
    return Grid(shapes, *_distinct(shapes, reads), values, near_shapes, near_laws)


def _laws(laws: Sequence[Node]) -> tuple[Float[np.ndarray, "M s"], Bool[np.ndarray, "M M"]]:
    steps = np.array([number for number, _ in laws], int).reshape(len(laws), -1)
    return np.array([law for _, law in laws], float).reshape(len(laws), -1), _near(steps)


def _near(numbers: Int[np.ndarray, "N l"]) -> Bool[np.ndarray, "N N"]:
    return (np.abs(numbers[:, None] - numbers[None]) <= 1).all(-1)


def _distinct(
    shapes: Float[np.ndarray, "N l"], reads: tuple[tuple[int, ...], ...]
) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Of each column the rows that differ in what it reads, and which of these each row is."""
    found = [
        np.unique(shapes[:, own], axis=0, return_index=True, return_inverse=True)[1:]
        for own in reads
    ]
    chosen = [which.ravel() for _, which in found]
    each = np.array(chosen, np.int32).reshape(len(reads), len(shapes)).T
    return tuple(first.astype(np.int32) for first, _ in found), each


def _with_start(grid: Grid, reads: tuple[tuple[int, ...], ...], start: list[float]) -> Grid:
    """A grid with the shapes of a start; where that is the lowest of all it is a basin of its own."""
    shapes = np.append(grid.shapes, [start], axis=0)
    near = np.pad(grid.near_shapes, (0, 1))
    near[-1] = True
    distinct, chosen = _distinct(shapes, reads)
    return grid._replace(shapes=shapes, distinct=distinct, chosen=chosen, near_shapes=near)


def _log_start(material: Material, name: str) -> float:
    with np.errstate(divide="ignore"):  # a start of 0 is clipped to the lower bound
        return float(np.log(coefficient(material, name)))
