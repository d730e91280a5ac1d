"""The coefficients that shape a lobe or a body: where each may lie, and where a search begins.

The image is not linear in them. All are above 0 and searched on a logarithmic scale, on which their
errors are the more nearly normal.
"""

from typing import NamedTuple

import numpy as np

from diffshade.reflectance.fresnel import Dielectric
from diffshade.reflectance.material import Material
from diffshade.reflectance.names import coefficient_names

__all__ = ["SHAPES", "Shape", "boundaries", "is_shape", "kind_of", "shape_names"]


class Shape(NamedTuple):
    """The bounds that a coefficient has by default, and the nodes of a coarse grid over it."""

    bounds: tuple[float, float]
    nodes: tuple[float, ...]


def _spread(low: float, high: float, count: int) -> tuple[float, ...]:
    return tuple(np.geomspace(low, high, count).tolist())


SHAPES = {
    "shininess": Shape((0.1, 1e5), _spread(1.0, 3000.0, 15)),
    "alpha": Shape((1e-3, 2.0), _spread(0.015, 0.9, 13)),
    "index": Shape((1.01, 5.0), (1.15, 1.5, 2.2)),
    "index of a metal": Shape((0.05, 10.0), (0.2, 1.0, 3.0)),
    "extinction": Shape((1e-2, 10.0), (1.0, 3.0, 8.0)),
    "f0": Shape((1e-3, 1.0), (0.04, 0.3)),
}


def kind_of(material: Material, name: str) -> str:
    """Which of `SHAPES` a coefficient is."""
    field = name.rpartition(".")[2]
    return "index of a metal" if field == "index" and name not in boundaries(material) else field


def is_shape(name: str) -> bool:
    """Whether a coefficient is none of the linear ones."""
    return name.startswith(("specular.", "body.")) and not name.endswith(".ks")


def shape_names(material: Material) -> tuple[str, ...]:
    """Those of a material: its lobes', one after the other, and its body's."""
    return tuple(filter(is_shape, coefficient_names(material)))


def boundaries(material: Material) -> tuple[str, ...]:
    """The refractive indices of the one clear boundary that a surface has.

    Light is mirrored by it and passes it: those of dielectric lobes and of the body are one number.
    """
    lobes = (
        f"specular.{j}.{part}.index"
        for j, lobe in enumerate(material.specular)
        for part in ("fresnel", "weight")
        if isinstance(getattr(lobe, part, None), Dielectric)
    )
    return (*lobes, *(() if material.body is None else ("body.index",)))
