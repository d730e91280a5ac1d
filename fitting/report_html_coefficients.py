"""What a fit found, on the page: the coefficients, whether the minimum is the best, correlations."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element

from fitting.report_markup import (
    Child,
    element,
    listing,
    number,
    optional,
    scrolling,
    table_head,
)
from fitting.report_plot import curve_plot
from fitting.report_rows import LAWS, Row, attenuation_rows, material_rows, reference_rows
from fitting.report_text import between, channel_names, uncertain

__all__ = ["coefficients_section", "correlations_section", "minimum_section"]

Document = Mapping[str, Any]

MANY = 24
"""Correlations of more coefficients than these are a list of the strongest, not a table."""
ALIKE = 0.995
"""Correlations this strong are named: of the two only a combination is known."""


def coefficients_section(document: Document) -> list[Element]:
    """The tables of values, errors and intervals, and what is not identified, with the remedy."""
    truth = document.get("truth") or {}
    known = {**truth, **(truth.get("attenuation") or {})}
    material = (*material_rows(document), *attenuation_rows(document))
    tables = [_rows_table(document, material, "Recovered coefficients", known)]
    attenuation = document["coefficients"]["attenuation"]
    measured = reference_rows(document)
    if measured:
        square = " + l2 (d/d0)²" if "l2" in attenuation else ""
        caption = (
            f"As measured, at the reference distance d0 = {attenuation['reference_distance']:.4g}:"
            f" f(d) = f(d0) / (l0 + l1 d/d0{square}),"
            f" where {LAWS[attenuation['kind']].replace('^2', '²')}"
        )
        tables.append(_rows_table(document, measured, caption, {}))
    reasons = [
        element("li", element("strong", ", ".join(item["coefficients"])), f": {item['reason']}")
        for item in document["unidentified"]
    ]
    if reasons:
        heading = element("h3", "Not identified, and what to do")
        tables.append(element("div", heading, element("ol", *reasons), id="unidentified"))
    return tables


def _rows_table(
    document: Document, rows: Sequence[Row], caption: str, known: Mapping[str, Any]
) -> Element:
    """A row a coefficient and channel; `known` are true values, by the names of the rows."""
    doubtful = {name for item in document["unidentified"] for name in item["coefficients"]}
    with_intervals = any(row.intervals for row in rows)
    head: list[tuple[str, str | None]] = [("coefficient", None), ("channel", None)]
    head += [("value", "number"), ("standard error", "number")]
    head += [("95 % interval", None)] * with_intervals + [("truth", "number")] * bool(known)
    head.append(("state", None))
    bodies = []
    for row in rows:
        channels = channel_names(len(row.values))
        trues = known.get(row.name)
        trues = trues if isinstance(trues, list) else [trues] * len(channels)
        vague = row.full_name in doubtful
        state = row.note or ("not identified" if vague else "")
        lines = []
        for c, channel in enumerate(channels):
            value, error = uncertain(row.values[c], row.errors[c], row.note)
            cells: list[Child] = [element("td", channel)]
            cells.append(element("td", value, class_="number"))
            shown = "" if row.note else error.replace("+/-", "±").strip("()")
            cells.append(element("td", shown, class_="number"))
            if with_intervals:
                interval = "" if row.note or not row.intervals else between(row.intervals[c])
                cells.append(element("td", interval))
            if known:
                cells.append(element("td", optional(trues[c], "g") or "", class_="number"))
            cells.append(element("td", state))
            lines.append(element("tr", *cells))
        span = str(len(channels)) if len(channels) > 1 else None
        lines[0].insert(
            0, element("th", row.name, scope="rowgroup" if span else "row", rowspan=span)
        )
        bodies.append(element("tbody", *lines, class_="doubtful" if vague else None))
    return scrolling(
        element("table", element("caption", caption), table_head(head), *bodies), caption
    )


# The minimum


def minimum_section(document: Document) -> list[Element]:
    """The objective over each shape, what a certificate says, and other minima."""
    parts = [part for curve in document.get("profile") or [] for part in _profile(document, curve)]
    certificate = document.get("certificate")
    if certificate is not None:
        parts.append(element("p", _certified(certificate)))
    basins = document.get("basins")
    if basins:
        best = number(document["relative_residual"])
        parts.append(
            element(
                "p",
                f"The best fit has the relative residual {best}. The noise does not tell it from"
                " these other minima:",
            )
        )
        parts += listing(
            f"relative residual {number(basin['relative_residual'])}: "
            + ", ".join(f"{name} {value}" for name, value in _flat(basin["coefficients"]))
            for basin in basins
        )
    elif basins is not None:
        parts.append(element("p", "No other minimum came within the noise of the best."))
    return parts


def _profile(document: Document, curve: Document) -> list[Element]:
    row = next(r for r in material_rows(document) if r.full_name == curve["names"][0])
    name, value = row.name, row.values[0]
    interval = row.intervals[0] if row.intervals and not row.note else None
    title = f"Least relative residual over the {name}"
    plot = curve_plot(
        curve["values"],
        curve["relative_residual"],
        x_label=name,
        y_label="relative residual",
        title=title,
        value=value,
        interval=interval,
    )
    if plot is None:
        return []
    says = f"{title}, all linear coefficients at their best for it."
    if value is not None:
        says += f" Dashed: the recovered value, {value:.6g}."
    if interval is not None:
        says += f" Band: its 95 % interval, {between(interval)}."
    figure = element("figure", plot, element("figcaption", says))
    return [scrolling(figure, title)]


def _certified(certificate: Document) -> str:
    ends = certificate.get("shininess")
    over = f" at any shininess from {ends[0]:,g} to {ends[1]:,g}" if ends else ""
    reason = f" {certificate['reason']}" if certificate.get("reason") else ""
    if not certificate["proven"]:
        return f"That no fit{over} is better is not proven.{reason}"
    tolerance = optional(certificate.get("tolerance"))
    by = f" by more than {tolerance} of its relative residual" if tolerance else ""
    return f"Proven: no fit{over} is better{by}.{reason}"


def _flat(values: Any, name: str = "") -> Iterator[tuple[str, str]]:
    """The numbers of nested coefficients, one text each, by their full names."""
    if isinstance(values, Mapping):
        for key, value in values.items():
            yield from _flat(value, f"{name}.{key}" if name else key)
    elif isinstance(values, list) and values and isinstance(values[0], Mapping | list):
        for j, value in enumerate(values):
            yield from _flat(value, f"{name}.{j}")
    elif isinstance(values, list):
        yield name, f"({', '.join(map(number, values))})"
    elif isinstance(values, int | float):
        yield name, number(values)


# Correlations


def correlations_section(correlations: Document | None) -> list[Element]:
    """A table with colours, and the pairs of which only a combination is known."""
    if correlations is None or len(correlations["names"]) < 2:
        return []
    names, matrix = correlations["names"], correlations["matrix"]
    pairs = [
        (matrix[i][j], names[j], names[i])
        for i in range(len(names))
        for j in range(i)
        if matrix[i][j] is not None
    ]
    pairs.sort(key=lambda pair: -abs(pair[0]))
    strong = [pair for pair in pairs if abs(pair[0]) >= ALIKE]
    parts: list[Element] = []
    if len(names) > MANY:
        parts.append(element("p", f"The strongest of {len(pairs):,}:"))
        return parts + listing(f"{a} and {b}: {r:+.3f}" for r, a, b in pairs[:20])
    caption = "How the errors of two coefficients go together: +1 alike, -1 against each other"
    rows = [
        element("tr", element("th", names[i], scope="row"), *map(_heat, matrix[i][:i]))
        for i in range(1, len(names))
    ]
    columns = [element("th", element("span", name), scope="col") for name in names[:-1]]
    head = element("thead", element("tr", element("td"), *columns))
    table = element(
        "table", element("caption", caption), head, element("tbody", *rows), class_="heat"
    )
    parts.append(scrolling(table, "Correlations"))
    if strong:
        closest = "; ".join(f"{a} and {b} ({_rounded(r)})" for r, a, b in strong[:5])
        parts.append(element("p", f"Known almost only in combination: {closest}."))
    return parts


def _heat(r: float | int | None) -> Element:
    if r is None:
        return element("td", "–")
    colour = "red" if r > 0 else "blue"
    # At most 0.6, so that the text stays readable on it.
    style = f"background: rgba(var(--{colour}), {0.6 * abs(r):.2f})"
    return element("td", f"{r:+.2f}".replace("-", "−"), style=style)


def _rounded(r: float | int) -> str:
    """Three digits, but never 1 for what is not."""
    return f"{r:+.3f}" if abs(r) < ALIKE else f"{r:+.6f}"
