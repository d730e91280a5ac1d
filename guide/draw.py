"""Draws the pictures of GUIDE.md: `python guide/draw.py`. Needs matplotlib (the extra `notebook`).

The photographs are those of the capture that ships with the package, spoilt as cameras spoil them.
"""

from pathlib import Path

import matplotlib
import numpy as np

import diffshade as ds
from diffshade import plot
from diffshade.io.capture import Capture
from diffshade.io.image import write_png
from diffshade.io.read_capture import read_capture

matplotlib.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).resolve().parent
CAPTURE = Path(ds.__file__).parent / "captures" / "glossy_ball"
EXPOSURE = 1.4
CLIPPED = np.array(plot.REASONS["clipped"])


def photographs(capture: Capture) -> dict[str, np.ndarray]:
    """By the name of its file, each picture for display."""
    image = capture.images[0]
    brightest = float(image.max())
    room = ds.Scene(lights=ds.ParallelLight(direction=(0.9, 0.7, 0.3), intensity=0.3))
    from_the_window = np.asarray(
        ds.render(capture.gbuffer, room, ds.Material(kd=(0.7, 0.15, 0.05)))
    )
    clipped = np.minimum(image * 1.7 / brightest, 1)
    shown = plot.tone(clipped)
    shown[clipped.max(axis=-1) >= 0.98] = CLIPPED
    dark = (
        np.rint(image / brightest * 0.06 * 255) / 255 / 0.06 * brightest
    )  # 8 bits, then brightened
    return {
        "good": plot.tone(image, EXPOSURE),
        "clipped": shown,
        "dark": plot.tone(dark, EXPOSURE),
        "room": plot.tone(image + from_the_window, EXPOSURE),
    }


def place() -> None:
    """Where things stand, from the camera and from above, and what position a lamp has."""
    figure, axes = plt.subplots(1, 2, figsize=(7.2, 3.1), dpi=80, layout="constrained")
    lamp = np.array([7.5, 5.0, 15.0])
    for axis, (i, j), title in zip(
        axes, ((0, 1), (0, 2)), ("as the camera sees it", "from above"), strict=True
    ):
        axis.add_patch(plt.Circle((0, 0), 1, color="#b5533c"))
        axis.plot(lamp[i], lamp[j], "o", color="#e69f00", markersize=11)
        axis.plot([0, lamp[i], lamp[i]], [0, 0, lamp[j]], "--", color="0.55", linewidth=1)
        axis.annotate(
            f"{'xyz'[i]} = {lamp[i]:g}",
            (lamp[i] / 2, 0),
            (0, -13),
            ha="center",
            textcoords="offset points",
        )
        axis.annotate(
            f"{'xyz'[j]} = {lamp[j]:g}", (lamp[i], lamp[j] / 2), (6, 0), textcoords="offset points"
        )
        axis.annotate("lamp", lamp[[i, j]], (0, 11), ha="center", textcoords="offset points")
        axis.annotate("ball, radius 1", (0, 0), (-12, 12), ha="right", textcoords="offset points")
        axis.set(title=title, aspect="equal", xlim=(-8.5, 12.5))
        axis.set_axis_off()
    axes[0].set_ylim(-4, 8)
    axes[1].set_ylim(-5, 26)
    axes[1].annotate("camera, far away", (0, 24.5), ha="center")
    axes[1].annotate("", (0, 24), (0, 2), arrowprops={"arrowstyle": "->", "color": "0.3"})
    figure.savefig(HERE / "place.png")


def main() -> None:
    """Write all of them beside this file."""
    for name, picture in photographs(read_capture(CAPTURE)).items():
        write_png(HERE / f"{name}.png", picture)
    place()


if __name__ == "__main__":
    main()
