"""What a page shows, and what it cannot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, NamedTuple

import jax

from diffshade.errors import BadInput
from diffshade.geometry.camera import AbstractCamera, OrthographicCamera, PerspectiveCamera
from diffshade.geometry.frequency import AbstractFrequency, GouraudShading, PhongShading
from diffshade.geometry.mesh import Mesh
from diffshade.geometry.sphere import Sphere
from diffshade.light.parallel import ParallelLight
from diffshade.light.point import PointLight
from diffshade.light.spot import SpotLight
from diffshade.reflectance.material import Material
from diffshade.scene import Scene

__all__ = ["Shown", "check", "is_lit", "one_material"]

LIGHTS = (PointLight, SpotLight, ParallelLight)
WRITTEN = {"schema", "geometry", "camera", "shading", "ambient", "lights", "material"}
FIELDS = {
    *(
        "ambient",
        "lights",
        "position",
        "direction",
        "intensity",
        "attenuation",
        "exponent",
        "cutoff",
    ),
    *("ka", "kd", "od", "os", "body", "specular", "ks", "shininess", "weight"),
    *("alpha", "fresnel", "masking", "rational"),
}
"""What a scene, a light, a material and a lobe may have: anything else would be missed in silence."""


class Shown(NamedTuple):
    """A scene as `ds.render` takes it, and how it is written down."""

    title: str
    geometry: Sphere | Mesh
    camera: AbstractCamera
    shading: AbstractFrequency | None
    """None: once a pixel."""
    scene: Scene
    material: Material
    written: Mapping[str, Any]
    """Its `scene.toml`, of which `geometry`, `camera` and `shading` are written again as they are."""


def is_lit(scene: Scene, material: Material) -> bool:
    """Whether the lights, other than the ambient one, meet a term that they light."""
    return bool(scene.lights) and (material.kd is not None or bool(material.specular))


def one_material(materials: Material | Sequence[Material]) -> Material:
    """The material, where there is one; raises `BadInput` where there are several."""
    if isinstance(materials, Material):
        return materials
    if len(materials) > 1:
        raise BadInput(
            f"the mesh has {len(materials)} materials, and the page shows one: give a [material]"
        )
    return materials[0]


def check(shown: Shown) -> None:
    """Raise `BadInput`, in one line, for what the page has no picture of."""
    if type(shown.geometry) not in (Sphere, Mesh):
        raise BadInput("the page shows a sphere or a mesh, and this is neither: give one of them")
    if type(shown.camera) not in (OrthographicCamera, PerspectiveCamera):
        raise BadInput("the page has an orthographic or a perspective camera: give one of them")
    if isinstance(shown.geometry, Sphere) and not isinstance(shown.shading, PhongShading | None):
        raise BadInput("a sphere has no faces to shade: leave shading out, or use a mesh")
    if (
        isinstance(shown.shading, GouraudShading)
        and getattr(shown.geometry, "slot", None) is not None
    ):
        raise BadInput("Gouraud shading of a mesh with slots: use another shading")
    for number, written in enumerate(shown.written.get("lights", ()), 1):
        # Also where it is sampled: no slider moves all of that
        if written["kind"] == "environment":
            raise BadInput(
                f"light {number} is an environment, which the page does not show: give point, spot and"
                " parallel lights"
            )
    for number, light in enumerate(shown.scene.lights, 1):
        if type(light) not in LIGHTS:
            raise BadInput(
                f"light {number} of the scene has extent, or is of another kind, which the page does"
                " not show: give point, spot and parallel lights"
            )
    for key in shown.written:
        if key not in WRITTEN:
            raise BadInput(f"the scene has {key}, which the page does not show: leave {key} out")
    for key in shown.written.get("material", ()):
        if key not in FIELDS:
            raise BadInput(f"the material has {key}, which the page does not show: leave it out")
    for part in (shown.scene, shown.material, *shown.scene.lights, *shown.material.specular):
        for field in fields(part):
            if getattr(part, field.name) is not None and field.name not in FIELDS:
                raise BadInput(
                    f"a {type(part).__name__} has {field.name}, which the page does not show: leave it"
                    " out"
                )
    leaves = jax.tree.leaves((shown.scene.ambient, shown.material))
    leaves += [light.intensity for light in shown.scene.lights]
    if any(leaf.ndim > 1 for leaf in leaves):
        raise BadInput(
            "a coefficient is a map over pixels, which no slider moves: give one number, or one a"
            " channel"
        )
    counts = {leaf.shape[0] for leaf in leaves if leaf.ndim} - {1}
    if counts - {3}:
        raise BadInput(
            f"there are {max(counts - {3})} channels, and a screen shows 1 or 3: give one number, or"
            " three"
        )
