"""`scene.toml`: what `diffshade render` draws.

    geometry = { kind = "sphere", center = [0, 0, 0], radius = 1.0 }
    camera   = { kind = "orthographic", width = 256, height = 256, extent = 2.2 }
    ambient  = [0.1, 0.1, 0.1]                       # optional
    shading  = "phong"                               # or "flat", "gouraud"; optional
    lights   = [{ kind = "parallel", direction = [0, 0, 1], intensity = 1.0 }]
    shadows  = true                                  # that the surface throws on itself; optional
    [material]                                       # optional for a mesh that has materials
    ka = 0.1                                         # each term is optional: left out, it is absent
    kd = [0.6, 0.3, 0.2]
    [[material.specular]]
    kind      = "phong"                              # or another: see `reflectance_tables`
    ks        = 0.5
    shininess = 32

`body`, the boundary over the diffuse term, stands beside `kd`; so do `od` and `os`, the object
colours, and `transparency`: the far side of the surface is then seen through the near one.
`schema = "diffshade.scene/1"` may stand at the top.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from diffshade.errors import BadInput, naming
from diffshade.io.environment_table import environment_channels
from diffshade.io.reflectance_tables import (
    per_channel_keys,
    read_body,
    read_lobe,
    read_transparency,
)
from diffshade.io.toml_document import Table, read_toml
from diffshade.io.toml_tables import (
    asks_for_fit,
    read_lights,
    read_view,
    refuse_near_lights,
    view_through,
)

if TYPE_CHECKING:
    from diffshade.geometry.camera import AbstractCamera
    from diffshade.geometry.frequency import AbstractFrequency
    from diffshade.geometry.gbuffer import GBuffer
    from diffshade.geometry.surface import AbstractSurface
    from diffshade.io.normals_file import NormalMap
    from diffshade.light.base import AbstractLight
    from diffshade.light.distributed import AbstractEmitter
    from diffshade.reflectance.lobe import AbstractLobe
    from diffshade.reflectance.material import Material
    from diffshade.reflectance.transparency import AbstractTransparency
    from diffshade.scene import Scene

__all__ = ["SCHEMA", "SceneFile", "read_scene_toml"]

SCHEMA = "diffshade.scene/1"
OPTIONAL = ("schema", "camera", "ambient", "lights", "material", "shading", "shadows")
COEFFICIENTS = ("ka", "kd", "od", "os")
OF_MATERIAL = (*COEFFICIENTS, "specular", "body", "transparency")


class SceneFile(NamedTuple):
    """What a `scene.toml` holds. A map of normals may have no camera."""

    geometry: AbstractSurface | NormalMap
    camera: AbstractCamera | None
    scene: Scene
    material: Material | tuple[Material, ...]
    """One, or those of a mesh's slots, as `ds.render` takes them."""
    shading: AbstractFrequency | None
    """None where the file does not say: once a pixel."""
    lights: tuple[AbstractLight | AbstractEmitter, ...]
    """Those of the scene, lights with extent as they are."""
    shadows: bool
    notes: tuple[str, ...]
    """What was found on reading, one line each, for the user to see."""
    transparency: AbstractTransparency | None = None

    def gbuffer(self, path: Path) -> GBuffer:
        """The G-buffer to render; complaints name the file `path`."""
        return view_through(self.geometry, self.camera, path, shading=self.shading)

    def lit(self, gbuffer: GBuffer) -> Scene:
        """The scene as the points of a G-buffer see it, with shadows where the file asks for them."""
        from diffshade.geometry.surface import AbstractSurface
        from diffshade.shading.shadows import shadowed

        if not self.shadows:
            return self.scene
        assert isinstance(self.geometry, AbstractSurface)
        return replace(self.scene, lights=shadowed(self.lights, gbuffer, self.geometry))

    def layers(self, path: Path) -> tuple[tuple[GBuffer, ...], ...]:
        """What is seen and what is behind it, as `ds.layers` gives it; of what is opaque the first."""
        nearest = self.gbuffer(path)
        if self.transparency is None:
            return ((nearest,),)
        from diffshade.geometry.layers import layers
        from diffshade.geometry.surface import AbstractSurface

        assert isinstance(self.geometry, AbstractSurface)  # the reader has refused what is not
        assert self.camera is not None
        with naming(path):
            return layers(self.geometry, self.camera)


def read_scene_toml(path: Path, *, allow_outside: bool = False) -> SceneFile:
    """Read a `scene.toml`. Raises `BadInput`, in one line, for what is unknown, missing or wrong, and
    for a file outside the folder unless `allow_outside`.

    >>> file = read_scene_toml(path)
    >>> gbuffer = file.gbuffer(path)
    >>> image = ds.render(gbuffer, file.lit(gbuffer), file.material)
    """
    from diffshade.scene import Scene

    top = read_toml(path, allow_outside=allow_outside)
    if "image" in top:
        top.fail("this is a capture, of photographs; give it to diffshade fit")
    for key in OF_MATERIAL:
        if key in top:
            header = "[[material.specular]]" if key == "specular" else "[material]"
            top.fail(f"{key} stands at the top, and is the material's: write it below {header}")
    top.expect(("geometry",), OPTIONAL)
    if "schema" in top:
        top.choice("schema", (SCHEMA,))
    shading = _shading(top) if "shading" in top else None
    lights = top.tables("lights", "light") if "lights" in top else []
    for light in lights:
        if asks_for_fit(light):
            light.fail("its attenuation has no numbers, which is for a fit; give its constants")
    ambient = top.per_channel("ambient") if "ambient" in top else None
    if ambient is None and not lights:
        top.fail("there is no light; give lights, ambient, or both")
    material: Material | tuple[Material, ...] | None = None
    transparency = None
    if "material" in top:
        table = top.table("material")
        material = _material(table)
        if "transparency" in table:
            transparency = read_transparency(table.table("transparency"))
    with top.naming():
        each = tuple(map(read_lights, lights))
        given = tuple(chain.from_iterable(each))
        scene = Scene(ambient=ambient, lights=given)
    _one_channel_count(top, lights, tuple(map(environment_channels, lights, each)))
    geometry, camera, notes = read_view(top)
    refuse_near_lights(geometry, lights)
    shadows = "shadows" in top and top.truth("shadows")
    for light in lights:
        if shadows and light.values["kind"] == "environment" and "samples" not in light:
            light.fail("an environment throws shadows by its samples only; give samples = 16")
    if shadows and top.table("geometry").values["kind"] == "normals":
        top.fail("shadows need a surface, and a map of normals is none; leave shadows out")
    if material is None:
        of_mesh: tuple[Material, ...] = getattr(geometry, "materials", ())
        if not of_mesh:
            top.fail('the key "material" is missing; only a mesh with materials needs none')
        material = of_mesh
    if transparency is not None:
        _check_layers(top, shadows)
    seen = geometry, camera, scene, material, shading, given, shadows, notes
    return SceneFile(*seen, transparency)


def _check_layers(top: Table, shadows: bool) -> None:
    """Refuse what has no layers."""
    table = top.table("material").table("transparency")
    if top.table("geometry").values["kind"] == "normals":
        table.fail("a map of normals has nothing behind it; give a sphere or a mesh")
    if top.values.get("shading", "phong") != "phong":
        table.fail('what is transparent is shaded once a pixel; leave out shading, or give "phong"')
    if shadows:
        table.fail(
            "light that a transparent surface lets through casts no full shadow; leave out shadows"
        )


def _shading(top: Table) -> AbstractFrequency:
    from diffshade.geometry.frequency import FlatShading, GouraudShading, PhongShading

    kinds: dict[str, Callable[[], AbstractFrequency]] = {
        "phong": PhongShading,
        "flat": FlatShading,
        "gouraud": GouraudShading,
    }
    return kinds[top.choice("shading", kinds)]()


def _material(table: Table) -> Material:
    from diffshade.reflectance.material import Material

    table.expect((), OF_MATERIAL)
    if not {"ka", "kd", "specular"} & set(table.values):
        table.fail("it has no term; give ka, kd or specular")
    lobes: tuple[AbstractLobe, ...] = ()
    if "specular" in table:
        lobes = tuple(map(read_lobe, table.tables("specular", "lobe")))
    body = read_body(table.table("body")) if "body" in table else None
    given: dict[str, Any] = {k: table.per_channel(k) for k in COEFFICIENTS if k in table}
    with table.naming():
        return Material(**given, specular=lobes, body=body)


def _one_channel_count(top: Table, lights: list[Table], around: tuple[int, ...]) -> None:
    """Refuse lists of different lengths: one number a channel of one image."""
    tables = [(top, "ambient"), *((x, key) for x in lights for key in ("intensity", "radiance"))]
    if "material" in top:
        material = top.table("material")
        tables += [(material, key) for key in COEFFICIENTS]
        lobes = material.tables("specular", "lobe") if "specular" in material else []
        others = [material.table(key) for key in ("body", "transparency") if key in material]
        for part in (*lobes, *others):
            tables += per_channel_keys(part)
    environments = zip(around, lights, strict=True)
    counts = {n: f"{light.place}: environment" for n, light in environments if n > 1}
    for table, key in tables:
        value = table.values.get(key)
        if isinstance(value, list) and len(value) > 1:
            counts[len(value)] = f"{table.place}: {key}" if table.place else key
    if len(counts) > 1:
        said = " and ".join(f"{where} has {count} numbers" for count, where in counts.items())
        raise BadInput(f"{top.path}: {said}; give one number, or one for each channel")
