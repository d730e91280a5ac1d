"""A capture of AliceVision: the lights of its `lightingCalibration` (`lights.json`), and beside them the
scene that they were calibrated for (`.sfm`) and the photographs.

    .sfm   { "views": [{"viewId": , "poseId": , "path": , "metadata": {"Exif:DateTimeDigitized": }}] }

(AliceVision, `sfmDataIO/jsonIO.cpp`.) A photograph is looked for beside `lights.json` by the last name of
its path in the scene, in any case of letters. Lights with a `viewId` belong to its view. Those with a
`lightId` are a model for any scene: they go to the views in the order of the time at which they were
taken or, without it, of their paths, as in AliceVision (`photometricStereo.cpp`). Photographs with
"ambient" in their name are left out, and so are views without a light.

Each image is divided by its light's intensity, and I_a = 1 in what results. AliceVision takes values as
the files have them, display-referred or not; here they are decoded first, so that intensities measured
on display-referred photographs are off, of which a note warns.

Geometry is that of `folder_geometry`, or, where that knows of a mask at the most, the `normals.exr` of
AliceVision's `photometricStereo`, in which y is down and z forward.
"""

from __future__ import annotations

from pathlib import Path, PureWindowsPath
from typing import NamedTuple

import numpy as np

from diffshade.errors import BadInput
from diffshade.io.alicevision import AXES, Lights, read_lights
from diffshade.io.capture import Capture, assemble
from diffshade.io.contents import finder, within
from diffshade.io.divided_scene import divided_scene
from diffshade.io.folder_geometry import Geometry, folder_geometry, read_mask_of
from diffshade.io.foreground import lost_pixels
from diffshade.io.image import read_image
from diffshade.io.json_document import read_json
from diffshade.io.normals_file import NormalMap, normals_gbuffer
from diffshade.io.photographs import Photograph, read_photographs, size
from diffshade.io.toml_document import Table
from diffshade.progress import Progress

__all__ = ["read_alicevision"]

NORMALS = "normals.exr"
"""The map that `photometricStereo` writes for a folder."""
_TAKEN = "Exif:DateTimeDigitized"


class View(NamedTuple):
    """A photograph of a scene of AliceVision."""

    identity: str
    pose: str | None
    path: str
    taken: str | None

    @property
    def name(self) -> str:
        """The last name of its path, as of Windows or not."""
        return PureWindowsPath(self.path).name

    @property
    def ambient(self) -> bool:
        """Whether it shows the light of the room alone."""
        return "ambient" in Path(self.name).stem.lower()


def read_alicevision(
    path: Path,
    *,
    white: float | None = None,
    circle: tuple[float, float, float] | None = None,
    encoding: str | float | None = None,
    allow_outside: bool = False,
    progress: Progress | None = None,
) -> Capture:
    """Read the capture of a `lights.json`; options as `read_capture`. Raises `BadInput`."""
    lights = read_lights(path)
    scene = _scene_beside(path, allow_outside)
    chosen, notes = _lit(path, scene, lights)
    find = finder(path.parent)
    names = []
    for view, _ in chosen:
        name = find(view.name)
        if name is None:
            raise BadInput(
                f"{scene}: view {view.identity}: there is no {view.name} beside {path.name}; copy the"
                " photograph there"
            )
        names.append(name)
    photographs = read_photographs(
        path.parent,
        names,
        encoding=encoding,
        white=white,
        allow_outside=allow_outside,
        progress=progress,
    )
    divisors = [lights.intensities[k] for _, k in chosen]
    if photographs[0].encoded.shape[-1] == 1:
        if not (lights.intensities == lights.intensities[:, :1]).all():
            raise BadInput(f"{path}: an intensity has colours for images of one channel; give one")
        divisors = [divisor[:1] for divisor in divisors]
    gbuffer, geometry_notes, outline = _geometry(
        path.parent, names[0], photographs[0], circle, allow_outside
    )
    return assemble(
        photographs,
        gbuffer,
        [divided_scene(lights.directions[k]) for _, k in chosen],
        divisors=divisors,
        circle=outline,
        notes=(
            *lights.notes,
            *notes,
            *_measured_as_encoded(photographs, divisors),
            *geometry_notes,
        ),
    )


def _scene_beside(path: Path, allow_outside: bool) -> Path:
    found = sorted(f for f in path.parent.iterdir() if f.suffix.lower() == ".sfm")
    if len(found) == 1:
        return within(path.parent, found[0].name, allow_outside=allow_outside)
    names = ", ".join(file.name for file in found[:3])
    raise BadInput(
        f"{path}: {f'several scenes lie beside it ({names})' if found else 'no scene lies beside it'};"
        " put there the one .sfm file that says which photograph a view is, and the photographs"
    )


def _views(scene: Path) -> list[View]:
    table = read_json(scene, "a scene of AliceVision, an .sfm file")
    if "views" not in table:
        table.fail('the key "views" is missing; give the scene that CameraInit wrote')
    found = []
    for entry in table.tables("views", "view"):
        metadata = entry.table("metadata") if entry.values.get("metadata") else entry
        found.append(
            View(
                identity=_text(entry, "viewId"),
                pose=_text(entry, "poseId") if "poseId" in entry else None,
                path=_text(entry, "path"),
                taken=_text(metadata, _TAKEN) if _TAKEN in metadata else None,
            )
        )
    if len({view.identity for view in found}) != len(found):
        table.fail("has a view twice; leave one out")
    return found


def _text(entry: Table, key: str) -> str:
    value = entry.values.get(key)
    if type(value) is int or (isinstance(value, str) and value):
        return str(value)
    return entry.fail(f"{key} is not there, or no text; correct it")


def _lit(path: Path, scene: Path, lights: Lights) -> tuple[list[tuple[View, int]], list[str]]:
    """The views that have a light, each with the number of that, and what was left out."""
    every = _views(scene)
    views = [view for view in every if not view.ambient]
    notes = [f"{view.name}: shows ambient light alone: left out" for view in every if view.ambient]
    if lights.for_any_scene:
        dated = all(view.taken is not None for view in views)
        views.sort(key=lambda view: (view.taken or "" if dated else "", view.path))
        if len(views) != len(lights.views):
            raise BadInput(
                f"{path}: a model of {len(lights.views)} lights where {scene.name} has {len(views)} views"
                " that are lit; give the scene of a capture with one view a light"
            )
        order = "the time they were taken" if dated else "their paths"
        chosen = [(view, k) for k, view in enumerate(views)]
        notes.append(f"lights are a model for any scene: given to the views by {order}")
        return _of_one_pose(scene, chosen), notes
    number = {identity: k for k, identity in enumerate(lights.views)}
    chosen = [(view, number[view.identity]) for view in views if view.identity in number]
    if not chosen:
        raise BadInput(
            f"{path}: none of its views is in {scene.name}; give the scene of these lights"
        )
    notes += [
        f"{view.name}: {path.name} has no light for it: left out"
        for view in views
        if view.identity not in number
    ]
    if unknown := len(number) - len(chosen):
        notes.append(f"{unknown} lights of {path.name} have no view in {scene.name}: passed over")
    return _of_one_pose(scene, chosen), notes


def _of_one_pose(scene: Path, chosen: list[tuple[View, int]]) -> list[tuple[View, int]]:
    poses = {view.pose for view, _ in chosen}
    if len(poses) > 1:
        raise BadInput(
            f"{scene}: the views with a light are of {len(poses)} poses, and a capture is taken from one"
            " place; keep the views of one poseId"
        )
    return chosen


def _measured_as_encoded(
    photographs: list[Photograph], divisors: list[np.ndarray]
) -> tuple[str, ...]:
    if all(p.encoding == "linear" for p in photographs) or np.ptp(np.stack(divisors)) == 0:
        return ()
    return (
        "intensities are AliceVision's, which measures them on values as encoded: for images that are not"
        " linear they are off; give --gains to find them from the light that arrives",
    )


def _geometry(
    folder: Path,
    name: str,
    photograph: Photograph,
    circle: tuple[float, float, float] | None,
    allow_outside: bool,
) -> Geometry:
    height, width = photograph.encoded.shape[:2]
    image = folder / name
    own, measured, sphere, mask_file = (
        within(folder, file, allow_outside=allow_outside)
        for file in (NORMALS, "Normal_gt.mat", "sphere.json", "mask.png")
    )
    if circle is not None or measured.exists() or sphere.exists() or not own.exists():
        return folder_geometry(folder, image, (height, width), circle, allow_outside=allow_outside)
    normal = read_image(own, allow_nonfinite=True).values
    if normal.shape != (height, width, 3):
        raise BadInput(
            f"{own}: {size(normal)} where {image} is {size(photograph.encoded)}; both must have one"
            " size, and normals three channels"
        )
    mask = read_mask_of(mask_file, image, (height, width)) if mask_file.exists() else None
    gbuffer = normals_gbuffer(NormalMap(own, normal * AXES.astype(normal.dtype)), mask)
    return Geometry(
        gbuffer, (f"geometry from AliceVision's {NORMALS}", *lost_pixels(mask, gbuffer)), None
    )
