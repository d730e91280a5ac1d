"""The coefficients of a material by name, which is the path to one.

"ka", "specular.0.ks", "specular.0.fresnel.index", "body.index". Without the number of a lobe a name
stands for that of every lobe: "specular.ks".
"""

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import equinox as eqx
import jax
import numpy as np

from diffshade.reflectance.material import Material

__all__ = ["coefficient", "coefficient_names", "of_every_lobe"]


def coefficient_names(material: Material) -> tuple[str, ...]:
    """Those that a material has, in its order.

    >>> coefficient_names(Material(kd=0.5))
    ('kd',)
    """
    return tuple(_paths(material, ""))


def coefficient(whole: eqx.Module, name: str) -> Any:
    """The one of a name, of a material or a scene: an array, or what stands for one inside `tree_at`."""
    part: Any = whole
    for step in name.split("."):
        part = part[int(step)] if step.isdigit() else getattr(part, step)
    return part


def of_every_lobe(name: str) -> str:
    """The name without the number of its lobe.

    >>> of_every_lobe("specular.0.ks")
    'specular.ks'
    """
    return ".".join(step for step in name.split(".") if not step.isdigit())


def _paths(part: Any, path: str) -> Iterator[str]:
    if isinstance(part, eqx.Module):
        for field in fields(part):
            inside = f"{path}.{field.name}" if path else field.name
            yield from _paths(getattr(part, field.name), inside)
    elif isinstance(part, tuple):
        for number, one in enumerate(part):
            yield from _paths(one, f"{path}.{number}")
    elif isinstance(part, jax.Array | np.ndarray):
        yield path
