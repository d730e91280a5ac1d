"""What every export gives: the text of a file, its error over angles, and what was lost."""

import os
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np

from diffshade.errors import BadInput
from diffshade.export.angular_error import AngularError
from diffshade.export.coefficients import plain
from diffshade.io.atomic import replacing
from diffshade.reflectance.material import Material

__all__ = [
    "NO_AMBIENT",
    "Export",
    "check_reflects",
    "coefficients_to_json",
    "extras",
    "in_gamut",
    "lit_by",
    "write",
]

NO_AMBIENT = "the ambient term is left out, which this format has not"


class Export(NamedTuple):
    """A material in the format of another tool."""

    text: str
    """The file."""
    error: AngularError
    """Of what the other tool computes from it."""
    notes: tuple[str, ...]
    """What it cannot say, one line each."""


def write(path: str | os.PathLike[str], export: Export) -> Export:
    """Write the text of an export; atomic. Returns it."""
    with replacing(path) as temporary:
        temporary.write_text(export.text, encoding="utf-8")
    return export


def check_reflects(material: Material) -> None:
    """Raise `BadInput` for a material that reflects no light of a lamp, which a renderer shows black."""
    if material.kd is None and not material.specular:
        raise BadInput("the material has neither k_d nor a lobe: there is nothing to write")


def coefficients_to_json(material: Material) -> dict[str, Any]:
    """The exact coefficients, in the shape that "diffshade.fit/1" has them in.

    Object colours are multiplied into k_a, k_d and k_s.

    >>> coefficients_to_json(Material(kd=0.5))["kd"]
    [0.5]
    """
    lobes = [(lobe, _listed(lobe.ks, material.os)) for lobe in material.specular]
    return {
        "ka": _listed(material.ka, material.od),
        "kd": _listed(material.kd, material.od),
        "lobes": [{**_part(lobe), "ks": ks} for lobe, ks in lobes],
        "body": None if material.body is None else _part(material.body),
    }


def extras(
    material: Material, error: AngularError, notes: tuple[str, ...], irradiance: float
) -> dict[str, Any]:
    """What a file says for us beside what it says for its own tool."""
    return {
        "coefficients": coefficients_to_json(material),
        "irradiance": irradiance,
        "error": {key: list(value) for key, value in error._asdict().items()},
        "notes": list(notes),
    }


def lit_by(irradiance: float) -> float:
    """The irradiance itself; raises `BadInput` where it is none."""
    if not 0 < irradiance < float("inf"):
        raise BadInput(f"the irradiance is {irradiance}: give a number above 0")
    return float(irradiance)


def in_gamut(name: str, colour: np.ndarray, enough: float) -> list[float]:
    """A colour that is at most 1; raises `BadInput`, with the irradiance that is `enough` for that."""
    most = float(colour.max())
    if most > 1 + 1e-6:
        raise BadInput(
            f"{name} would be above 1, which it cannot be: give the light there, in place of I_p = 1, an"
            f" irradiance of {1.001 * enough:.4g} or more (irradiance=, --irradiance)"
        )
    return [min(float(x), 1.0) for x in colour]


def _part(part: Any) -> dict[str, Any]:
    """A lobe, a boundary or a body: its kind, and what it has."""
    found: dict[str, Any] = {"kind": part.kind}
    for field in fields(part):
        own = getattr(part, field.name)
        if isinstance(own, str | bool):
            found[field.name] = own
        elif own is not None:
            found[field.name] = _part(own) if hasattr(own, "kind") else plain(own).tolist()
    return found


def _listed(k: Any, colour: Any) -> list[float] | None:
    if k is None:
        return None
    product = plain(k) if colour is None else plain(k) * plain(colour)
    return np.atleast_1d(product).tolist()
