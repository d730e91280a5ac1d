"""The images of a fit, on the page: the residual of each, and the pictures."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any
from xml.etree.ElementTree import Element

from fitting.report_markup import Child, element, listing, number, scrolling, table_head

__all__ = ["ImagePanels", "Pictures", "pictures_section", "reasons", "residuals_section"]

Document = Mapping[str, Any]

FEW = 6
"""Images that get the width of the page; more share it."""


@dataclass(frozen=True)
class ImagePanels:
    """PNG files of one image: as photographed, as predicted, the residual, and what was left out."""

    observed: bytes
    predicted: bytes
    residual: bytes
    left_out: bytes


@dataclass(frozen=True)
class Pictures:
    """The pictures of a fit, an entry an image, and what is to be known to read them.

    `exposure` multiplies the linear light of the first two panels; +-`scale` is the residual at the
    ends of `residual_colours`, from below to above 0. `reasons` names the colours of the last panel.
    Colours are of CSS.
    """

    panels: tuple[ImagePanels, ...]
    exposure: float
    scale: float
    residual_colours: tuple[str, ...]
    reasons: Mapping[str, str]


def residuals_section(document: Document, *, linked: bool) -> list[Element]:
    """The residual of each image as a bar, what was left out of it, and which is the worst."""
    rows = document["per_image"]
    found = [r["relative_residual"] for r in rows if r["relative_residual"] is not None]
    if not rows:
        return []
    largest = max(found, default=0.0)
    suspects = {item["file"]: item["reason"] for item in document.get("suspect_images") or []}
    left_out, gains = reasons(document), document.get("gains")
    head: list[tuple[str, str | None]] = [("image", None), ("relative residual", None)]
    head += [(name, "number") for name in ("pixels used", *(why for _, why in left_out))]
    lines = []
    for k, row in enumerate(rows):
        residual = row["relative_residual"]
        share = 100 * residual / largest if residual is not None and largest else 0
        bar = element("span", element("span", style=f"width: {share:.1f}%"), class_="bar")
        name = element("a", row["file"], href=f"#image-{k + 1}") if linked else row["file"]
        cells: list[Child] = [
            element("th", name, scope="row"),
            element("td", bar, number(residual)),
            *(
                element("td", f"{row[key]:,}", class_="number")
                for key in ("pixels_used", *(key for key, _ in left_out))
            ),
        ]
        if gains is not None:
            cells.append(element("td", _gain(gains[k]), class_="number"))
        worst = len(rows) > 1 and residual is not None and residual == largest
        lines.append(element("tr", *cells, class_="worst" if worst else None))
    head += [("gain", "number")] if gains is not None else []
    caption = "relative residual and pixels of each image"
    table = element(
        "table",
        element("caption", caption.capitalize()),
        table_head(head),
        element("tbody", *lines, class_="rows"),
    )
    parts = [element("p", _worst(rows, found))] if len(found) > 1 else []
    parts += listing(f"{file} disagrees with the others: {why}" for file, why in suspects.items())
    return [*parts, scrolling(table, caption)]


def _worst(rows: Sequence[Document], found: Sequence[float | int]) -> str:
    worst = max(rows, key=lambda row: row["relative_residual"] or 0.0)
    middle = median(found)
    times = f", {max(found) / middle:.2g} times the median" if middle > 0 else ""
    return f"Worst: {worst['file']}, {number(worst['relative_residual'])}{times}."


def reasons(document: Document) -> list[tuple[str, str]]:
    """The keys of `per_image` that count pixels which had no say, and why they had none."""
    every = (
        ("pixels_clipped", "clipped"),
        ("pixels_unusable", "not finite or not opaque"),
    )
    return [(k, why) for k, why in every if all(k in row for row in document["per_image"])]


def _gain(gain: Any) -> str:
    return ", ".join(map(number, gain)) if isinstance(gain, list) else number(gain)


def pictures_section(document: Document, pictures: Pictures) -> list[Element]:
    """Four pictures an image, as a figure each, and how to read them."""
    rows = document["per_image"]
    left_out = reasons(document)
    figures = [
        _figure(row, left_out, panels, k)
        for k, (row, panels) in enumerate(zip(rows, pictures.panels, strict=True), 1)
    ]
    gradient = f"background: linear-gradient(90deg, {', '.join(pictures.residual_colours)})"
    legend = element(
        "ul",
        element(
            "li",
            f"residual: −{pictures.scale:g}",
            element("span", style=gradient, class_="scale"),
            f"+{pictures.scale:g}",
        ),
        *(
            element("li", element("span", style=f"background: {colour}", class_="swatch"), why)
            for why, colour in pictures.reasons.items()
        ),
        class_="legend",
    )
    how = (
        f"Observed and predicted: linear × {pictures.exposure:g}, then sRGB. Residual: observed −"
        " predicted of the channel where it is largest; red where the photograph is brighter, blue"
        " where it is darker, grey stripes where the pixel was left out."
    )
    few = " few" if len(figures) <= FEW else ""
    return [element("p", how), legend, element("div", *figures, class_=f"images{few}")]


def _figure(
    row: Document, left_out: Sequence[tuple[str, str]], panels: ImagePanels, place: int
) -> Element:
    file = row["file"]
    counts = [f"{row[key]:,} {why}" for key, why in left_out]
    alone = (
        ("observed", panels.observed, f"{file} as photographed"),
        ("predicted", panels.predicted, f"{file} as the fit predicts it"),
        (
            "residual",
            panels.residual,
            f"Residual of {file}; its relative residual is {number(row['relative_residual'])}",
        ),
        ("left out", panels.left_out, f"Pixels of {file} left out: {', '.join(counts)}"),
    )
    images = [
        element("div", element("img", src=_data_uri(png), alt=alt), element("span", label))
        for label, png, alt in alone
    ]
    caption = element(
        "figcaption",
        element("strong", file),
        f": relative residual {number(row['relative_residual'])}; {', '.join(counts)}",
    )
    return element("figure", caption, element("div", *images, class_="panels"), id=f"image-{place}")


def _data_uri(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"
