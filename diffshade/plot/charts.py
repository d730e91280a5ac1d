"""Charts: each draws on the axes that it is given, or on those of a new figure, and returns them.

Matplotlib (the extra `notebook`) is imported when the first is drawn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from diffshade import gallery
from diffshade.arrays import ArrayLike
from diffshade.colour.cie import SRGB, Primaries
from diffshade.errors import BadInput
from diffshade.reflectance.lobe import AbstractLobe

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "chromaticities",
    "correlations",
    "cosine_powers",
    "lobes",
    "objective",
    "recovered",
    "residuals",
    "trade_off",
]

LEAST = 1e-12
"""Errors below, zero among them, are drawn here on a logarithmic axis."""
MARKERS = "osD^vPX*"


def cosine_powers(exponents: Sequence[float], *, ax: Axes | None = None) -> Axes:
    """max(0, cos alpha)^n over the angle alpha from 0 to 90 degrees (LIGHT-5): a curve for each n.

    >>> axes = cosine_powers([1, 10])
    >>> [line.get_label() for line in axes.lines]
    ['$n = 1$', '$n = 10$']
    """
    ax = _axes(ax)
    alpha = np.linspace(0, 90, 181)
    curves = np.asarray(gallery.cosine_powers(exponents, np.radians(alpha)))
    for n, curve in zip(exponents, curves, strict=True):
        ax.plot(alpha, curve, label=f"$n = {n:g}$")
    ax.set(xlabel=r"$\alpha$ in degrees", ylabel=r"$(\cos\alpha)^n$", xlim=(0, 90), ylim=(0, 1.02))
    ax.legend()
    return ax


def lobes(named: Mapping[str, AbstractLobe], incidence: float, *, ax: Axes | None = None) -> Axes:
    """How much of a light each lobe sends where, in the plane of incidence, in polar form.

    The light of strength 1 comes in from the left at `incidence` radians from the normal, which points
    up; the distance from the middle is the radiance k_s s that a viewer in that direction sees. A line
    of dashes is the mirror direction. The first lobe has the widest line, so that others show on it.
    `ax` has to be polar (projection="polar").

    >>> import diffshade as ds
    >>> len(lobes({"Phong": ds.Phong(0.5, 20)}, 0.5).lines)  # and the mirror direction
    2
    """
    from matplotlib.ticker import MaxNLocator

    ax = _axes(ax, projection="polar")
    if ax.name != "polar":
        raise BadInput('lobes needs polar axes: make them with projection="polar"')
    view = np.unique(
        np.concatenate(
            [
                np.linspace(-np.pi / 2, np.pi / 2, 721),
                np.clip(incidence + np.linspace(-0.1, 0.1, 201), -np.pi / 2, np.pi / 2),
            ]
        )
    )
    largest = 0.0
    for k, (name, lobe) in enumerate(named.items()):
        radiance = np.asarray(gallery.cross_section(lobe, incidence, view))
        ax.plot(view, radiance, label=name, linewidth=len(named) - k)
        largest = max(largest, float(radiance.max()))
    ax.plot([incidence, incidence], [0, 1.05 * largest], "--", color="grey", linewidth=0.8)
    ax.set_theta_zero_location("N")  # type: ignore[attr-defined]
    ax.set_theta_direction(-1)  # type: ignore[attr-defined]
    ax.set_thetalim(-np.pi / 2, np.pi / 2)  # type: ignore[attr-defined]
    ax.set_rlim(0, 1.05 * largest)  # type: ignore[attr-defined]
    ticks = MaxNLocator(4).tick_values(0, largest)
    ax.set_yticks([tick for tick in ticks if 0 < tick <= 1.05 * largest])
    return ax


def residuals(
    residuals: ArrayLike, *, noise: float | None = None, bins: int = 60, ax: Axes | None = None
) -> Axes:
    """A histogram of residuals as a density; with `noise` the normal density that they should have.

    `noise` is a standard deviation in the unit of the residuals. What is not finite, as of pixels that
    were left out, is not counted. The last bins hold all that lies beyond.

    >>> axes = residuals([-0.1, 0.0, 0.1, np.nan], noise=0.1, bins=4)
    >>> len(axes.patches), len(axes.lines)
    (4, 1)
    """
    ax = _axes(ax)
    values = np.ravel(np.asarray(residuals, np.float64))
    values = values[np.isfinite(values)]
    if not values.size:
        raise BadInput("residuals has no finite number: there is nothing to draw")
    reach = float(np.quantile(np.abs(values), 0.998)) if noise is None else 5 * noise
    edges = np.linspace(-1, 1, bins + 1) * (reach or 1.0)
    counts = np.histogram(np.clip(values, edges[0], edges[-1]), edges)[0]
    width = edges[1] - edges[0]
    ax.bar(edges[:-1], counts / (values.size * width), width, align="edge", color="0.75")
    if noise is not None:
        x = np.linspace(edges[0], edges[-1], 201)
        density = np.exp(-0.5 * (x / noise) ** 2) / (noise * np.sqrt(2 * np.pi))
        ax.plot(x, density, color="C3", label=rf"normal, $\sigma$ = {noise:.2g}")
        ax.legend()
    ax.set(xlabel="observed - predicted", ylabel="density", xlim=(edges[0], edges[-1]))
    ax.locator_params(axis="x", nbins=5)
    return ax


def objective(
    values: ArrayLike,
    relative_residual: ArrayLike,
    *,
    value: float | None = None,
    interval: tuple[float, float] | None = None,
    true: float | None = None,
    name: str = "$n$",
    ax: Axes | None = None,
) -> Axes:
    """The relative residual over one shape, as `fit.profiles` has it; both axes are logarithmic.

    What was found, its interval and the truth, where one is known, are marked.

    >>> axes = objective([1, 10, 100], [0.3, 0.1, 0.2], value=12.0, interval=(9.0, 16.0))
    >>> [line.get_label() for line in axes.lines[1:]]
    ['found: 12']
    """
    ax = _axes(ax)
    ax.loglog(np.asarray(values), np.asarray(relative_residual), color="C0")
    if interval is not None:
        ax.axvspan(*interval, color="C0", alpha=0.2, linewidth=0, label="95 % interval")
    if value is not None:
        ax.axvline(value, color="C0", linewidth=1, label=f"found: {value:.4g}")
    if true is not None:
        ax.axvline(true, color="C3", linewidth=1, linestyle="--", label=f"true: {true:.4g}")
    ax.set(xlabel=name, ylabel="relative residual")
    if ax.get_legend_handles_labels()[1]:
        ax.legend()
    return ax


def correlations(
    names: Sequence[str], matrix: Float[np.ndarray, "m m"], *, ax: Axes | None = None
) -> Axes:
    """A correlation matrix, as `fit.correlations` has it: -1 is blue, 1 red, a number in each cell.

    A cell that is NaN, of what the images do not tell, stays grey.

    >>> axes = correlations(("ka", "kd"), np.array([[1.0, -0.9], [-0.9, 1.0]]))
    >>> [text.get_text() for text in axes.texts]
    ['1.00', '-0.90', '-0.90', '1.00']
    """
    ax = _axes(ax)
    ax.set_facecolor("0.8")
    shown = np.ma.masked_invalid(np.asarray(matrix, np.float64))
    ax.imshow(shown, cmap="RdBu_r", vmin=-1, vmax=1)
    for (row, column), r in np.ndenumerate(matrix):
        text = f"{r:.2f}" if np.isfinite(r) else "?"
        colour = "white" if abs(r) > 0.7 else "black"
        ax.text(column, row, text, ha="center", va="center", fontsize=8, color=colour)
    ax.set_xticks(range(len(names)), names, rotation=30, ha="right")
    ax.set_yticks(range(len(names)), names)
    return ax


def recovered(
    true: Mapping[str, float],
    found: Mapping[str, float],
    intervals: Mapping[str, tuple[float, float]],
    *,
    ax: Axes | None = None,
) -> Axes:
    """What was found over what is true, a coefficient a row, with its interval; 1 is right.

    What lies beyond -1 and 3 is drawn there: an interval that reaches them may be of any length.
    Raises `BadInput` for a truth of 0, to which nothing has a ratio.

    >>> axes = recovered({"kd": 0.5}, {"kd": 0.51}, {"kd": (0.48, 0.54)})
    >>> [f"{x:.2f}" for x in axes.lines[0].get_xdata()]
    ['1.02']
    """
    if not all(true.values()):
        raise BadInput("a true coefficient is 0, to which nothing has a ratio: leave it out")
    ax = _axes(ax)
    for row, (name, truth) in enumerate(true.items()):
        low, high = intervals[name]
        low, value, high = np.clip([x / truth for x in (low, found[name], high)], -1, 3)
        reach = [[value - low], [high - value]]
        ax.errorbar([value], [row], xerr=reach, fmt="o", color="C0", capsize=4)
    ax.axvline(1, color="C3", linewidth=1, linestyle="--")
    ax.set_yticks(range(len(true)), list(true))
    ax.set(xlabel="found / true", ylim=(max(len(true), 1) - 0.5, -0.5))
    return ax


def chromaticities(
    colours: Float[np.ndarray, "N 2"] | None = None,
    *,
    screens: Mapping[str, Primaries] | None = None,
    outline: Float[np.ndarray, "M 2"] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """The chromaticity diagram (x, y) of 1931: colours as points, screens as triangles with their white.

    `screens` are by name, sRGB's where none are given; `outline` is drawn closed, such as the
    chromaticities of single wavelengths.

    >>> axes = chromaticities(np.array([[0.3, 0.3]]))
    >>> axes.lines[0].get_xdata().tolist()  # the triangle of sRGB
    [0.64, 0.3, 0.15, 0.64]
    """
    ax = _axes(ax)
    for name, screen in (screens or {"sRGB": SRGB}).items():
        corners = np.array([screen.red, screen.green, screen.blue, screen.red])
        (drawn,) = ax.plot(corners[:, 0], corners[:, 1], label=name)
        ax.plot(*screen.white, marker="+", linestyle="none", color=drawn.get_color())
    if outline is not None:
        closed = np.concatenate([outline, outline[:1]])
        ax.plot(closed[:, 0], closed[:, 1], color="0.5", linewidth=1)
    if colours is not None:
        ax.plot(colours[:, 0], colours[:, 1], "o", color="black", markersize=4)
    ax.set(xlabel="$x$", ylabel="$y$", aspect="equal")
    ax.legend()
    return ax


def trade_off(
    ways: Mapping[str, Sequence[tuple[str, float, float]]], *, ax: Axes | None = None
) -> Axes:
    """Error against run time, a curve a way, each point (label, milliseconds, error); less is better.

    Both axes are logarithmic; errors below 1e-12, which are rounding, are drawn there.

    >>> axes = trade_off({"float32": [("few pixels", 1.0, 1e-2), ("all", 8.0, 0.0)]})
    >>> axes.lines[0].get_ydata().tolist()
    [0.01, 1e-12]
    """
    ax = _axes(ax)
    for (name, points), marker in zip(ways.items(), MARKERS, strict=False):
        labels, milliseconds, errors = zip(*points, strict=True)
        shown = np.maximum(errors, LEAST)
        ax.plot(milliseconds, shown, marker=marker, linewidth=1, label=name)
        for label, x, y in zip(labels, milliseconds, shown, strict=True):
            ax.annotate(label, (x, y), fontsize=7, xytext=(4, 4), textcoords="offset points")
    ax.set(xscale="log", yscale="log", xlabel="run time, milliseconds", ylabel="error")
    ax.legend(fontsize=8)
    ax.grid(which="major", color="0.9")
    return ax


def _axes(given: Axes | None, **subplot: str) -> Axes:
    """The axes given, or those of a new figure, which Matplotlib's pyplot knows and shows."""
    if given is not None:
        return given
    import matplotlib.pyplot as plt

    return plt.figure(layout="constrained").add_subplot(**subplot)
