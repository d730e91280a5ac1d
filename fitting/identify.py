"""What the images cannot tell, in words, and what to do about it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitting.uncertainty import Uncertainty

__all__ = ["Unidentified", "unidentified"]

NOISE = 1e-3
"""Of the images' maximum: the noise under which a coefficient must be known ..."""
TOLERANCE = 0.10
"""... to this share of its value, to count as identified."""


@dataclass(frozen=True)
class Unidentified:
    """Coefficients that the images do not determine, and why."""

    coefficients: tuple[str, ...]
    reason: str


def unidentified(
    values: Mapping[str, np.ndarray],
    uncertainty: Uncertainty,
    brightest: float,
    *,
    scaled: bool,
    clamped: bool,
) -> tuple[Unidentified, ...]:
    """Judge every reported coefficient by its Cramer-Rao error for noise of a thousandth of the maximum.

    `scaled` says that attenuation constants were fitted, whose scale no image can tell from k_d and
    k_s; `clamped`, that they make f exceed 1 somewhere. A coefficient that is zero, beside others
    that are not, is known by its absolute error.
    """
    found = [_blind(names, values) for names in uncertainty.blind]
    told = {name for item in found for name in item.coefficients}
    noise = max(NOISE * brightest, uncertainty.noise)
    largest = max((float(np.max(np.abs(v))) for n, v in values.items() if _linear(n)), default=0.0)
    for name, value in values.items():
        # Of a fitted attenuation, what was measured at the reference distance is judged.
        if name in told or name.startswith("attenuation.") or (scaled and _scaled(name)):
            continue
        share = name in ("reference.l0", "reference.l1", "reference.l2")
        reference = np.ones_like(value) if share else np.abs(value)
        if _linear(name):
            reference = np.maximum(reference, 0.01 * largest)
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = noise * uncertainty.unit_errors[name] / reference
        worst = float(np.max(np.where(np.isnan(relative), np.inf, relative), initial=0.0))
        if worst > TOLERANCE:
            found.append(Unidentified((name,), _vague(name, worst, values)))
    if clamped:
        found.append(
            Unidentified(
                tuple(n for n in values if n.startswith("attenuation.c")),
                "they make f exceed 1 at the nearest points, where LIGHT-12 clamps it and the fit"
                " does not: leave those points out by `valid`, or do not hold what sets the scale",
            )
        )
    if scaled:
        names = tuple(n for n in values if n.startswith("attenuation.c") or _scaled(n))
        found.append(
            Unidentified(
                names,
                "these share one scale, which no image can tell: it is set by c0 = 1 where that can"
                " be; their ratios, and kd and ks at the reference distance, are what was measured",
            )
        )
    return tuple(found)


def _blind(names: tuple[str, ...], values: Mapping[str, np.ndarray]) -> Unidentified:
    for name in names:
        lobe, _, field = name.rpartition(".")
        if field == "shininess" and np.all(values.get(f"{lobe}.ks", 1) == 0):
            return Unidentified(
                (name,),
                f"{lobe}.ks is 0, and a highlight that is not seen has no width: leave the lobe out,"
                " or hold the shininess",
            )
    if len(names) == 1:
        return Unidentified(
            names, "no pixel depends on it: leave it out, hold it, or add images that show it"
        )
    return Unidentified(
        names, f"the images show only a combination of them: hold {' or '.join(names[:3])}"
    )


def _vague(name: str, relative: float, values: Mapping[str, np.ndarray]) -> str:
    error = f"{100 * relative:.0f} %" if relative < 10 else "more than its value"
    remedy = "add images or lights, or hold it"
    lobe, _, field = name.rpartition(".")
    if field == "shininess" and np.all(values.get(f"{lobe}.ks", 1) == 0):
        remedy = "no highlight is seen: leave the lobe out, or hold it"
    return (
        f"its standard error is {error} for noise of a thousandth of the images' maximum, or for"
        f" the noise found: {remedy}"
    )


def _linear(name: str) -> bool:
    return name.removeprefix("reference.") in ("ka", "kd") or name.endswith(".ks")


def _scaled(name: str) -> bool:
    return not name.startswith("reference.") and name != "ka" and _linear(name)
