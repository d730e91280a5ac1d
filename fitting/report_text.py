"""Fits and evaluations for people to read: aligned tables, in plain ASCII, from the JSON documents."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from fitting.report_rows import (
    LAWS,
    Interval,
    Number,
    Row,
    attenuation_rows,
    comparison,
    material_rows,
    reference_rows,
)

__all__ = [
    "between",
    "channel_names",
    "evaluation_report",
    "fit_report",
    "table",
    "truth_table",
    "uncertain",
]

Document = Mapping[str, Any]

WIDTH = 100
FEW = 12
"""Images that get a row each; of more, the worst and the best are named."""


def fit_report(document: Document, *, truth: Document | None = None) -> str:
    """Coefficients with standard errors, what is not to be trusted and why, and the residual.

    With the `truth`, named as in truth.json, the coefficients stand beside it.
    """
    attenuation = document["coefficients"]["attenuation"]
    law = f"attenuation {LAWS[attenuation['kind']]}" if attenuation else ""
    if truth is None:
        sections = [f"model {document['model']}", _wrapped(comparison(document))]
        sections.append(_rows_table(material_rows(document)))
        sections += [law, _rows_table(attenuation_rows(document))] if attenuation else []
    else:
        with_law = f"model {document['model']}{', ' * bool(law)}{law}"
        sections = [with_law, truth_table(truth, document)]
    measured = reference_rows(document)
    if measured:
        square = " + l2 (d/d0)^2" if "l2" in attenuation else ""
        sections += [
            f"as measured, at the reference distance d0 = {attenuation['reference_distance']:.4g},"
            f" f(d) = f(d0) / (l0 + l1 d/d0{square})",
            _rows_table(measured),
        ]
    sections.append(_intervals(document))
    sections.append(
        _wrapped(
            "The standard errors (+/-) are those of independent noise as large as the residual, or"
            " those by which four images or more disagree, where that is more; what the model leaves"
            " out of all images alike comes on top of them."
        )
    )
    sections += [
        _wrapped(f"not identified: {', '.join(item['coefficients'])}: {item['reason']}")
        for item in document["unidentified"]
    ]
    sections += [_residual(document)]
    sections += [
        _wrapped(f"{item['file']} disagrees with the others: {item['reason']}")
        for item in document.get("suspect_images") or []
    ]
    sections.append(_lights(document.get("lights")))
    sections.append(_notes(document))
    if not document["converged"]:
        sections.append("THE SEARCH DID NOT CONVERGE: these numbers are not a minimum.")
    return "\n\n".join(filter(None, sections))


def evaluation_report(document: Document) -> str:
    """The residual over all images, and how it differs among them."""
    return "\n\n".join(filter(None, [_residual(document), _notes(document)]))


def truth_table(truth: Document, document: Document) -> str:
    """True coefficients (named as in truth.json) beside the recovered ones."""
    lines = [("", "", "truth", "recovered", "", "difference", "in std. errors")]
    for row in (*material_rows(document), *attenuation_rows(document)):
        true = truth[row.name] if row.name in truth else truth["attenuation"][row.name]
        trues = true if isinstance(true, list) else [true] * len(row.values)
        each = zip(channel_names(len(row.values)), trues, row.values, row.errors, strict=True)
        for channel, known, value, error in each:
            number, spread = uncertain(value, error, row.note)
            difference = value - known
            relative = f"{100 * difference / known:+.4f} %" if known else f"{difference:+.2g}"
            in_errors = f"{difference / error:+.1f}" if error and not row.note else ""
            lines.append((row.name, channel, f"{known:g}", number, spread, relative, in_errors))
    return table(lines, "<<>><>>")


def uncertain(value: Number, error: Number, note: str = "") -> tuple[str, str]:
    """A value and its standard error to the same decimal, the error with two digits."""
    if value is None:
        return "not finite", ""
    if error is None or note:
        return f"{value:.6g}", f"({note or 'error unknown'})"
    if error <= 1e-10 * abs(value) or error < 1e-12:
        return f"{value:.10g}", f"+/- {error:.0e}"
    decimals = max(0, 1 - math.floor(math.log10(error)))
    return f"{value:.{decimals}f}", f"+/- {error:.{decimals}f}"


def between(interval: Interval) -> str:
    """The ends of an interval, with two digits of a quarter of its width: of a standard error.

    An end that is 0 or 1 outright is where the coefficient itself ends.
    """
    low, high = interval
    if low is None or high is None:
        if low is None and high is None:
            return "not known"
        return f"{low:.3g} or more" if low is not None else f"{high:.3g} or less"
    width = (high - low) / 4
    if width <= 1e-10 * abs(high) or width < 1e-12:
        return f"{low:.10g} to {high:.10g}"
    decimals = max(0, 1 - math.floor(math.log10(width)))
    ends = (f"{end:g} (bound)" if end in (0, 1) else f"{end:.{decimals}f}" for end in interval)
    return " to ".join(ends)


def channel_names(count: int) -> list[str]:
    """What the channels of an image are called; one has no name."""
    if count == 1:
        return [""]
    return ["red", "green", "blue"] if count == 3 else [f"channel {c + 1}" for c in range(count)]


def table(rows: Sequence[Sequence[str]], align: str) -> str:
    """Columns of equal width, each flush left ("<") or right (">"); the one after ">" sticks to it
    if it is flush left, as an error to its value."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    gaps = [" " if pair == "><" else "   " for pair in map("".join, pairwise(align))] + [""]
    return "\n".join(
        "".join(
            f"{c:{a}{w}}{g}" for c, a, w, g in zip(row, align, widths, gaps, strict=True)
        ).rstrip()
        for row in rows
    )


def _rows_table(rows: Sequence[Row]) -> str:
    """A line a coefficient, a value with its error a channel."""
    count = max((len(row.values) for row in rows), default=0)
    lines = []
    if count > 1:
        lines.append(["", *(text for channel in channel_names(count) for text in (channel, ""))])
    for row in rows:
        pairs = zip(row.values, row.errors, strict=True)
        cells = [text for value, error in pairs for text in uncertain(value, error, row.note)]
        lines.append([row.name, *cells, *[""] * (2 * count - len(cells))])
    return table(lines, "<" + "><" * count)


def _intervals(document: Document) -> str:
    """A line a coefficient that is not held, an interval a channel; nothing where there are none."""
    everything = (*material_rows(document), *attenuation_rows(document), *reference_rows(document))
    rows = [row for row in everything if row.intervals and not row.note]
    if not rows:
        return ""
    count = max(len(row.values) for row in rows)
    lines = [["", *channel_names(count)]] if count > 1 else []
    for row in rows:
        cells = [between(interval) for interval in row.intervals]
        lines.append([row.name, *cells, *[""] * (count - len(cells))])
    return f"95 % intervals\n{table(lines, '<' * (count + 1))}"


def _residual(document: Document) -> str:
    rows = document["per_image"]
    left_out = sum(row["pixels_clipped"] for row in rows)
    whole = (
        f"relative residual {_share(document['relative_residual'])} of {len(rows)}"
        f" image{'s' * (len(rows) > 1)}; {100 * document['fraction_excluded']:.3g} % of the object's"
        f" pixels left out ({left_out} clipped)"
    )
    if len(rows) <= FEW:
        return f"{whole}\n{_each_image(rows)}"
    ordered = sorted(rows, key=lambda row: row["relative_residual"] or 0.0)
    return f"{whole}\nthe best and the worst images:\n{_each_image([*ordered[:2], *ordered[-3:]])}"


def _each_image(rows: Sequence[Document]) -> str:
    lines = [("image", "residual", "pixels used", "clipped")]
    lines += [
        (
            row["file"],
            _share(row["relative_residual"]),
            f"{row['pixels_used']}",
            f"{row['pixels_clipped']}",
        )
        for row in rows
    ]
    return table(lines, "<>>>")


def _lights(lights: Document | None) -> str:
    """How the lights were refined: a line each, or of many the most turned; and which lamps moved."""
    if lights is None:
        return ""
    rows, which = lights["per_image"], ""
    if len(rows) > FEW:
        rows = sorted(rows, key=lambda row: -row["degrees"])[:5]
        which = f"; the most turned of {len(lights['per_image'])}"
    lines = [["light of", "turned by", "degrees", "gain", ""]]
    lines += [
        [
            row["file"],
            *uncertain(row["degrees"], row["standard_error"]),
            *uncertain(row["gain"], row["gain_error"]),
        ]
        for row in rows
    ]
    told = [
        f"{row['file']}: {row['moved']}" for row in lights["per_image"] if row["moved"] is not None
    ]
    head = (
        f"lights refined: residual {_share(lights['before'])} to {_share(lights['relative_residual'])};"
        f" errors (+/-) are those of noise, more where the model is not the whole truth{which}"
    )
    return "\n".join([_wrapped(head), table(lines, "<><><"), *map(_wrapped, told)])


def _share(value: Number) -> str:
    return "not finite" if value is None else f"{value:.3g}"


def _notes(document: Document) -> str:
    return "\n".join(_wrapped(f"note: {note}") for note in document["notes"])


def _wrapped(text: str) -> str:
    return textwrap.fill(
        text, WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
