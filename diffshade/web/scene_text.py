"""The `scene.toml` of what a page shows, with a blank for every coefficient that has a slider.

A blank is `${name}`, as in `kd = ${kd}`. The page fills them in; what has no slider stands as a number.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import fields
from typing import Any

from diffshade.io.toml_text import law_kinds, table_text, value_text
from diffshade.light.attenuation import Windowed
from diffshade.light.parallel import ParallelLight
from diffshade.light.point import PointLight
from diffshade.light.spot import SpotLight
from diffshade.web.parameters import shortest, value_of
from diffshade.web.shown import Shown

__all__ = ["scene_text"]

LIGHTS: dict[Any, str] = {PointLight: "point", SpotLight: "spot", ParallelLight: "parallel"}


def scene_text(shown: Shown, blanks: Collection[str]) -> str:
    """The text; `blanks` are the names of the coefficients that are left open."""
    return "\n".join(_lines(shown, blanks)) + "\n"


def _lines(shown: Shown, blanks: Collection[str]) -> Iterator[str]:
    def number(name: str) -> str:
        if name in blanks:
            return f"${{{name}}}"
        value = value_of(shown, name)
        return value_text(shortest(value) if value.ndim else shortest(value)[0])

    for key in ("geometry", "camera", "shading"):
        if key in shown.written:
            yield f"{key} = {value_text(shown.written[key])}"
    if shown.scene.ambient is not None:
        yield f"ambient = {number('ambient')}"
    for k, light in enumerate(shown.scene.lights):
        yield "[[lights]]"
        yield f"kind = {value_text(LIGHTS[type(light)])}"
        for name in ("position", "direction", "intensity", "exponent", "cutoff"):
            if getattr(light, name, None) is not None:
                yield f"{name} = {number(f'lights.{k}.{name}')}"
        attenuation = getattr(light, "attenuation", None)
        if attenuation is not None:
            law = _law(attenuation, f"lights.{k}.attenuation", number)
            yield f"attenuation = {table_text(law)}"
    material = shown.material
    yield "[material]"
    for name in ("ka", "kd", "od", "os"):
        if getattr(material, name) is not None:
            yield f"{name} = {number(name)}"
    if material.body is not None:
        yield f"body = {table_text(_part(material.body, 'body', number))}"
    for k, lobe in enumerate(material.specular):
        yield "[[material.specular]]"
        for key, text in _part(lobe, f"specular.{k}", number).items():
            yield f"{key} = {text}"


def _law(law: Any, path: str, number: Any) -> dict[str, str]:
    if isinstance(law, Windowed):
        return _law(law.law, f"{path}.law", number) | {"reach": number(f"{path}.reach")}
    constants = {field.name: number(f"{path}.{field.name}") for field in fields(law)}
    return {"kind": value_text(law_kinds()[type(law)]), **constants}


def _part(part: Any, path: str, number: Any) -> dict[str, str]:
    """A lobe, a boundary or a body: its kind, and every field that it has."""
    found = {"kind": value_text(part.kind)}
    for field in fields(part):
        own = getattr(part, field.name)
        if isinstance(own, str | bool):
            found[field.name] = value_text(own)
        elif hasattr(own, "kind"):
            found[field.name] = table_text(_part(own, f"{path}.{field.name}", number))
        elif own is not None:
            found[field.name] = number(f"{path}.{field.name}")
    return found
