"""Error against run time, drawn from what groups of the suite measure (the extra `notebook`)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from diffshade import plot
from diffshade.plot.charts import LEAST, MARKERS

__all__ = ["DRAWN", "of_fits", "of_shading"]


def of_fits(speed: dict[str, Any], file: Path) -> None:
    """Each method's median time on each truth and its error there, both logarithmic, as a PNG."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 5), layout="constrained")
    axes = figure.subplots()
    for name, marker in zip(speed["seconds"], MARKERS, strict=False):
        errors = np.maximum(speed["errors"][name], LEAST)
        rounds = np.reshape(speed["seconds"][name], (-1, len(errors)))
        axes.scatter(1e3 * np.median(rounds, axis=0), errors, marker=marker, label=name)
    axes.axhline(1e-3, color="0.7", linewidth=1, zorder=0)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="run time, milliseconds",
        ylabel="largest error of a coefficient",
        title=f"256 x 256, three lights, unknown attenuation; starts: {speed['start']}",
    )
    axes.legend()
    axes.grid(which="major", color="0.9")
    figure.savefig(file, dpi=150)


def of_shading(curves: dict[str, Any], file: Path) -> None:
    """One picture a question, one curve a way, with what changes along it written at its points."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 9), layout="constrained")
    for axes, (title, ways) in zip(figure.subplots(2, 2).flat, curves.items(), strict=True):
        plot.trade_off(ways, ax=axes).set_title(title)
    figure.savefig(file, dpi=110)


DRAWN: dict[str, Callable[[dict[str, Any], Path], None]] = {
    "fit-speed": of_fits,
    "trade-offs": of_shading,
}
