"""An environment in a TOML file: a latitude-longitude image, AliceVision's `.shl`, or harmonics.

    lights = [{ kind = "environment", file = "sky.exr", order = 8 }]
    lights = [{ kind = "environment", file = "global.shl" }]
    lights = [{ kind = "environment", harmonics = [[0.8, 0.7, 0.9], ...], intensity = 0.5 }]
    lights = [{ kind = "environment", file = "sky.exr", order = 8, samples = 16 }]

Rows of `harmonics` have one number, or one a channel. With `samples` the environment is 2 samples^2
parallel lights, all around, which light every lobe and body, and throw shadows; without, it is
integrated, which asks for diffuse and plain Phong terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from diffshade.io.encoding import Encoding
from diffshade.io.image import read_image
from diffshade.io.shl import read_shl
from diffshade.io.toml_document import Table

if TYPE_CHECKING:
    from diffshade.light.base import AbstractLight
    from diffshade.light.environment import EnvironmentLight

__all__ = ["environment_channels", "read_environment"]

_HIGHEST = 64
"""The highest order that is read: the lobe of a shininess of 1000 tells no more."""
_MOST_SAMPLES = 32
"""From pole to pole, of 2,048 lights."""


def read_environment(table: Table) -> tuple[AbstractLight, ...]:
    """The light of a table, or those as which it is sampled; raises `BadInput` for what it has wrong."""
    own = ("harmonics",) if "harmonics" in table else ("file", "order")
    if "order" not in table and str(table.values.get("file")).lower().endswith(".shl"):
        own = ("file",)
    table.expect(("kind", *own), ("intensity", "samples"))
    if "samples" not in table:
        return (_environment(table),)
    samples = table.whole("samples")
    if samples > _MOST_SAMPLES:
        table.fail(f"samples is {samples}; give at most {_MOST_SAMPLES} from pole to pole")
    light = _environment(table)
    with table.naming():
        return light.as_lights(samples)


def _environment(table: Table) -> EnvironmentLight:
    from diffshade.light.environment import EnvironmentLight

    intensity: Any = table.per_channel("intensity") if "intensity" in table else 1.0
    if "harmonics" in table:
        with table.naming():
            light = EnvironmentLight(table.rows("harmonics"), intensity)
        if light.order > _HIGHEST:
            table.fail(f"the harmonics are of order {light.order}; give at most {_HIGHEST}")
        return light
    if "order" not in table:
        return _brighter(read_shl(table.file("file")), intensity)
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
        return _brighter(found, intensity)


def _brighter(light: EnvironmentLight, intensity: Any) -> EnvironmentLight:
    """With an intensity in the precision of its harmonics."""
    return replace(light, intensity=np.asarray(intensity, light.harmonics.dtype))  # type: ignore[arg-type]


def environment_channels(table: Table, lights: Sequence[Any]) -> int:
    """How many channels the environment of a table has, by what was read from it; 1 where it is for
    all, or the table is of another light."""
    if table.values["kind"] != "environment":
        return 1
    harmonics = getattr(lights[0], "harmonics", None)
    if harmonics is not None:
        return 1 if harmonics.ndim == 1 else int(harmonics.shape[1])
    return int(lights[0].intensity.size)
