"""Malformed descriptions of lights by other tools: Relight's domes, AliceVision's spheres and lights."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from malformed.case import Case, Format, any_file, damaged, escapes, replaced
from malformed.texts import json_changes, ps_folder

from diffshade.io.alicevision import read_lights, read_spheres
from diffshade.io.read_capture import read_capture
from diffshade.io.shl import read_shl

DOME_TEXT = json.dumps(
    {
        "label": "",
        "imageWidth": 80,
        "domeDiameter": 600,
        "verticalOffset": 10,
        "lightConfiguration": "lights3d",
        "directions": [{"x": 0, "y": 0.6, "z": 0.8}, {"x": 0.25, "y": 0, "z": 1}],
        "positionsSphere": [],
        "positions3d": [{"x": 0, "y": 180, "z": 240}, {"x": -100, "y": 0, "z": 270}],
        "ledAdjust": [{"r": 1.5, "g": 1, "b": 1}, {"r": 1, "g": 1, "b": 1}],
    },
    indent=1,
)
SPHERES_TEXT = '{"1234": [{"x": "-1.5", "y": "2.5", "r": "3.5", "score": "0.9", "type": "matte"}]}'
LIGHTS_TEXT = json.dumps(
    {
        "lights": [
            {
                "viewId": "1234",
                "type": "directional",
                "direction": ["0.6", "0", "-0.8"],
                "intensity": ["1.25", "1", "1"],
            }
        ]
    }
)


def _dome(folder: Path) -> None:
    ps_folder(folder)
    (folder / "lights.dome").write_text(DOME_TEXT)


def _text(name: str, text: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text(text)


DOME = Format(
    "dome",
    "lights.dome",
    _dome,
    lambda path: read_capture(path, encoding="linear"),
    text=True,
)
SPHERES = Format(
    "AliceVision spheres",
    "spheres.json",
    _text("spheres.json", SPHERES_TEXT),
    lambda path: read_spheres(path, (12, 16)),
    text=True,
)
LIGHTS = Format(
    "AliceVision lights", "lights.json", _text("lights.json", LIGHTS_TEXT), read_lights, text=True
)
SHL_TEXT = "".join(f" {0.1 * k:g} -0.25 0.5\n" for k in range(9))
SHL = Format("AliceVision .shl", "global.shl", _text("global.shl", SHL_TEXT), read_shl, text=True)
SFM_TEXT = json.dumps(
    {
        "version": ["1", "2", "8"],
        "views": [
            {
                "viewId": "1234",
                "poseId": "9",
                "path": "/shots/a.png",
                "metadata": {"Make": "Canon"},
            },
            {"viewId": "77", "poseId": "9", "path": "/shots/b.png", "metadata": ""},
        ],
    }
)


def _scene(folder: Path) -> None:
    ps_folder(folder)
    (folder / "lights.json").write_text(LIGHTS_TEXT)
    (folder / "cameraInit.sfm").write_text(SFM_TEXT)


SFM = Format(
    "AliceVision scene",
    "cameraInit.sfm",
    _scene,
    lambda path: read_capture(path.parent / "lights.json", encoding="linear"),
    text=True,
)
FORMATS = (DOME, SPHERES, LIGHTS, SHL, SFM)


def of_dome() -> Iterator[Case]:
    yield from any_file(DOME)
    yield from json_changes(DOME)
    changes: dict[tuple[str, str], tuple[str, str]] = {
        ("wrong dtype", "a number as text"): ('"y": 180', '"y": "180"'),
        ("wrong dtype", "true"): ('"y": 180', '"y": true'),
        ("wrong dtype", "a width below 0"): ('"imageWidth": 80', '"imageWidth": -80'),
        ("wrong dtype", "a lamp below 0"): ('"r": 1.5', '"r": -1.5'),
        ("wrong dtype", "a lamp of 10^9"): ('"r": 1.5', '"r": 1e9'),
        ("wrong shape", "a light in a list"): ('"positions3d": [', '"positions3d": [[1, 2, 3],'),
        ("wrong shape", "a light more"): (
            '"positions3d": [',
            '"positions3d": [{"x":1,"y":1,"z":9},',
        ),
        ("wrong shape", "a lamp more"): ('"ledAdjust": [', '"ledAdjust": [{"r":1,"g":1,"b":1},'),
        ("NaN", "nan"): ('"y": 180', '"y": NaN'),
        ("NaN", "inf"): ('"y": 180', '"y": Infinity'),
        ("NaN", "1e999"): ('"y": 180', '"y": 1e999'),
        ("NaN", "a lamp"): ('"r": 1.5', '"r": NaN'),
        ("NaN", "a whole number that is no float"): ('"y": 180', f'"y": {10**400}'),
        ("absurd header", "a light at 10^300"): ('"y": 180', '"y": 1e300'),
        ("absurd header", "a light in the image"): ('"y": 180, "z": 240', '"y": 0, "z": 0'),
        ("absurd header", "a width of 10^-300"): ('"imageWidth": 80', '"imageWidth": 1e-300'),
        ("missing key", "no z"): ('"z": 270', '"w": 270'),
        ("missing key", "no positions"): ('"positions3d"', '"positions"'),
        ("missing key", "no colour"): ('"b": 1', '"c": 1'),
        ("wrong type", "lights in words"): ('"positions3d": [', '"positions3d": "none", "more": ['),
        ("wrong type", "another configuration"): ('"lights3d"', '"planar"'),
        ("wrong type", "a configuration that is a list"): ('"lights3d"', '["lights3d"]'),
    }
    compact = {key: (_spread(old), new) for key, (old, new) in changes.items()}
    for (kind, name), (old, new) in compact.items():
        yield replaced(DOME, kind, name, old, new)
    for file in ("a.png", "mask.png", "sphere.json"):
        yield from escapes(DOME, file, lambda path, other: None, links_only=True)


def _spread(text: str) -> str:
    """As `json.dumps` with an indentation writes it."""
    return text.replace(', "', ',\n   "')


def of_alicevision() -> Iterator[Case]:
    for format, number in ((SPHERES, '"3.5"'), (LIGHTS, '"1.25"')):
        yield from any_file(format)
        yield from json_changes(format)
        for kind, values in {
            "NaN": ('"nan"', '"inf"', "NaN", "1e999", '"1e999"', str(10**400)),
            "wrong type": ('"one"', "null", "true", "[1]", "{}", '""'),
            "wrong dtype": ('"-1"', "0"),
            "absurd header": ('"1e300"',),
        }.items():
            for value in values:
                yield replaced(format, kind, f"{number} {value[:9]}", number, value)
    changes: dict[tuple[str, str], tuple[str, str]] = {
        ("missing key", "no r"): ('"r"', '"radius"'),
        ("missing key", "no sphere"): ('[{"x"', '[], "5": {"x"'),
        ("wrong type", "a sphere in words"): ('[{"x"', '"none", "5": [{"x"'),
        ("wrong shape", "a sphere in a list"): ('[{"x"', '[[1], {"x"'),
    }
    for (kind, name), (old, new) in changes.items():
        yield replaced(SPHERES, kind, name, old, new)
    changes = {
        ("missing key", "no lights"): ('"lights"', '"lamps"'),
        ("missing key", "no view"): ('"viewId"', '"id"'),
        ("missing key", "no direction"): ('"direction"', '"towards"'),
        ("missing key", "no intensity"): ('"intensity"', '"power"'),
        ("missing key", "no type"): ('"type"', '"kind"'),
        ("wrong type", "a light of another type"): ('"directional"', '"spot"'),
        ("wrong type", "a view that is a list"): ('"1234"', "[1234]"),
        ("wrong shape", "two numbers"): ('"0.6", ', ""),
        ("wrong shape", "harmonics of three"): ('"directional"', '"SH"'),
        ("NaN", "no direction"): ('["0.6", "0", "-0.8"]', '["0", "0", "0"]'),
    }
    for (kind, name), (old, new) in changes.items():
        yield replaced(LIGHTS, kind, name, old, new)
    document: dict[str, Any] = json.loads(LIGHTS_TEXT)
    twice = {"lights": document["lights"] * 2}
    yield damaged(LIGHTS, "wrong shape", "a view twice", lambda _: json.dumps(twice).encode())


def of_shl() -> Iterator[Case]:
    yield from any_file(SHL)
    for value in ("nan", "inf", "1e999"):
        yield replaced(SHL, "NaN", value, "-0.25", value)
    yield replaced(SHL, "wrong dtype", "a word", "-0.25", "red")
    yield replaced(SHL, "wrong shape", "a number more", "-0.25", "-0.25 1")
    yield replaced(SHL, "absurd header", "10^300", "-0.25", "1e300")
    yield damaged(SHL, "wrong shape", "a row more", lambda c: c + b"1 2 3\n")


def of_scene() -> Iterator[Case]:
    yield from any_file(SFM)
    yield from json_changes(SFM)
    changes: dict[tuple[str, str], tuple[str, str]] = {
        ("missing key", "no views"): ('"views"', '"shots"'),
        ("missing key", "no view"): ('"viewId"', '"id"'),
        ("missing key", "no path"): ('"path"', '"file"'),
        ("wrong type", "a path that is a list"): ('"/shots/a.png"', '["/shots/a.png"]'),
        ("wrong type", "metadata in a list"): ('{"Make": "Canon"}', '["Canon"]'),
        ("wrong shape", "a view twice"): ('"77"', '"1234"'),
        ("wrong shape", "a view in a list"): ('[{"viewId"', '[[1], {"viewId"'),
        ("missing key", "no name at all"): ('"/shots/a.png"', '"/"'),
    }
    for (kind, name), (old, new) in changes.items():
        yield replaced(SFM, kind, name, old, new)
    for file in ("cameraInit.sfm", "a.png", "mask.png", "sphere.json"):
        yield from escapes(SFM, file, lambda path, other: None, links_only=True)


def cases() -> Iterator[Case]:
    yield from of_dome()
    yield from of_alicevision()
    yield from of_shl()
    yield from of_scene()
