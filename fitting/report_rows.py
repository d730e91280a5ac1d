"""The coefficients of a fit document as the rows of a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

__all__ = ["Row", "attenuation_rows", "material_rows", "reference_rows"]

Document = Mapping[str, Any]
Numbers = list[float | None]


class Row(NamedTuple):
    """One coefficient: a value and a standard error a channel, or one for all.

    A `note` stands in the place of errors that there are none of, or that mean nothing.
    """

    name: str
    values: Numbers
    errors: Numbers
    note: str = ""


def material_rows(document: Document) -> list[Row]:
    """ka, kd, and the lobes."""
    values, errors = document["coefficients"], document["standard_errors"]
    rows = [
        _row(document, key, key, values[key], errors[key])
        for key in ("ka", "kd")
        if values[key] is not None
    ]
    several = len(values["lobes"]) > 1
    for j, (lobe, error) in enumerate(zip(values["lobes"], errors["lobes"], strict=True)):
        for key in ("ks", "shininess"):
            name = f"{key}, lobe {j + 1}" if several else key
            rows.append(_row(document, name, f"specular.{j}.{key}", lobe[key], error[key]))
    return rows


def attenuation_rows(document: Document) -> list[Row]:
    """c0, c1 and c2, where an attenuation was fitted."""
    values, errors = (document[k]["attenuation"] for k in ("coefficients", "standard_errors"))
    if values is None:
        return []
    rows = [
        _row(document, key, f"attenuation.{key}", values[key], errors[key])
        for key in ("c0", "c1", "c2")
    ]
    # The constant that is 1 by convention has an error of rounding only.
    sizes = [r.errors[0] / abs(r.values[0]) for r in rows if r.errors[0] and r.values[0]]
    return [
        row._replace(note="by convention")
        if row.values[0] and (row.errors[0] or 0) <= 1e-6 * max(sizes, default=0) * row.values[0]
        else row
        for row in rows
    ]


def reference_rows(document: Document) -> list[Row]:
    """What was measured at the reference distance, where an attenuation was fitted."""
    values, errors = (document[k]["attenuation"] for k in ("coefficients", "standard_errors"))
    if values is None:
        return []
    rows = [_row(document, key, key, values[key], errors[key]) for key in ("l0", "l1", "l2")]
    if values["kd"] is not None:
        rows.append(_row(document, "kd f(d0)", "kd", values["kd"], errors["kd"]))
    for j, (value, error) in enumerate(zip(values["ks"], errors["ks"], strict=True)):
        name = f"ks f(d0), lobe {j + 1}" if len(values["ks"]) > 1 else "ks f(d0)"
        rows.append(_row(document, name, f"specular.{j}.ks", value, error))
    return rows


def _row(document: Document, name: str, full_name: str, value: Any, error: Any) -> Row:
    note = "held" if full_name in document["held"] else ""
    return Row(name, _listed(value), _listed(error), note)


def _listed(value: Any) -> Numbers:
    return value if isinstance(value, list) else [value]
