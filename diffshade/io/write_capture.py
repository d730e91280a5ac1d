"""A capture into a folder of its own: a `capture.toml`, the files of its photographs, and its geometry.

What was found of a capture, such as where its lights are, is then read with it. The photographs are
copied as they are: how their values are decoded and what they are divided by stands in the file, so that
reading gives the same numbers. The geometry is an `.npz` of the G-buffer, whatever it was made of.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from diffshade.errors import BadInput
from diffshade.io.atomic import replacing
from diffshade.io.capture import Capture, Source
from diffshade.io.gbuffer import save_gbuffer
from diffshade.io.toml_text import law_kinds, value_text
from diffshade.io.written_capture import MARK

if TYPE_CHECKING:
    from diffshade.light.attenuation import AbstractAttenuation
    from diffshade.scene import Scene

__all__ = ["write_capture"]

GEOMETRY = "geometry.npz"


def write_capture(folder: Path, capture: Capture) -> None:
    """Write a capture that came from files, `capture.toml` last: with it the folder is whole.

    Its lights are parallel or point lights; of the latter an attenuation that is to be fitted is written
    as such. Raises `BadInput` for other lights, and for what cannot be written.

    >>> write_capture(Path("refined"), read_capture("diligent_ball"))
    """
    names = _names([source.path for source in capture.sources])
    text = _document(capture, names, folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(
            f"{folder}: cannot be written ({error.strerror}); name another folder"
        ) from None
    (folder / "capture.toml").unlink(missing_ok=True)
    for source, name in zip(capture.sources, names, strict=True):
        with replacing(folder / name) as temporary:
            shutil.copyfile(source.path, temporary)
    save_gbuffer(folder / GEOMETRY, capture.gbuffer)
    with replacing(folder / "capture.toml") as temporary:
        temporary.write_text(text, encoding="utf-8")


def _names(paths: Sequence[Path]) -> list[str]:
    """Names in one folder: the files' own, with their number where two have one name."""
    names = [path.name for path in paths]
    if len({name.lower() for name in (*names, GEOMETRY)}) > len(names):
        return names
    return [f"{number:03d}_{name}" for number, name in enumerate(names, 1)]


def _document(capture: Capture, names: Sequence[str], folder: Path) -> str:
    """The `capture.toml`."""
    from diffshade.io.capture_toml import SCHEMA

    top: dict[str, Any] = {"schema": SCHEMA}
    for key in ("encoding", "white"):  # where they differ, each file says its own
        said = {getattr(source, key) for source in capture.sources}
        if len(said) == 1 and (value := said.pop()) is not None:
            top[key] = value
    ambient = capture.scenes[0].ambient
    if ambient is not None:
        top["ambient"] = _numbers(ambient)
    top["geometry"] = {"kind": "normals", "file": GEOMETRY}
    lines = _lines(top)
    fitted = capture.fit_attenuation is not None
    channels = capture.images[0].shape[-1]
    for source, name, scene in zip(capture.sources, names, capture.scenes, strict=True):
        image = _image(source, name, scene, folder, channels=channels, fitted=fitted)
        lines += ["", "[[image]]", *_lines(image)]
    return "\n".join([MARK, "", *lines]) + "\n"


def _image(
    source: Source, name: str, scene: Scene, folder: Path, *, channels: int, fitted: bool
) -> dict[str, Any]:
    found: dict[str, Any] = {"file": name}
    if source.exposure is not None:  # a list is never compared with EXIF: it may be an intensity
        by_channel = source.exposure.ndim > 0
        each = np.broadcast_to(source.exposure, channels) if by_channel else source.exposure
        found["exposure"] = _numbers(each)
    return found | {"lights": [_light(light, folder, fitted=fitted) for light in scene.lights]}


def _light(light: Any, folder: Path, *, fitted: bool) -> dict[str, Any]:
    from diffshade.light.parallel import ParallelLight
    from diffshade.light.point import PointLight

    intensity = _numbers(light.intensity) if hasattr(light, "intensity") else None
    match light:
        case ParallelLight(direction=direction, visible=None):
            return {
                "kind": "parallel",
                "direction": _numbers(direction),
                "intensity": intensity,
            }
        case PointLight(position=position, attenuation=law, visible=None):
            found = {"kind": "point", "position": _numbers(position), "intensity": intensity}
            return found if law is None else found | {"attenuation": _law(law, folder, fitted)}
    raise BadInput(
        f"{folder}: a {type(light).__name__} is not written into a capture.toml, but parallel and point"
        " lights without shadows are"
    )


def _law(law: AbstractAttenuation, folder: Path, fitted: bool) -> dict[str, Any]:
    from diffshade.light.attenuation import Windowed

    if type(law) is Windowed:
        return {**_law(law.law, folder, fitted), "reach": _numbers(law.reach)}
    kinds = law_kinds()
    if type(law) not in kinds:
        raise BadInput(f"{folder}: {type(law).__name__} is not written into a capture.toml")
    constants = {} if fitted else {name: _numbers(x) for name, x in vars(law).items()}
    return {"kind": kinds[type(law)], **constants}


def _numbers(values: Any) -> Any:
    """Plain numbers, exactly."""
    return np.asarray(values, np.float64).tolist()


def _lines(table: dict[str, Any]) -> list[str]:
    return [f"{key} = {value_text(value)}" for key, value in table.items()]
