"""The tables that `capture.toml` and `scene.toml` share: geometry, camera and lights."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Bool

from diffshade.errors import BadInput, naming
from diffshade.io.foreground import masked_gbuffer
from diffshade.io.limits import check_size
from diffshade.io.normals_file import NormalMap, normals_gbuffer, read_normals
from diffshade.io.toml_document import Table

if TYPE_CHECKING:
    from diffshade.geometry.camera import AbstractCamera
    from diffshade.geometry.frequency import AbstractFrequency
    from diffshade.geometry.gbuffer import GBuffer
    from diffshade.geometry.surface import AbstractSurface
    from diffshade.light.attenuation import AbstractAttenuation
    from diffshade.light.base import AbstractLight
    from diffshade.light.distributed import AbstractEmitter

__all__ = [
    "View",
    "asks_for_fit",
    "channel_count",
    "read_lights",
    "read_view",
    "refuse_near_lights",
    "view_through",
]

Mask = Bool[np.ndarray, "H W"]


class View(NamedTuple):
    """The `geometry` and the `camera` of a file; normals over an image may do without camera."""

    geometry: AbstractSurface | NormalMap
    camera: AbstractCamera | None
    notes: tuple[str, ...]
    """What was found on reading a mesh."""


def read_view(top: Table) -> View:
    """What is seen, and from where."""
    geometry, notes = _geometry(top.table("geometry"))
    if "camera" in top:
        return View(geometry, _camera(top.table("camera")), notes)
    if not isinstance(geometry, NormalMap):
        top.fail('the key "camera" is missing; only geometry of kind "normals" needs none')
    return View(geometry, None, notes)


def read_lights(table: Table) -> tuple[Any, ...]:
    """`{ kind = "point" | "spot" | "parallel" | "rectangle" | "disc" | "sphere" | "line" |
    "environment", ... }`.

    A light, or one with extent; of an environment that has `samples` the parallel lights that it is
    then: what `ds.Scene` takes.
    A light that `asks_for_fit` gets f = 1, where the fit of the constants starts.
    """
    if table.values.get("kind") == "environment":
        from diffshade.io.environment_table import read_environment

        return read_environment(table)
    return (_light(table),)


def _light(table: Table) -> AbstractLight | AbstractEmitter:
    from diffshade.light.parallel import ParallelLight
    from diffshade.light.point import PointLight
    from diffshade.light.spot import SpotLight

    match table.choice("kind", ("point", "spot", "parallel", "environment", *_EXTENDED)):
        case "point":
            table.expect(("kind", "position", "intensity"), ("attenuation",))
            attenuation = _attenuation_of(table)
            with table.naming():
                place, intensity = table.vector("position"), table.per_channel("intensity")
                return PointLight(place, intensity, attenuation)
        case "spot":
            optional = ("exponent", "cutoff", "attenuation")
            table.expect(("kind", "position", "direction", "intensity"), optional)
            given = {key: table.number(key, least=0.0) for key in optional[:2] if key in table}
            attenuation = _attenuation_of(table)
            direction = _direction(table, "direction", "the direction in which the light shines")
            with table.naming():
                return SpotLight(
                    position=table.vector("position"),
                    direction=direction,
                    intensity=table.per_channel("intensity"),
                    attenuation=attenuation,
                    **given,
                )
        case "parallel":
            table.expect(("kind", "direction", "intensity"))
            towards = _direction(table, "direction", "the direction from the surface to the light")
            with table.naming():
                return ParallelLight(towards, table.per_channel("intensity"))
        case kind:
            return _extended(table, kind)


_EXTENDED = {
    "rectangle": ("center", "u", "v"),
    "disc": ("center", "normal", "radius"),
    "sphere": ("center", "radius"),
    "line": ("start", "end"),
}
"""Lights with extent, and what says where each is."""


def _extended(table: Table, kind: str) -> AbstractEmitter:
    from diffshade.light import distributed as d

    types: dict[str, Any] = {
        "rectangle": d.RectangleLight,
        "disc": d.DiscLight,
        "sphere": d.SphereLight,
        "line": d.LineLight,
    }
    table.expect(("kind", *_EXTENDED[kind], "radiance"), ("samples",))
    given: dict[str, Any] = {
        key: table.number(key, above=0.0) if key == "radius" else table.vector(key)
        for key in _EXTENDED[kind]
    }
    if "samples" in table:
        given["samples"] = table.whole("samples")
        if given["samples"] > _MOST_SAMPLES:
            table.fail(f"samples is {given['samples']}; give at most {_MOST_SAMPLES} along a side")
    with table.naming():
        return types[kind](radiance=table.per_channel("radiance"), **given)


_MOST_SAMPLES = 64


def _direction(table: Table, key: str, what: str) -> Any:
    direction = table.vector(key)
    if not any(direction):
        table.fail(f"{key} is zero; give {what}")
    return direction


def _attenuation_of(table: Table) -> AbstractAttenuation | None:
    return _attenuation(table.table("attenuation")) if "attenuation" in table else None


def asks_for_fit(light: Table) -> str | None:
    """The kind of a light's attenuation where it has no numbers: `{ kind = "quadratic" }`."""
    for kind in ("quadratic", "linear", "exponential"):
        if light.values.get("attenuation") == {"kind": kind}:
            return kind
    return None


def channel_count(table: Table, key: str, images: int) -> None:
    """Refuse a list of numbers that has not one for each channel of the images."""
    value = table.values.get(key)
    if isinstance(value, list) and len(value) not in (1, images):
        table.fail(
            f"{key} has {len(value)} numbers where the images have {images} channels;"
            f" give one number, or {images}"
        )


def refuse_near_lights(geometry: AbstractSurface | NormalMap, lights: list[Table]) -> None:
    """Refuse point lights on a map of normals that has no positions."""
    for light in lights:
        near = {"position", "center", "start"} & set(light.values)
        if isinstance(geometry, NormalMap) and geometry.position is None and near:
            light.fail(
                f"a {light.values['kind']} light needs positions, and {geometry.path.name} holds"
                " normals only; give an .npz with position, or parallel lights"
            )


def view_through(
    geometry: AbstractSurface | NormalMap,
    camera: AbstractCamera | None,
    path: Path,
    *,
    mask: Mask | None = None,
    shading: AbstractFrequency | None = None,
) -> GBuffer:
    """The G-buffer of what the camera of the file `path` sees inside a mask."""
    from diffshade.geometry.frequency import PhongShading

    if not isinstance(geometry, NormalMap):
        assert camera is not None
        with naming(path):
            return masked_gbuffer(geometry, camera, mask, shading=shading)
    if not isinstance(shading, PhongShading | None):
        raise BadInput(f"{path}: a map of normals has no faces; leave out shading, or use a mesh")
    if camera is None:
        return normals_gbuffer(geometry, mask)
    height, width = geometry.normal.shape[:2]
    if (height, width) != (camera.height, camera.width):
        raise BadInput(
            f"{geometry.path}: {width} x {height} pixels where the camera of {path} has"
            f" {camera.width} x {camera.height}; both must have one size"
        )
    return normals_gbuffer(geometry, mask, camera.viewer)


def _geometry(table: Table) -> tuple[AbstractSurface | NormalMap, tuple[str, ...]]:
    """`{ kind = "sphere" | "mesh" | "normals", ... }`; files stand relative to the TOML file."""
    match table.choice("kind", ("sphere", "mesh", "normals")):
        case "sphere":
            from diffshade.geometry.sphere import Sphere

            table.expect(("kind", "center", "radius"))
            with table.naming():
                return Sphere(table.vector("center"), table.number("radius", above=0.0)), ()
        case "mesh":
            from diffshade.io.mesh import read_mesh

            table.expect(("kind", "file"))
            file = table.file("file")
            mesh, notes = read_mesh(file, allow_outside=table.allow_outside)
            return mesh, tuple(f"{file.name}: {note}" for note in notes)
        case _:
            table.expect(("kind", "file"))
            return read_normals(table.file("file")), ()


def _camera(table: Table) -> AbstractCamera:
    """`{ kind = "orthographic" | "perspective", width, height, ... }`."""
    from diffshade.geometry.camera import OrthographicCamera, PerspectiveCamera

    kind = table.choice("kind", ("orthographic", "perspective"))
    pose = ("position", "target", "up")
    if kind == "orthographic":
        table.expect(("kind", "width", "height", "extent"), pose)
    else:
        table.expect(("kind", "width", "height", "fov", "position"), ("target", "up"))
    given: dict[str, Any] = {key: table.vector(key) for key in pose if key in table}
    size = table.whole("width"), table.whole("height")
    camera: AbstractCamera
    with table.naming():
        check_size((*size, 3))
        if kind == "orthographic":
            camera = OrthographicCamera(*size, table.number("extent", above=0.0), **given)
        else:
            camera = PerspectiveCamera(*size, table.number("fov", above=0.0), **given)
        camera.check()
    return camera


def _attenuation(table: Table) -> AbstractAttenuation:
    """The law; with a `reach`, that within a window."""
    from diffshade.light.attenuation import Windowed

    with table.naming():
        if "reach" not in table:
            return _law(table, asked=set(table.values) == {"kind"})
        reach = table.number("reach", above=0.0)
        law = {key: value for key, value in table.values.items() if key != "reach"}
        return Windowed(_law(dataclasses.replace(table, values=law), asked=False), reach)


def _law(table: Table, asked: bool) -> AbstractAttenuation:
    """The law, or none yet, where its constants are asked for."""
    from diffshade.light import attenuation as f

    match table.choice("kind", ("quadratic", "linear", "inverse_square", "exponential")):
        case "quadratic":
            constants: dict[str, Any] = {"c0": 1.0}
            if not asked:
                table.expect(("kind", "c0"), ("c1", "c2"))
                constants = {c: table.number(c, least=0.0) for c in table.values if c != "kind"}
            return f.QuadraticAttenuation(**constants)
        case "linear":
            constants = {"c0": 1.0, "c1": 0.0}
            if not asked:
                table.expect(("kind", "c0", "c1"))
                constants = {c: table.number(c, least=0.0) for c in constants}
            return f.LinearAttenuation(**constants)
        case "inverse_square":
            table.expect(("kind",))
            return f.InverseSquare()
        case _:
            constants = {"a": 0.0}
            if not asked:
                table.expect(("kind", "a"))
                constants["a"] = table.number("a", least=0.0)
            return f.ExponentialAttenuation(**constants)
