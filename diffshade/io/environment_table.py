"""An environment in a TOML file: a latitude-longitude image, AliceVision's `.shl`, or harmonics.

    lights = [{ kind = "environment", file = "sky.exr", order = 8 }]
    lights = [{ kind = "environment", file = "global.shl" }]
    lights = [{ kind = "environment", harmonics = [[0.8, 0.7, 0.9], ...], intensity = 0.5 }]

Rows of `harmonics` have one number, or one a channel.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from diffshade.io.encoding import Encoding
from diffshade.io.image import read_image
from diffshade.io.shl import read_shl
from diffshade.io.toml_document import Table

if TYPE_CHECKING:
    from diffshade.light.environment import EnvironmentLight

__all__ = ["environment_channels", "read_environment"]

_HIGHEST = 64
"""The highest order that is read: the lobe of a shininess of 1000 tells no more."""


def read_environment(table: Table) -> EnvironmentLight:
    """The light of a table; raises `BadInput` for what it has wrong."""
    from diffshade.light.environment import EnvironmentLight

    own = ("harmonics",) if "harmonics" in table else ("file", "order")
    if "order" not in table and str(table.values.get("file")).lower().endswith(".shl"):
        own = ("file",)
    table.expect(("kind", *own), ("intensity",))
    intensity: Any = table.per_channel("intensity") if "intensity" in table else 1.0
    if "harmonics" in table:
        with table.naming():
            light = EnvironmentLight(table.rows("harmonics"), intensity)
        if light.order > _HIGHEST:
            table.fail(f"the harmonics are of order {light.order}; give at most {_HIGHEST}")
        return light
    if own == ("file",):
        return EnvironmentLight(read_shl(table.file("file")).harmonics, intensity)
    order = table.whole("order")
    if order > _HIGHEST:
        table.fail(f"order is {order}; give at most {_HIGHEST}")
    path = table.file("file")
    image = read_image(path)
    if image.encoding is not Encoding.LINEAR:
        table.fail(f"{path.name} does not say that it is linear; give an OpenEXR or Radiance file")
    with table.naming():
        grey = image.values.shape[2] == 1
        found = EnvironmentLight.from_image(image.values[..., 0] if grey else image.values, order)
        return EnvironmentLight(found.harmonics, intensity)


def environment_channels(light: Any) -> int:
    """How many channels a light's harmonics have; 1 where they are for all, or it has none."""
    harmonics = getattr(light, "harmonics", None)
    return 1 if harmonics is None or harmonics.ndim == 1 else int(harmonics.shape[1])
