"""The coefficients that a page has sliders for: their values, how far a slider goes, and their words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from diffshade.errors import BadInput
from diffshade.reflectance.names import coefficient
from diffshade.web.program import uniform
from diffshade.web.shown import Shown

__all__ = ["lights", "parameters", "shortest", "value_of"]


class Slider(NamedTuple):
    """From where to where, as long as the value lies there; in steps of a factor where `log` says so.

    `most` is what the coefficient cannot be above at all.
    """

    words: str
    low: float
    high: float
    log: bool = False
    most: float | None = None


SLIDERS = {
    "ambient": Slider("ambient", 0, 1),
    "ka": Slider("ka, ambient", 0, 1),
    "kd": Slider("kd, diffuse", 0, 1),
    "od": Slider("od, colour of what is ambient and diffuse", 0, 1),
    "os": Slider("os, colour of what is specular", 0, 1),
    "ks": Slider("ks, specular", 0, 1),
    "shininess": Slider("shininess", 1, 1e4, log=True),
    "alpha": Slider("alpha, roughness", 1e-3, 1, log=True),
    "index": Slider("index, of refraction", 1, 3),
    "extinction": Slider("extinction", 0, 10),
    "f0": Slider("f0, reflected head-on", 0, 1),
    "intensity": Slider("intensity", 0, 2),
    "position": Slider("position", -5, 5),
    "direction": Slider("direction", -1, 1),
    "exponent": Slider("exponent, of the cone", 0, 50),
    "cutoff": Slider("cutoff, in radians", 0, math.pi / 2, most=math.pi / 2),
    "c0": Slider("c0, attenuation", 0, 2),
    "c1": Slider("c1, times the distance", 0, 1),
    "c2": Slider("c2, times its square", 0, 1),
    "a": Slider("a, attenuation", 0, 2),
    "reach": Slider("reach", 0, 10),
}
"""By the last part of the name."""

SIGNED = ("position", "direction")


def parameters(shown: Shown, kinds: Mapping[str, str]) -> list[dict[str, Any]]:
    """What the page has to know of every coefficient in its program: the material's, then the lights'."""
    order = ("specular", "ambient", "lights")

    def rank(name: str) -> int:
        first = name.split(".")[0]
        return 1 + order.index(first) if first in order else 0

    return [_parameter(shown, name, kinds[name]) for name in sorted(kinds, key=rank)]


def lights(shown: Shown, kinds: Mapping[str, str]) -> list[dict[str, str]]:
    """The lights that can be dragged, and the coefficient of each that says where it is."""
    found = []
    for number, light in enumerate(shown.scene.lights):
        name = f"lights.{number}"
        places = [f"{name}.{key}" for key in ("position", "direction") if f"{name}.{key}" in kinds]
        if places:
            found.append({"name": name, "words": _light(number, light), "place": places[0]})
    return found


def value_of(shown: Shown, name: str) -> np.ndarray:
    """A coefficient of the material or of the scene, by its name."""
    whole: Any = shown.scene if name.split(".")[0] in ("ambient", "lights") else shown.material
    return np.asarray(coefficient(whole, name))


def shortest(value: np.ndarray) -> list[float]:
    """Numbers in as few digits as tell them apart in their precision: 0.1, whatever it is in binary."""
    return [float(str(number)) for number in np.atleast_1d(value)]


def _parameter(shown: Shown, name: str, kind: str) -> dict[str, Any]:
    value = value_of(shown, name)
    if kind == "number" and value.ndim:
        raise BadInput(f"{name} has {value.size} numbers, and the page moves one: give one")
    values = shortest(value)
    key = name.split(".")[-1]
    slider = SLIDERS[key]
    low, high = slider.low, slider.high
    farthest = max(map(abs, values))
    if farthest > high or key == "position":
        high = _round_up(1.5 * farthest) if slider.most is None else slider.most
    if key in SIGNED:
        low = -high
    elif 0 < min(values) < low:
        low = min(values)
    return {
        "name": name,
        "uniform": uniform(name),
        "kind": kind,
        "group": _group(shown, name),
        "words": slider.words,
        "values": values,
        "range": [low, high],
        "log": slider.log,
        "least": None if key in SIGNED else 0,
        "most": slider.most,
    }


def _round_up(value: float) -> float:
    """The next of 1, 2, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value)) if value > 0 else 1.0
    return next((m * power for m in (1.0, 2.0, 5.0) if m * power >= value), 10 * power)


def _group(shown: Shown, name: str) -> str:
    first, *rest = name.split(".")
    if first == "specular":
        number = int(rest[0])
        lobe = type(shown.material.specular[number]).__name__
        several = len(shown.material.specular) > 1
        return f"Lobe {number + 1}, {lobe}" if several else f"Lobe, {lobe}"
    if first == "lights":
        return _light(int(rest[0]), shown.scene.lights[int(rest[0])])
    return {"ambient": "Ambient light", "body": "Body"}.get(first, "Material")


def _light(number: int, light: Any) -> str:
    kind = type(light).__name__.removesuffix("Light").lower()
    return f"Light {number + 1}, {kind}"
