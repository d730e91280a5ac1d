"""The lights that were refined before a fit, on the page."""

from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import Element

from fitting.report_markup import element, listing, number, scrolling, table_head
from fitting.report_text import uncertain

__all__ = ["lights_section"]


def lights_section(lights: Mapping[str, Any] | None) -> list[Element]:
    """By how much each light was turned, its gain, and which lamps moved; nothing where none was."""
    if lights is None:
        return []
    rows = [
        element(
            "tr",
            element("th", row["file"], scope="row"),
            element("td", _both(row["degrees"], row["standard_error"]), class_="number"),
            element("td", _both(row["gain"], row["gain_error"]), class_="number"),
            class_=None if row["moved"] is None else "worst",
        )
        for row in lights["per_image"]
    ]
    caption = "By how much each light was turned, and its gain, with standard errors"
    columns = [("image", None), ("turned by, degrees", "number"), ("gain", "number")]
    table = element(
        "table", element("caption", caption), table_head(columns), element("tbody", *rows)
    )
    says = (
        f"Refined by the shading: residual {number(lights['before'])} with the lights as given,"
        f" {number(lights['relative_residual'])} with these. The errors are those of noise, and more"
        " where the model is not the whole truth."
    )
    moved = [f"{row['file']}: {row['moved']}" for row in lights["per_image"] if row["moved"]]
    return [element("p", says), scrolling(table, caption), *listing(moved)]


def _both(value: float, error: float) -> str:
    return " ".join(uncertain(value, error)).replace("+/-", "±")
