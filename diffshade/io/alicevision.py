"""AliceVision's spheres and lights, as its `sphereDetection` and `lightingCalibration` write them.

    spheres  { "VIEW": [{"x": , "y": , "r": , "score": , "type": "matte"}] }
    lights   { "lights": [{"viewId" or "lightId": , "type": "directional",
                           "direction": [x, y, z], "intensity": [r, g, b]}] }

(AliceVision, `sphereDetection.cpp` and `lightingCalibration.cpp`.) Every number is a text in quotes, as
Boost's property trees write them; plain numbers are read too. x and y of a sphere are pixels from the
image's centre, y down. Directions point to the light, in axes x right, y down, z forward: here y and z
are turned about, to x right, y up, z to the camera. Of a light of type "SH" (spherical harmonics) the
first three numbers are its direction, with the intensity of a distant light alone. The other six, of
1, n_x n_y, n_x n_z, n_y n_z, n_x^2 - n_y^2 and 3 n_z^2 - 1, are passed over, as AliceVision itself does:
they were fitted to what a light of that direction and of intensity 1, not of its own, leaves of the
ball, so that there is no unit in which all nine are one light. (Those of `diffshade.io.shl` are.)
"""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from diffshade.errors import BadInput
from diffshade.io.atomic import replacing
from diffshade.io.circle import Circle
from diffshade.io.json_document import read_json
from diffshade.io.text_rows import direction
from diffshade.io.toml_document import Table

__all__ = ["Lights", "read_lights", "read_spheres", "write_lights", "write_spheres"]

AXES = np.array([1.0, -1.0, -1.0])
"""What AliceVision's axes are multiplied by."""


class Lights(NamedTuple):
    """Distant lights, one an image."""

    views: tuple[str, ...]
    """The view of each in AliceVision's scene, or its number where the file is a model for any scene."""
    directions: Float[np.ndarray, "N 3"]
    """Unit vectors to the lights; x right, y up, z to the camera."""
    intensities: Float[np.ndarray, "N 3"]
    notes: tuple[str, ...] = ()
    """What was passed over."""
    for_any_scene: bool = False
    """Whether the views are numbers of lights ("lightId"), to be given to the views in their order."""


def read_spheres(path: str | os.PathLike[str], shape: tuple[int, int]) -> dict[str, Circle]:
    """The outline of the sphere in each view, in pixels from the top left corner of an image of `shape`
    (height, width). Of several in a view the first counts, which AliceVision was surest of.

    Raises `BadInput`.

    >>> read_spheres("spheres.json", (1080, 1920))["1234"].radius
    """
    table = read_json(Path(path), "AliceVision's spheres, as sphereDetection writes them")
    height, width = shape
    found = {}
    for view in table.values:
        spheres = table.tables(view, f"view {view}, sphere")
        if not spheres:
            continue
        sphere = spheres[0]
        x, y, radius = (_number(sphere, key) for key in ("x", "y", "r"))
        circle = Circle(x + 0.5 * width, y + 0.5 * height, radius)
        found[view] = circle.checked(f"{path}: {sphere.place}")
    if not found:
        table.fail("holds no sphere; give those that sphereDetection found")
    return found


def read_lights(path: str | os.PathLike[str]) -> Lights:
    """The lights of a file, in its order. Raises `BadInput`.

    >>> lights = read_lights("lights.json")
    >>> scenes = [
    ...     ds.Scene(lights=ds.ParallelLight(l, i))
    ...     for l, i in zip(lights.directions, lights.intensities)
    ... ]
    """
    table = read_json(Path(path), "AliceVision's lights, as lightingCalibration writes them")
    if str(table.values.get("schema")).startswith("diffshade.fit/"):
        table.fail(
            "this is a fit, not a capture; give the photographs' own capture, or this to diffshade"
            " evaluate or export"
        )
    if "lights" not in table:
        table.fail('the key "lights" is missing; give the file of a lightingCalibration')
    entries = table.tables("lights", "light")
    if not entries:
        table.fail("holds no light; give the file of a lightingCalibration")
    views, directions, intensities = [], [], []
    harmonics = models = 0
    for entry in entries:
        kind = entry.choice("type", ("directional", "SH"))
        harmonics += kind == "SH"
        models += "viewId" not in entry
        views.append(_identity(entry))
        vector = _numbers(entry, "direction", 9 if kind == "SH" else 3)[:3]
        place = f"{path}: {entry.place}"
        directions.append(direction(vector * AXES, place))
        intensities.append(_numbers(entry, "intensity", 3))
        if not (intensities[-1] > 0).all():
            entry.fail("an intensity is not above 0; correct it")
    if len(set(views)) != len(views):
        table.fail("has two lights for one view; leave one out")
    if models not in (0, len(views)):
        table.fail("has lights with a viewId and others with a lightId; give one or the other")
    notes: tuple[str, ...] = ()
    if harmonics:
        notes = (
            f"{harmonics} lights of spherical harmonics: read as directional, as AliceVision does; the"
            " six numbers after the direction are in another unit than it",
        )
    return Lights(tuple(views), np.array(directions), np.array(intensities), notes, models > 0)


def write_spheres(
    path: str | os.PathLike[str], circles: Mapping[str, Circle], shape: tuple[int, int]
) -> None:
    """Write the outline of a sphere in each view, by its id; atomic.

    >>> write_spheres("spheres.json", {"1234": Circle(960.0, 540.0, 200.0)}, (1080, 1920))
    """
    height, width = shape
    document = {}
    for view, circle in circles.items():
        own = Circle(*circle).checked(f"{path}: view {view}")
        place = {"x": own.cx - 0.5 * width, "y": own.cy - 0.5 * height, "r": own.radius}
        document[str(view)] = [{**{k: repr(float(v)) for k, v in place.items()}, "type": "matte"}]
    _write(path, document)


def write_lights(
    path: str | os.PathLike[str],
    views: Sequence[str],
    directions: Sequence[Any] | np.ndarray,
    intensities: Sequence[Any] | np.ndarray | None = None,
) -> None:
    """Write a distant light for each view, by its id; atomic.

    `directions` [N, 3] point to the lights, x right, y up, z to the camera; `intensities` [N, 3] are 1
    where they are not given.

    >>> write_lights("lights.json", ["1234"], [(0, 0, 1)])
    """
    vectors = np.asarray(directions, float).reshape(-1, 3)
    powers = np.ones_like(vectors) if intensities is None else np.asarray(intensities, float)
    if not len(vectors) == len(views) == len(powers) or powers.shape != vectors.shape:
        raise BadInput(
            f"{path}: {len(vectors)} directions and intensities of shape {powers.shape} for"
            f" {len(views)} views; give three numbers each"
        )
    if not (np.isfinite(vectors).all() and np.isfinite(powers).all() and (powers > 0).all()):
        raise BadInput(f"{path}: a light is not finite, or not above 0; mend what made it")
    lights = []
    for view, vector, power in zip(views, vectors, powers, strict=True):
        turned = direction(vector, f"{path}: view {view}") * AXES + 0.0  # no minus before a 0
        lights.append(
            {
                "viewId": str(view),
                "type": "directional",
                "direction": [repr(x) for x in turned.tolist()],
                "intensity": [repr(x) for x in power.tolist()],
            }
        )
    _write(path, {"lights": lights})


def _write(path: str | os.PathLike[str], document: Mapping[str, Any]) -> None:
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(document, indent=4) + "\n", encoding="utf-8")


def _identity(entry: Table) -> str:
    for key in ("viewId", "lightId"):
        if key in entry:
            value = entry.values[key]
            if isinstance(value, str) or type(value) is int:
                return str(value)[:100]
            entry.fail(f"{key} is no number; give that of a view")
    return entry.fail("has neither viewId nor lightId; give that of a view")


def _number(table: Table, key: str) -> float:
    if key not in table:
        table.fail(f'the key "{key}" is missing; give x, y and r')
    return float(_converted(table, key, [table.values[key]])[0])


def _numbers(table: Table, key: str, count: int) -> np.ndarray:
    values = table.values.get(key)
    if not isinstance(values, list) or len(values) != count:
        table.fail(f"{key} is not a list of {count} numbers; correct it")
    return _converted(table, key, values)


def _converted(table: Table, key: str, values: list[Any]) -> np.ndarray:
    """Finite numbers, in quotes or not."""
    try:
        if any(
            isinstance(value, bool) or not isinstance(value, str | int | float) for value in values
        ):
            raise ValueError
        numbers = np.array([float(value) for value in values])
    except (ValueError, OverflowError):
        table.fail(f"{key} holds what is no number; correct it")
    if not (np.abs(numbers) < 1e15).all():
        table.fail(f"{key} holds NaN, infinity or what is as good as that; correct it")
    return numbers
