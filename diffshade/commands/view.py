"""`diffshade view`: a page with a scene, or the material of a fit, and a slider for every coefficient."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from diffshade.commands.console import note
from diffshade.commands.fit_file import fit_file
from diffshade.errors import naming
from diffshade.io.json_document import read_json
from diffshade.progress import bar

if TYPE_CHECKING:
    from diffshade.light.attenuation import AbstractAttenuation
    from diffshade.light.base import AbstractLight
    from diffshade.web.shown import Shown

__all__ = ["view"]

TOWARDS = (-0.5, 0.6, 0.9)
"""Where the light stands that a fit is shown under."""
SIZE = 512
MARGIN = 1.1
"""The width of its picture over that of the ball."""


def view(path: Path, *, out: Path | None, allow_outside: bool) -> int:
    """Write the page, beside the file where `out` does not say; returns the exit status.

    Of a folder it is that of the fit in it, or of its `scene.toml`.
    """
    from diffshade.web.page import write_page

    if not (path / "fit.json").is_file() and (path / "scene.toml").is_file():
        path /= "scene.toml"
    path = fit_file(path)
    shown = _of_fit(path) if path.suffix.lower() == ".json" else _of_scene(path, allow_outside)
    target = path.with_suffix(".html") if out is None else out
    with naming(path), bar(f"writing {target}"):
        write_page(target, shown)
    print(target, flush=True)
    return 0


def _of_scene(path: Path, allow_outside: bool) -> Shown:
    from diffshade.io.scene_toml import read_scene_toml
    from diffshade.io.toml_document import read_toml
    from diffshade.web.shown import Shown, one_material

    file = read_scene_toml(path, allow_outside=allow_outside)
    for found in file.notes:
        note(found)
    written: dict[str, Any] = dict(read_toml(path).values)
    with naming(path):
        return Shown(
            title=path.name,
            geometry=file.geometry,  # type: ignore[arg-type]  # `check` refuses the others
            camera=file.camera,  # type: ignore[arg-type]
            shading=file.shading,
            scene=file.scene,
            material=one_material(file.material),
            written=written,
        )


def _of_fit(path: Path) -> Shown:
    """Its material on a ball under one light: of the fit's attenuation, at its reference distance, if
    it has one; else parallel."""
    from diffshade.geometry.camera import OrthographicCamera
    from diffshade.geometry.sphere import Sphere
    from diffshade.scene import Scene
    from diffshade.web.shown import Shown
    from fitting.report import material_from_json

    document = read_json(path, "a fit.json, or a scene.toml")
    material, attenuation = material_from_json(document)
    distance = _distance(document.values["coefficients"].get("attenuation"))
    radius: Any = min(1.0, distance / 3)  # the light is well outside
    ambient: Any = None if material.ka is None else 1.0
    extent = 2 * MARGIN * radius
    return Shown(
        title=f"{path.resolve().parent.name}/{path.name}",
        geometry=Sphere(radius=radius),
        camera=OrthographicCamera(SIZE, SIZE, extent),
        shading=None,
        scene=Scene(ambient, (_light(attenuation, distance),)),
        material=material,
        written={
            "geometry": {"kind": "sphere", "center": [0, 0, 0], "radius": radius},
            "camera": {"kind": "orthographic", "width": SIZE, "height": SIZE, "extent": extent},
        },
    )


def _distance(attenuation: Any) -> float:
    """That at which the fit knows k_d and k_s best; without one, that of a lamp beside a ball."""
    found = (attenuation or {}).get("reference_distance")
    return found if isinstance(found, float) and found > 0 else 4.0


def _light(attenuation: AbstractAttenuation | None, distance: float) -> AbstractLight:
    from diffshade.light.parallel import ParallelLight
    from diffshade.light.point import PointLight

    towards: Any = TOWARDS
    intensity: Any = 1.0
    if attenuation is None:
        return ParallelLight(towards, intensity)
    place: Any = [round(x * distance / math.hypot(*TOWARDS), 4) for x in TOWARDS]
    return PointLight(place, intensity, attenuation)
