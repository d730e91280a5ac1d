"""A curve over a logarithmic axis as an SVG element, with an interval and a value marked.

Colours come from the classes of the page: `axis`, `grid`, `curve`, `interval`, `value`.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple
from xml.etree.ElementTree import Element

from fitting.report_markup import element

__all__ = ["curve_plot", "linear_ticks", "log_ticks"]

Real = float | int

WIDTH, HEIGHT = 560, 300
LEFT, RIGHT, TOP, BOTTOM = 72, 26, 12, 48
THIN = 2.0
"""The least width at which an interval is seen."""
STEEP = 20.0
"""The largest over the smallest value, from which their axis is logarithmic too."""


class Axis(NamedTuple):
    """From values to places in the picture: from `start` to `end` over `low` to `high`."""

    low: Real
    high: Real
    start: Real
    end: Real
    logarithmic: bool

    def place(self, value: Real) -> float:
        low, high = self._scaled(self.low), self._scaled(self.high)
        return self.start + (self._scaled(value) - low) / (high - low) * (self.end - self.start)

    def ticks(self) -> list[float]:
        return (log_ticks if self.logarithmic else linear_ticks)(self.low, self.high)

    def _scaled(self, value: Real) -> float:
        return math.log(value) if self.logarithmic else value


def curve_plot(
    x: Sequence[Real],
    y: Sequence[Real | None],
    *,
    x_label: str,
    y_label: str,
    title: str,
    value: Real | None = None,
    interval: tuple[Real | None, Real | None] | None = None,
) -> Element | None:
    """y over log x; a y of None is a gap. None where fewer than two points can be drawn.

    `value` is marked by a line, `interval` by a band, open at an end that is None.

    >>> plot = curve_plot([1, 10], [0.2, 0.1], x_label="n", y_label="residual", title="n")
    >>> plot.tag, plot.get("role")
    ('svg', 'img')
    """
    points = sorted((a, b) for a, b in zip(x, y, strict=True) if b is not None and a > 0)
    if len(points) < 2 or points[0][0] == points[-1][0]:
        return None
    across = Axis(points[0][0], points[-1][0], LEFT, WIDTH - RIGHT, True)
    up = _upward([b for _, b in points])
    return element(
        "svg",
        element("title", title),
        *_grid(across, up),
        _band(across, interval),
        *_curves(across, up, x, y),
        _marker(across, value),
        element("text", x_label, x=(LEFT + WIDTH - RIGHT) / 2, y=HEIGHT - 8, text_anchor="middle"),
        element(
            "text",
            y_label,
            transform=f"translate(14 {(TOP + HEIGHT - BOTTOM) / 2}) rotate(-90)",
            text_anchor="middle",
        ),
        viewBox=f"0 0 {WIDTH} {HEIGHT}",
        class_="plot",
        role="img",
        aria_label=title,
    )


def linear_ticks(low: Real, high: Real) -> list[float]:
    """Multiples of 1, 2 or 5 times a power of ten in [low, high]: three to seven of them.

    >>> linear_ticks(0.03, 0.21)
    [0.05, 0.1, 0.15, 0.2]
    """
    rough = (high - low) / 5
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough * (1 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [float(f"{k * step:.12g}") for k in range(first, last + 1)]


def log_ticks(low: Real, high: Real) -> list[float]:
    """Powers of ten in [low, high], and 2 and 5 times them where that leaves few; else `linear_ticks`.

    >>> log_ticks(0.5, 300.0)
    [0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0]
    >>> log_ticks(1.0, 1e5)
    [1.0, 10.0, 100.0, 1000.0, 10000.0, 100000.0]
    """
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    multiples = (1, 2, 5) if math.log10(high / low) < 3.5 else (1,)
    ticks = [float(f"{m}e{p}") for p in powers for m in multiples]
    inside = [tick for tick in ticks if low * (1 - 1e-9) <= tick <= high * (1 + 1e-9)]
    return inside if len(inside) >= 3 else linear_ticks(low, high)


def _upward(values: Sequence[Real]) -> Axis:
    """The axis of the values, with room above and below."""
    low, high = min(values), max(values)
    if low > 0 and high > STEEP * low:
        return Axis(low / 1.25, high * 1.25, HEIGHT - BOTTOM, TOP, True)
    room = 0.06 * (high - low) or 0.1 * abs(high) or 1.0
    return Axis(low - room, high + room, HEIGHT - BOTTOM, TOP, False)


def _grid(across: Axis, up: Axis) -> list[Element]:
    parts = []
    for tick in across.ticks():
        x = _round(across.place(tick))
        parts.append(_line(x, TOP, x, HEIGHT - BOTTOM, "grid"))
        parts.append(
            element("text", f"{tick:,g}", x=x, y=HEIGHT - BOTTOM + 17, text_anchor="middle")
        )
    for tick in up.ticks():
        y = _round(up.place(tick))
        parts.append(_line(LEFT, y, WIDTH - RIGHT, y, "grid"))
        parts.append(element("text", f"{tick:g}", x=LEFT - 7, y=y + 4, text_anchor="end"))
    parts.append(_line(LEFT, TOP, LEFT, HEIGHT - BOTTOM, "axis"))
    parts.append(_line(LEFT, HEIGHT - BOTTOM, WIDTH - RIGHT, HEIGHT - BOTTOM, "axis"))
    return parts


def _curves(across: Axis, up: Axis, x: Sequence[Real], y: Sequence[Real | None]) -> list[Element]:
    """The pieces between gaps; a piece of one point is a dot."""
    pieces: list[list[str]] = [[]]
    for a, b in sorted(zip(x, y, strict=True), key=lambda pair: pair[0]):
        if b is None or a <= 0:
            pieces.append([])
        else:
            pieces[-1].append(f"{_round(across.place(a))},{_round(up.place(b))}")
    return [
        element(
            "polyline", points=" ".join([*piece, *piece[:1] * (len(piece) == 1)]), class_="curve"
        )
        for piece in pieces
        if piece
    ]


def _band(across: Axis, interval: tuple[Real | None, Real | None] | None) -> Element | None:
    if interval is None or interval == (None, None):
        return None
    low = across.low if interval[0] is None else max(interval[0], across.low)
    high = across.high if interval[1] is None else min(interval[1], across.high)
    if low > across.high or high < across.low:
        return None
    left, right = across.place(low), across.place(high)
    width = max(right - left, THIN)
    return element(
        "rect",
        x=_round((left + right - width) / 2),
        y=TOP,
        width=_round(width),
        height=HEIGHT - BOTTOM - TOP,
        class_="interval",
    )


def _marker(across: Axis, value: Real | None) -> Element | None:
    if value is None or not across.low <= value <= across.high:
        return None
    x = _round(across.place(value))
    return _line(x, TOP, x, HEIGHT - BOTTOM, "value")


def _line(x1: Real, y1: Real, x2: Real, y2: Real, kind: str) -> Element:
    return element("line", x1=x1, y1=y1, x2=x2, y2=y2, class_=kind)


def _round(place: Real) -> float:
    return round(place, 1)
