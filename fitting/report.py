"""Fits and evaluations as JSON documents, and a material back from one.

"diffshade.fit/1": a term that the model lacks is null, as is a number that is not finite.
`standard_errors` has the shape of `coefficients`, with null where a coefficient is held or its error
infinite. In `unidentified` and `held` coefficients have the names of `fitting.Fit`:
"specular.0.ks" is `lobes[0].ks`, and "reference.l1" is `attenuation.l1`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fitting.named_models import LOBES

if TYPE_CHECKING:
    from diffshade.io.capture import Capture
    from diffshade.io.toml_document import Table
    from diffshade.light.attenuation import QuadraticAttenuation
    from diffshade.reflectance.material import Material
    from fitting.estimate import Fit
    from fitting.residual import Evaluation

__all__ = [
    "EVALUATE_SCHEMA",
    "FIT_SCHEMA",
    "evaluation_to_json",
    "fit_to_json",
    "material_from_json",
]

FIT_SCHEMA = "diffshade.fit/1"
EVALUATE_SCHEMA = "diffshade.evaluate/1"

CONSTANTS = ("c0", "c1", "c2")
SHARES = ("l0", "l1", "l2")


def fit_to_json(
    fit: Fit, capture: Capture, *, model: str, seconds: Mapping[str, float]
) -> dict[str, Any]:
    """A fit of a capture as a "diffshade.fit/1" document; `model` is the name of the model."""
    return {
        "schema": FIT_SCHEMA,
        "model": model,
        "coefficients": _shaped(fit, fit.coefficients.get, fit.reference_distance),
        "standard_errors": _shaped(fit, lambda name: _error(fit, name), None),
        "unidentified": [
            {"coefficients": list(item.coefficients), "reason": item.reason}
            for item in fit.unidentified
        ],
        "held": sorted(set(fit.coefficients) - set(fit.standard_errors)),
        "noise": _plain(fit.noise),
        **_measured(fit, capture),
        "converged": fit.converged,
        "seconds": {name: round(value, 3) for name, value in seconds.items()},
        "notes": list(capture.notes),
    }


def evaluation_to_json(evaluation: Evaluation, capture: Capture) -> dict[str, Any]:
    """How a material predicts a capture, as a "diffshade.evaluate/1" document."""
    return {
        "schema": EVALUATE_SCHEMA,
        **_measured(evaluation, capture),
        "notes": list(capture.notes),
    }


def material_from_json(document: Table) -> tuple[Material, QuadraticAttenuation | None]:
    """The material of a "diffshade.fit/1" document, and the attenuation if one was fitted.

    Raises `BadInput`, naming the file and the place, for another schema and for what is missing,
    of the wrong type, out of range, or unknown to this version.
    """
    from diffshade.light.attenuation import QuadraticAttenuation
    from diffshade.reflectance.material import Material

    document.choice("schema", (FIT_SCHEMA,))
    if "coefficients" not in document:
        document.fail('the key "coefficients" is missing; give a fit.json as `fit` writes it')
    table = _without_nulls(document.table("coefficients"))
    if "body" in table:
        table.fail("body is not null, which this version does not know; use the version it is from")
    given: dict[str, Any] = {key: table.per_channel(key) for key in ("ka", "kd") if key in table}
    lobes = []
    for lobe in table.tables("lobes", "lobe") if "lobes" in table else []:
        kind = LOBES[lobe.choice("kind", LOBES)]
        lobe.expect(("kind", "ks", "shininess"))
        lobes.append(kind(lobe.per_channel("ks"), lobe.number("shininess", least=0.0)))
    if not given and not lobes:
        table.fail("there is no coefficient; give ka, kd or a lobe")
    material = Material(**given, specular=tuple(lobes))
    if "attenuation" not in table:
        return material, None
    attenuation = table.table("attenuation")
    attenuation.choice("kind", ("quadratic",))
    for name in CONSTANTS:
        if name not in attenuation:
            attenuation.fail(f'the key "{name}" is missing; give c0, c1 and c2')
    constants = (attenuation.number(name, least=0.0) for name in CONSTANTS)
    return material, QuadraticAttenuation(*constants)


def _without_nulls(table: Table) -> Table:
    return replace(table, values={k: v for k, v in table.values.items() if v is not None})


def _shaped(fit: Fit, value: Callable[[str], Any], distance: float | None) -> dict[str, Any]:
    """One value for every coefficient of a fit, by name, in the shape of the document."""
    lobes = range(len(fit.material.specular))
    attenuation = None
    if fit.reference_distance is not None:
        attenuation = {
            "kind": "quadratic",
            **{name: _plain(value(f"attenuation.{name}")) for name in CONSTANTS},
            "reference_distance": _plain(distance),
            **{name: _plain(value(f"reference.{name}")) for name in SHARES},
            "kd": _plain(value("reference.kd")),
            "ks": [_plain(value(f"reference.specular.{j}.ks")) for j in lobes],
        }
    return {
        "ka": _plain(value("ka")),
        "kd": _plain(value("kd")),
        "lobes": [
            {
                "kind": fit.material.specular[j].kind,
                "ks": _plain(value(f"specular.{j}.ks")),
                "shininess": _plain(value(f"specular.{j}.shininess")),
            }
            for j in lobes
        ],
        "body": None,
        "attenuation": attenuation,
    }


def _error(fit: Fit, name: str) -> Any:
    """Standard errors in the shape of the coefficient: NaN where it is held."""
    if name not in fit.coefficients:
        return None
    return fit.standard_errors.get(name, np.full_like(fit.coefficients[name], np.nan))


def _measured(measured: Fit | Evaluation, capture: Capture) -> dict[str, Any]:
    rows = zip(capture.names, measured.per_image, capture.clipped, strict=True)
    return {
        "relative_residual": _plain(measured.relative_residual),
        "fraction_excluded": _plain(measured.fraction_excluded),
        "per_image": [
            {
                "file": name,
                "relative_residual": _plain(row.relative_residual),
                "pixels_used": row.pixels_used,
                "pixels_clipped": int(np.count_nonzero(clipped)),
            }
            for name, row, clipped in rows
        ],
    }


def _plain(value: Any) -> Any:
    """Plain numbers and lists; null for what is not finite."""
    if value is None:
        return None
    values = np.asarray(value, np.float64).tolist()
    if isinstance(values, list):
        return [_plain(x) for x in values]
    return values if math.isfinite(values) else None
