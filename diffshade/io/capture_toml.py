"""`capture.toml`: photographs, and the geometry, camera and lights they were taken with.

Nothing is divided by intensities: they and I_a are part of the model. An image without its own word on
encoding needs `encoding` here; `white` is the level at which the sensor clips, as `--white` has it.
`attenuation = { kind = "quadratic" }` without numbers, or "linear" or "exponential", asks for one set of
constants to be fitted for all point lights, so all of them say so, or none.

`exposure` of an image, in seconds or relative to the others, is what the image is divided by, so that its
unit is that of an exposure of 1; if one image has it, all have. It may be a list of one number a channel,
in which the intensity of a light may be: that is not compared with what the camera wrote (EXIF).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from diffshade.errors import BadInput
from diffshade.io.capture import Capture, Exposure, assemble
from diffshade.io.encoding import decode
from diffshade.io.environment_table import environment_channels
from diffshade.io.folder_geometry import read_mask_of
from diffshade.io.foreground import lost_pixels
from diffshade.io.normals_file import NormalMap
from diffshade.io.photographs import Photograph, read_photographs, size
from diffshade.io.toml_document import Table, read_toml
from diffshade.io.toml_tables import (
    asks_for_fit,
    channel_count,
    read_lights,
    read_view,
    refuse_near_lights,
    view_through,
)
from diffshade.progress import Progress

if TYPE_CHECKING:
    from diffshade.light.attenuation import AbstractAttenuation

__all__ = ["SCHEMA", "read_capture_toml"]

SCHEMA = "diffshade.capture/1"


def read_capture_toml(
    path: Path,
    *,
    white: float | None = None,
    encoding: str | float | None = None,
    allow_outside: bool = False,
    progress: Progress | None = None,
) -> Capture:
    """Read a `capture.toml`; options as `read_capture`. Raises `BadInput`."""
    from diffshade.scene import Scene

    top = read_toml(path, allow_outside=allow_outside)
    if "material" in top:
        top.fail("this is a scene, whose material is known; give it to diffshade render or view")
    top.choice("schema", (SCHEMA,))
    optional = ("encoding", "white", "mask", "ambient", "camera")
    top.expect(("schema", "geometry", "image"), optional)
    stated = _encoding(top)
    level = top.number("white", above=0.0) if "white" in top else None
    ambient = top.per_channel("ambient") if "ambient" in top else None
    entries = top.tables("image", "image")
    if not entries:
        top.fail("there is no [[image]]; give at least one")
    lights = [_lights(entry, lit=ambient is not None) for entry in entries]
    exposures = _exposures(entries)
    fitted = _fitted([light for of_image in lights for light in of_image])
    known: dict[str, Any] = {}  # the file of an environment is read once
    for light in (light for of_image in lights for light in of_image):
        if (said := repr(light.values)) not in known:
            known[said] = read_lights(light)
    with top.naming():
        scenes = [
            Scene(ambient, tuple(lit for light in of_image for lit in known[repr(light.values)]))
            for of_image in lights
        ]

    geometry, camera, notes = read_view(top)
    refuse_near_lights(geometry, [light for of_image in lights for light in of_image])

    names = [entry.text("file") for entry in entries]
    first = path.parent / names[0]
    photographs = read_photographs(
        path.parent,
        names,
        encoding=stated if encoding is None else encoding,
        white=white,
        allow_outside=allow_outside,
        progress=progress,
    )
    if level is not None and white is None:
        photographs = [_clipping_at(level, photograph, top) for photograph in photographs]
    height, width, channels = photographs[0].encoded.shape
    channel_count(top, "ambient", channels)
    for entry in entries:
        channel_count(entry, "exposure", channels)
    for of_image in lights:
        for light in of_image:
            channel_count(light, "intensity", channels)
            channel_count(light, "radiance", channels)
            around = environment_channels(light, known[repr(light.values)])
            if around not in (1, channels):
                light.fail(
                    f"the environment has {around} channels where the images have {channels};"
                    f" give one, or {channels}"
                )
    if camera is not None and (camera.height, camera.width) != (height, width):
        top.fail(
            f"the camera has {camera.width} x {camera.height} pixels where {first} is"
            f" {size(photographs[0].encoded)}; both must have one size"
        )
    mask = None
    if "mask" in top:
        mask = read_mask_of(top.file("mask"), first, (height, width))
    if isinstance(geometry, NormalMap) and geometry.normal.shape[:2] != (height, width):
        raise BadInput(
            f"{geometry.path}: {size(geometry.normal[..., 0])} where {first} is"
            f" {size(photographs[0].encoded)}; both must have one size"
        )
    gbuffer = view_through(geometry, camera, path, mask=mask)
    return assemble(
        photographs,
        gbuffer,
        scenes,
        exposures=exposures,
        fit_attenuation=fitted,
        notes=(*notes, *lost_pixels(mask, gbuffer)),
    )


def _encoding(top: Table) -> str | float | None:
    if "encoding" not in top:
        return None
    encoding = top.values["encoding"]
    try:
        decode([0.0], encoding)
    except BadInput as error:
        top.fail(str(error))
    return encoding


def _clipping_at(level: float, photograph: Photograph, top: Table) -> Photograph:
    if photograph.white is not None and level > photograph.white:
        top.fail(
            f"white is {level:g}, beyond the full scale of {photograph.name}; give the part of it at"
            " which the sensor clips, above 0 and at most 1"
        )
    return replace(photograph, white=level)


def _lights(entry: Table, *, lit: bool) -> list[Table]:
    entry.expect(("file", "lights"), ("exposure",))
    lights = entry.tables("lights", "light")
    if not lights and not lit:
        entry.fail("lights is empty and there is no ambient light; give one or the other")
    return lights


def _exposures(entries: list[Table]) -> list[Exposure] | None:
    if not any("exposure" in entry for entry in entries):
        return None
    found = []
    for entry in entries:
        if "exposure" not in entry:
            entry.fail("has no exposure where others have; give each image its own, or none any")
        exposure = np.asarray(entry.per_channel("exposure", above=0.0))
        if not ((exposure > 1e-9) & (exposure < 1e9)).all():
            entry.fail(
                f"exposure is {exposure.min():.3g}; give seconds, or a number relative to the others"
            )
        found.append(exposure)
    return found


def _fitted(lights: list[Table]) -> type[AbstractAttenuation] | None:
    """The law that is to be fitted, if any is; then every point light has it."""
    from diffshade.light import attenuation as laws

    asked = [light for light in lights if asks_for_fit(light)]
    if not asked:
        return None
    kind = asks_for_fit(asked[0])
    for light in lights:
        if light.values.get("kind") != "point" or asks_for_fit(light) == kind:
            continue
        light.fail(
            f"its attenuation is {'of another kind' if asks_for_fit(light) else 'known'} where that"
            f" of {asked[0].place} is to be fitted, and one set is fitted for all point lights; give"
            f' every one {{ kind = "{kind}" }}, or every one its numbers'
        )
    if kind == "linear":
        return laws.LinearAttenuation
    return laws.QuadraticAttenuation if kind == "quadratic" else laws.ExponentialAttenuation
