"""The models that have a name on the command line and in files: which lobes each has."""

from typing import Any

from diffshade.reflectance.blinn_phong import BlinnPhong
from diffshade.reflectance.lobe import AbstractLobe
from diffshade.reflectance.material import Material
from diffshade.reflectance.phong import Phong

__all__ = ["LOBES", "MODELS", "named_bounds", "named_material"]

MODELS: dict[str, tuple[type[Phong] | type[BlinnPhong], ...]] = {
    "phong": (Phong,),
    "blinn-phong": (BlinnPhong,),
    "lambert": (),
    "phong2": (Phong, Phong),
}
LOBES = {lobe.kind: lobe for lobes in MODELS.values() for lobe in lobes}
"""Lobes by `kind`."""

SHARPEST = 200.0
"""The shininess at which the first of several lobes starts; each further one is a tenth."""


BROADEST = 2.0
"""The least shininess of each of several lobes: what is broader is no highlight, but diffuse. And the
sharper of two may be brighter at its peak than white.
"""


def named_material(model: str, *, ambient: bool) -> Material:
    """A material of a named model, with the values at which a fit starts."""
    half: Any = 0.5
    starts: Any = (SHARPEST / 10**j for j in range(len(MODELS[model])))
    lobes: tuple[AbstractLobe, ...] = tuple(
        lobe(ks=half, shininess=start) for lobe, start in zip(MODELS[model], starts, strict=True)
    )
    return Material(ka=half if ambient else None, kd=half, specular=lobes)


def named_bounds(model: str) -> dict[str, tuple[float | None, float | None]]:
    """The bounds that a named model has beside those of every fit."""
    if len(MODELS[model]) < 2:
        return {}
    return {"specular.shininess": (BROADEST, None), "specular.ks": (0.0, None)}
