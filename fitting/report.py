"""Fits and evaluations as JSON documents, and a material back from one.

"diffshade.fit/1": a term that the model lacks is null, as is a number that is not finite.
`standard_errors` has the shape of `coefficients`, with null where a coefficient is held or its error
infinite. `pixels_unusable` are those of the object that are not finite or not opaque. In
`unidentified` and `held` coefficients have the names of `fitting.Fit`: "specular.0.ks" is
`lobes[0].ks`, and "reference.l1" is `attenuation.l1`.

Keys that a document may have besides; readers do without them, and null is as good as absent:

- `intervals`: of 95 %, the shape of `coefficients`, each number a pair [low, high].
- `correlations`: {`names`, `matrix`}, as rows of numbers in [-1, 1].
- `basins`: other minima within the noise of the best, each {`coefficients`, `relative_residual`}.
- `certificate`: that no other minimum is better, {`proven`, `tolerance`, `shininess`: [low, high] of
  the search, `interval`: outside of it the residual is larger by the tolerance, `reason`};
  `tolerance` is of the relative residual.
- `profile`: a list of {`names`, `values`, `relative_residual`}, the last two of equal length: the
  least residual that there is at each value of a coefficient, which has one name or several.
- `compared`: where models were, the best first, a list of {`model`, `bic`, `relative_residual`}.
- `weighted_residual`: the relative residual with the weights of a robust fit.
- `suspect_images`: images that disagree with the others, a list of {`file`, `reason`}.
- `gains`: a number an image, or one a channel.
- `response`: where a gamma was found first, {`gamma`, `standard_error`, `interval`: [low, high] of
  95 %, `relative_residual` of the encoded values, `converged`}.
- `lights`: where they were refined first, {`before`, `relative_residual`: with the lights as they were
  given and as they are used, `converged`, `per_image`: a list of {`file`, `degrees` that the light was
  turned by, `standard_error`, `gain` on its intensity, `gain_error`, `direction`, `moved`: null, or why
  the lamp must have been moved}}.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from diffshade.io.capture import Capture
    from diffshade.io.toml_document import Table
    from diffshade.light.attenuation import AbstractAttenuation
    from diffshade.reflectance.material import Material
    from fitting.found import Fit
    from fitting.residual import Evaluation

__all__ = [
    "EVALUATE_SCHEMA",
    "FIT_SCHEMA",
    "evaluation_to_json",
    "fit_to_json",
    "intervals_to_json",
    "material_from_json",
    "plain",
]

FIT_SCHEMA = "diffshade.fit/1"
EVALUATE_SCHEMA = "diffshade.evaluate/1"

CONSTANTS = {"quadratic": ("c0", "c1", "c2"), "linear": ("c0", "c1"), "exponential": ("a",)}
"""What each kind of attenuation has."""


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
        "intervals": intervals_to_json(fit, fit.intervals),
        **_judged(fit, capture),
        "noise": plain(fit.noise),
        **_measured(fit, capture),
        "converged": fit.converged,
        "seconds": {name: round(value, 3) for name, value in seconds.items()},
        "notes": list(capture.notes),
    }


def _judged(fit: Fit, capture: Capture) -> dict[str, Any]:
    """What a document says besides, where the fit has it."""
    found: dict[str, Any] = {}
    if fit.correlations is not None:
        names = list(fit.correlations.names)
        found["correlations"] = {"names": names, "matrix": plain(fit.correlations.matrix)}
    found["basins"] = [
        {"coefficients": dict(b.coefficients), "relative_residual": plain(b.relative_residual)}
        for b in fit.basins
        if b.within_noise
    ]
    found["suspect_images"] = [
        {"file": capture.names[item.image], "reason": item.reason} for item in fit.suspect_images
    ]
    found["weighted_residual"] = plain(fit.weighted_residual)
    found["gains"] = None if fit.gains is None else plain(fit.gains)
    found["certificate"] = None
    if fit.certificate is not None:
        proof = fit.certificate
        found["certificate"] = {
            "proven": proof.proven,
            "tolerance": proof.tolerance,
            "shininess": None if proof.shininess is None else list(proof.shininess),
            "interval": None if proof.interval is None else list(proof.interval),
            "reason": proof.reason,
        }
    found["profile"] = [
        {
            "names": list(profile.names),
            "values": plain(profile.values),
            "relative_residual": plain(profile.relative_residual),
        }
        for profile in fit.profiles
    ] or None
    return found


def intervals_to_json(
    fit: Fit, intervals: Mapping[str, tuple[np.ndarray, np.ndarray]]
) -> dict[str, Any]:
    """The `intervals` of a document from the lower and upper ends of each coefficient, by name.

    A pair has null for an end that is not finite, and is [null, null] where a coefficient is held.
    """

    def pair(name: str) -> Any:
        if name not in fit.coefficients:
            return None
        unknown = np.full_like(fit.coefficients[name], np.nan)
        return np.stack(intervals.get(name, (unknown, unknown)), axis=-1)

    return _shaped(fit, pair, None)


def evaluation_to_json(evaluation: Evaluation, capture: Capture) -> dict[str, Any]:
    """How a material predicts a capture, as a "diffshade.evaluate/1" document."""
    return {
        "schema": EVALUATE_SCHEMA,
        **_measured(evaluation, capture),
        "notes": list(capture.notes),
    }


def material_from_json(document: Table) -> tuple[Material, AbstractAttenuation | None]:
    """The material of a "diffshade.fit/1" document, and the attenuation if one was fitted.

    Raises `BadInput`, naming the file and the place, for another schema and for what is missing,
    of the wrong type, out of range, or unknown to this version.
    """
    from diffshade.io.reflectance_tables import read_body, read_lobe
    from diffshade.light import attenuation as laws
    from diffshade.reflectance.material import Material

    document.choice("schema", (FIT_SCHEMA,))
    if "coefficients" not in document:
        document.fail('the key "coefficients" is missing; give a fit.json as `fit` writes it')
    table = _without_nulls(document.table("coefficients"))
    given: dict[str, Any] = {key: table.per_channel(key) for key in ("ka", "kd") if key in table}
    lobes = table.tables("lobes", "lobe") if "lobes" in table else []
    specular = tuple(read_lobe(_without_nulls(lobe)) for lobe in lobes)
    body = read_body(table.table("body")) if "body" in table else None
    if not given and not lobes:
        table.fail("there is no coefficient; give ka, kd or a lobe")
    with table.naming():
        material = Material(**given, specular=specular, body=body)
    if "attenuation" not in table:
        return material, None
    attenuation = table.table("attenuation")
    law = attenuation.choice("kind", CONSTANTS)
    names = CONSTANTS[law]
    for name in names:
        if name not in attenuation:
            attenuation.fail(f'the key "{name}" is missing; give {", ".join(names)}')
    types: dict[str, Any] = {
        "quadratic": laws.QuadraticAttenuation,
        "linear": laws.LinearAttenuation,
        "exponential": laws.ExponentialAttenuation,
    }
    with attenuation.naming():
        return material, types[law](*(attenuation.number(name, least=0.0) for name in names))


def _without_nulls(table: Table) -> Table:
    return replace(table, values={k: v for k, v in table.values.items() if v is not None})


def _shaped(fit: Fit, value: Callable[[str], Any], distance: float | None) -> dict[str, Any]:
    """One value for every coefficient of a fit, by name, in the shape of the document."""
    lobes = range(len(fit.material.specular))
    attenuation: dict[str, Any] | None = None
    fitted = tuple(n.split(".")[1] for n in fit.coefficients if n.startswith("attenuation."))
    for kind, constants in CONSTANTS.items():
        if set(fitted) == set(constants):
            found = {name: plain(value(f"attenuation.{name}")) for name in constants}
            attenuation = {"kind": kind, **found}
    if attenuation is not None and fit.reference_distance is not None:
        shares = [n for n in ("l0", "l1", "l2") if f"reference.{n}" in fit.coefficients]
        attenuation |= {
            "reference_distance": plain(distance),
            **{name: plain(value(f"reference.{name}")) for name in shares},
            "kd": plain(value("reference.kd")),
            "ks": [plain(value(f"reference.specular.{j}.ks")) for j in lobes],
        }
    return {
        "ka": plain(value("ka")),
        "kd": plain(value("kd")),
        "lobes": [_part_to_json(fit.material.specular[j], f"specular.{j}", value) for j in lobes],
        "body": None
        if fit.material.body is None
        else _part_to_json(fit.material.body, "body", value),
        "attenuation": attenuation,
    }


def _part_to_json(part: Any, path: str, value: Callable[[str], Any]) -> dict[str, Any]:
    """A lobe, its boundary, or a body: its kind, its coefficients by name, and what else it has.

    A part that is absent is left out.
    """
    found: dict[str, Any] = {"kind": part.kind}
    for field in fields(part):
        own = getattr(part, field.name)
        if isinstance(own, str | bool):
            found[field.name] = own
        elif own is None:
            continue
        elif hasattr(own, "kind"):
            found[field.name] = _part_to_json(own, f"{path}.{field.name}", value)
        else:
            found[field.name] = plain(value(f"{path}.{field.name}"))
    return found


def _error(fit: Fit, name: str) -> Any:
    """Standard errors in the shape of the coefficient: NaN where it is held."""
    if name not in fit.coefficients:
        return None
    return fit.standard_errors.get(name, np.full_like(fit.coefficients[name], np.nan))


def _measured(measured: Fit | Evaluation, capture: Capture) -> dict[str, Any]:
    rows = zip(capture.names, measured.per_image, capture.clipped, strict=True)
    return {
        "relative_residual": plain(measured.relative_residual),
        "fraction_excluded": plain(measured.fraction_excluded),
        "per_image": [
            {
                "file": name,
                "relative_residual": plain(row.relative_residual),
                "pixels_used": row.pixels_used,
                "pixels_clipped": int(np.count_nonzero(clipped)),
                "pixels_unusable": row.pixels_excluded - int(np.count_nonzero(clipped)),
            }
            for name, row, clipped in rows
        ],
    }


def plain(value: Any) -> Any:
    """Plain numbers and lists; null for what is not finite."""
    if value is None:
        return None
    values = np.asarray(value, np.float64).tolist()
    if isinstance(values, list):
        return [plain(x) for x in values]
    return values if math.isfinite(values) else None
