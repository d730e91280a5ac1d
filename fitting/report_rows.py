"""The coefficients of a fit document as the rows of a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

__all__ = [
    "LAWS",
    "Interval",
    "Number",
    "Row",
    "attenuation_rows",
    "comparison",
    "material_rows",
    "reference_rows",
]

Document = Mapping[str, Any]
Number = float | int | None
Numbers = list[Number]
Interval = tuple[Number, Number]


class Row(NamedTuple):
    """One coefficient: a value, a standard error and an interval a channel, or one for all.

    `full_name` is the one that `unidentified` and `held` use. A `note` stands in the place of errors
    that there are none of, or that mean nothing. Without intervals there is the empty list.
    """

    name: str
    full_name: str
    values: Numbers
    errors: Numbers
    intervals: list[Interval]
    note: str = ""


def material_rows(document: Document) -> list[Row]:
    """ka, kd, and the lobes."""
    coefficients = document["coefficients"]
    rows = [
        _row(document, key, key, (key,)) for key in ("ka", "kd") if coefficients[key] is not None
    ]
    count = len(coefficients["lobes"])
    for j in range(count):
        for path in _numbers(coefficients["lobes"][j]):
            name = f"{path[-1]}, lobe {j + 1}" if count > 1 else path[-1]
            full_name = ".".join(("specular", str(j), *path))
            rows.append(_row(document, name, full_name, ("lobes", j, *path)))
    for path in _numbers(coefficients.get("body") or {}):
        rows.append(_row(document, f"{path[-1]}, body", ".".join(("body", *path)), ("body", *path)))
    return rows


def _numbers(part: Document) -> Iterator[tuple[str, ...]]:
    """The paths to the coefficients of a lobe or a body: all but its kind and what is chosen."""
    for key, value in part.items():
        if isinstance(value, Mapping):
            yield from ((key, *path) for path in _numbers(value))
        elif not isinstance(value, str | bool):
            yield (key,)


def comparison(document: Document) -> str:
    """What the models that were compared leave, the best first; empty where none were."""
    rows = document.get("compared") or []
    said = (
        f"{row['model']} {row['relative_residual']:.4g} (BIC {row['bic'] - rows[0]['bic']:+.4g})"
        for row in rows
    )
    return f"compared, by relative residual: {', '.join(said)}" if rows else ""


LAWS = {
    "quadratic": "f(d) = 1 / (c0 + c1 d + c2 d^2)",
    "linear": "f(d) = 1 / (c0 + c1 d)",
    "exponential": "f(d) = exp(-a d)",
}
"""How a fitted attenuation is written, by its kind."""


def attenuation_rows(document: Document) -> list[Row]:
    """The constants, where an attenuation was fitted: c0, c1 and c2, or what its law has."""
    attenuation = document["coefficients"]["attenuation"]
    if attenuation is None:
        return []
    rows = [
        _row(document, key, f"attenuation.{key}", ("attenuation", key))
        for key in ("c0", "c1", "c2", "a")
        if key in attenuation
    ]
    # The constant that is 1 by convention has an error of rounding only.
    sizes = [r.errors[0] / abs(r.values[0]) for r in rows if r.errors[0] and r.values[0]]
    return [
        row._replace(note="by convention")
        if row.values[0]
        and not row.note
        and row.errors[0] is not None
        and row.errors[0] <= 1e-6 * max(sizes, default=0) * row.values[0]
        else row
        for row in rows
    ]


def reference_rows(document: Document) -> list[Row]:
    """What was measured at the reference distance, where an attenuation was fitted."""
    values = document["coefficients"]["attenuation"]
    if values is None or "reference_distance" not in values:
        return []
    rows = [
        _row(document, key, f"reference.{key}", ("attenuation", key))
        for key in ("l0", "l1", "l2")
        if key in values
    ]
    if values["kd"] is not None:
        rows.append(_row(document, "kd f(d0)", "reference.kd", ("attenuation", "kd")))
    for j in range(len(values["ks"])):
        name = f"ks f(d0), lobe {j + 1}" if len(values["ks"]) > 1 else "ks f(d0)"
        full_name = f"reference.specular.{j}.ks"
        rows.append(_row(document, name, full_name, ("attenuation", "ks", j)))
    return rows


def _row(document: Document, name: str, full_name: str, path: tuple[str | int, ...]) -> Row:
    value, error = (_at(document[key], path) for key in ("coefficients", "standard_errors"))
    held = full_name.removeprefix("reference.") in document["held"]
    values = _listed(value)
    return Row(
        name,
        full_name,
        values,
        _listed(error),
        _intervals(document, path, len(values)),
        "held" if held else "",
    )


def _intervals(document: Document, path: tuple[str | int, ...], count: int) -> list[Interval]:
    if document.get("intervals") is None:
        return []
    found = _at(document["intervals"], path)
    if found is None:
        return [(None, None)] * count
    return [(low, high) for low, high in (found if isinstance(found[0], list) else [found])]


def _at(values: Any, path: tuple[str | int, ...]) -> Any:
    for key in path:
        values = values[key]
    return values


def _listed(value: Any) -> Numbers:
    return value if isinstance(value, list) else [value]
