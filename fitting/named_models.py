"""The models that have a name on the command line, in files and in `compare`: which terms each has."""

from collections.abc import Callable
from typing import Any, NamedTuple

from diffshade.errors import BadInput
from diffshade.reflectance.blinn_phong import BlinnPhong
from diffshade.reflectance.body import FresnelBody
from diffshade.reflectance.fresnel import Dielectric
from diffshade.reflectance.lobe import AbstractLobe
from diffshade.reflectance.material import Material
from diffshade.reflectance.microfacet import GGX
from diffshade.reflectance.phong import Phong

__all__ = ["MODELS", "named_bounds", "named_material"]

Bounds = dict[str, tuple[float | None, float | None]]

HALF: Any = 0.5
"""Where each k starts."""
WHITER: Bounds = {"specular.ks": (0.0, None)}
"""A sharp lobe may be brighter at its peak than white; so may one whose light has no absolute scale."""
BROADEST = 2.0
"""The least shininess of each of several lobes: what is broader is no highlight, but diffuse."""


class Named(NamedTuple):
    """The lobes of a model, at what a fit starts from, its body, and bounds beside those of every fit."""

    lobes: Callable[[], tuple[AbstractLobe, ...]]
    body: Callable[[], FresnelBody | None] = lambda: None
    bounds: Bounds = {}  # noqa: RUF012


def _phong(shininess: Any) -> Phong:
    return Phong(HALF, shininess)


def _coat(alpha: Any) -> GGX:
    return GGX(HALF, alpha, Dielectric())


MODELS: dict[str, Named] = {
    "phong": Named(lambda: (_phong(200.0),)),
    "blinn-phong": Named(lambda: (BlinnPhong(HALF, 200.0),)),  # type: ignore[arg-type]
    "lambert": Named(lambda: ()),
    "phong2": Named(
        lambda: (_phong(200.0), _phong(20.0)),
        bounds={"specular.shininess": (BROADEST, None), **WHITER},
    ),
    "ggx": Named(lambda: (GGX(HALF, 0.1),), bounds=WHITER),  # type: ignore[arg-type]
    "plastic": Named(lambda: (_coat(0.1),), FresnelBody, WHITER),
    "plastic2": Named(lambda: (_coat(0.05), _coat(0.3)), FresnelBody, WHITER),
}
"""Over Lambert's diffuse term: one lobe of Phong, of Blinn, none, two of Phong, one of GGX's facets; over
a body under a boundary: one lobe of GGX's facets of that boundary, two.
"""


def named_material(model: str, *, ambient: bool) -> Material:
    """A material of a named model, with the values at which a fit starts."""
    named = _named(model)
    return Material(HALF if ambient else None, HALF, named.lobes(), body=named.body())


def named_bounds(model: str) -> Bounds:
    """The bounds that a named model has beside those of every fit."""
    return dict(_named(model).bounds)


def _named(model: str) -> Named:
    if model not in MODELS:
        raise BadInput(f"there is no model {model!r}: give one of {', '.join(MODELS)}")
    return MODELS[model]
