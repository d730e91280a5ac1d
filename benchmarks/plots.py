"""Run time against error, one mark a fit, from the results of `benchmarks.fitting speed`."""

from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["run_time_against_error"]

SMALLEST = 1e-12
"""Errors below, zero among them, are drawn here."""


def run_time_against_error(speed: dict[str, Any], file: Path) -> None:
    """Each method's median time on each truth and its error there, both logarithmic, as a PNG."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 5), layout="constrained")
    axes = figure.subplots()
    for name, marker in zip(speed["seconds"], "osD^vPX*", strict=False):
        errors = np.maximum(speed["errors"][name], SMALLEST)
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
