"""Malformed descriptions: captures, scenes, light positions, `sphere.json`, `fit.json`."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from capture_files import codes, disc, photometric_stereo, vectors, write_mask, write_png
from malformed.arrays import NORMAL, npy
from malformed.case import Case, Format, any_file, damaged, escapes, replaced

from diffshade.io.json_document import read_json
from diffshade.io.read_capture import read_capture
from diffshade.io.scene_toml import read_scene_toml
from fitting.report import material_from_json

HUGE = 100_000
DIRECTIONS = ((0.0, 0.1, 1.0), (0.2, 0.0, 1.0))

CAPTURE_TEXT = """schema = "diffshade.capture/1"
encoding = "linear"
mask = "mask.png"
ambient = [1.0, 0.9, 0.8]
geometry = { kind = "sphere", center = [0, 0, 0], radius = 1.0 }
camera = { kind = "orthographic", width = 16, height = 12, extent = 2.2 }
[[image]]
file = "a.png"
[[image.lights]]
kind = "point"
position = [1.5, 2.0, 3.0]
intensity = [0.9, 0.8, 0.7]
attenuation = { kind = "quadratic", c0 = 1.0, c1 = 0.0, c2 = 0.1 }
[[image]]
file = "b.png"
lights = [{ kind = "parallel", direction = [0.2, 0.0, 1.0], intensity = 1.0 }]
"""

LAMP = 'kind = "parallel", direction = [0, 0, 1], intensity = [1.0, 0.9, 0.8]'
SCENE_TEXT = f"""schema = "diffshade.scene/1"
ambient = 0.1
shading = "phong"
lights = [{{ {LAMP} }}]
geometry = {{ kind = "normals", file = "n.npy" }}
camera = {{ kind = "orthographic", width = 5, height = 4, extent = 2.2 }}
[material]
kd = [0.6, 0.3, 0.2]
[[material.specular]]
kind = "phong"
ks = 0.5
shininess = 32
"""

FIT: dict[str, Any] = {
    "schema": "diffshade.fit/1",
    "coefficients": {
        "ka": [0.1, 0.1, 0.1],
        "kd": [0.5, 0.4, 0.3],
        "lobes": [{"kind": "phong", "ks": [0.3, 0.3, 0.3], "shininess": 32.5}],
        "body": None,
        "attenuation": {"kind": "quadratic", "c0": 1.0, "c1": 0.25, "c2": 0.125},
    },
}


def _capture(folder: Path) -> None:
    for seed, name in enumerate(("a.png", "b.png")):
        write_png(folder / name, codes(seed))
    write_mask(folder / "mask.png", disc(8, 6, 5))
    (folder / "capture.toml").write_text(CAPTURE_TEXT)


def _scene(folder: Path) -> None:
    (folder / "n.npy").write_bytes(npy(NORMAL))
    (folder / "scene.toml").write_text(SCENE_TEXT)


def ps_folder(folder: Path) -> None:
    images = {"a.png": codes(0), "b.png": codes(1)}
    photometric_stereo(
        folder,
        images,
        light_directions_txt=vectors(DIRECTIONS),
        light_intensities_txt="0.9 0.8 0.7\n1.1 1.2 1.3\n",
        sphere_json='{"cx": 7.5, "cy": 5.5, "R": 4.5}\n',
    )
    write_mask(folder / "mask.png", disc(8, 6, 4))


def _lp(folder: Path) -> None:
    ps_folder(folder)
    (folder / "lights.lp").write_text("2\na.png 0.0 0.1 1.0\nb.png 0.2 0.0 1.0\n")


def _read_lp(path: Path) -> object:
    return read_capture(path, encoding="linear")


def _read_scene(path: Path) -> object:
    return read_scene_toml(path).gbuffer(path)


def _read_folder(path: Path) -> object:
    return read_capture(path.parent)


def _fit(folder: Path) -> None:
    (folder / "fit.json").write_text(json.dumps(FIT, indent=1))


def _read_fit(path: Path) -> object:
    return material_from_json(read_json(path, "a fit.json"))


CAPTURE = Format("capture", "capture.toml", _capture, read_capture, text=True)
SCENE = Format("scene", "scene.toml", _scene, _read_scene, text=True)
LP = Format("lp", "lights.lp", _lp, _read_lp, text=True)
NAMES = Format("filenames.txt", "filenames.txt", ps_folder, _read_folder, text=True)
LIGHTS = Format("light_directions.txt", "light_directions.txt", ps_folder, _read_folder, text=True)
POWERS = Format(
    "light_intensities.txt", "light_intensities.txt", ps_folder, _read_folder, text=True
)
SPHERE = Format("sphere.json", "sphere.json", ps_folder, _read_folder, text=True)
FITTED = Format("fit.json", "fit.json", _fit, _read_fit, text=True)
FORMATS = (CAPTURE, SCENE, LP, NAMES, LIGHTS, POWERS, SPHERE, FITTED)


def _naming(format: Format, old: str) -> Callable[[Path, str], None]:
    """Makes a file of this format name another file where it says `old`."""

    def name(path: Path, other: str) -> None:
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, other, 1))

    return name


def _numbers(format: Format, old: str, key: str) -> Iterator[Case]:
    """Numbers that are none where `old` stands."""
    for number in ("nan", "inf", "-inf"):
        yield replaced(format, "NaN", f"{key} {number}", old, old.split(" = ")[0] + f" = {number}")


def of_capture() -> Iterator[Case]:
    yield from any_file(CAPTURE, cuts=(0.02, 0.3, 0.6, 0.9))
    one = 'lights = [{ kind = "parallel", direction = [0.2, 0.0, 1.0], intensity = 1.0 }]'
    changes: dict[tuple[str, str], tuple[str, str]] = {
        ("wrong magic", "another schema"): ("capture/1", "capture/2"),
        ("wrong dtype", "a number as text"): ("radius = 1.0", 'radius = "1.0"'),
        ("wrong dtype", "true"): ("radius = 1.0", "radius = true"),
        ("wrong dtype", "a date"): ("radius = 1.0", "radius = 2020-01-01"),
        ("wrong dtype", "half a pixel"): ("width = 16", "width = 16.5"),
        ("wrong shape", "two coordinates"): ("position = [1.5, 2.0, 3.0]", "position = [1.5, 2.0]"),
        ("wrong shape", "a coordinate in a list"): ("center = [0, 0, 0]", "center = [0, 0, [0]]"),
        ("wrong shape", "two intensities"): (
            "intensity = [0.9, 0.8, 0.7]",
            "intensity = [0.9, 0.8]",
        ),
        ("wrong shape", "no intensity"): ("intensity = [0.9, 0.8, 0.7]", "intensity = []"),
        ("wrong shape", "another camera"): ("width = 16", "width = 17"),
        ("NaN", "a position"): ("[1.5, 2.0, 3.0]", "[1.5, nan, 3.0]"),
        ("NaN", "an ambient light"): ("ambient = [1.0,", "ambient = [inf,"),
        ("NaN", "an exponent of 5,000"): ("radius = 1.0", "radius = 1e5000"),
        ("NaN", "a whole number that is no float"): ("radius = 1.0", f"radius = {10**400}"),
        ("NaN", "a direction"): ("[0.2, 0.0, 1.0]", "[0.0, 0.0, 0.0]"),
        ("absurd header", "a camera of 100,000"): (
            "width = 16, height = 12",
            f"width = {HUGE}, height = {HUGE}",
        ),
        ("absurd header", "a camera of 10^30"): ("width = 16", f"width = {10**30}"),
        ("absurd header", "5,000 digits"): ("width = 16", f"width = {'9' * 5000}"),
        ("absurd header", "6,000 hexadecimal digits"): ("width = 16", f"width = 0x{'f' * 6000}"),
        ("absurd header", "hexadecimal digits in a list"): ("[0, 0, 0]", f"[0, 0x{'f' * 6000}]"),
        ("bomb", "nested lists"): ("ambient = [1.0, 0.9, 0.8]", f"ambient = {'[' * 10**5}"),
        ("bomb", "nested tables"): ("ambient = [1.0, 0.9, 0.8]", f"ambient = {'{a=' * 10**5}"),
        ("bomb", "a key of many parts"): ("ambient", f"a{'.a' * 20_000}"),
        ("missing key", "no schema"): ('schema = "diffshade.capture/1"\n', ""),
        ("missing key", "no geometry"): ("geometry = ", "# "),
        ("missing key", "no camera"): ("camera = ", "# "),
        ("missing key", "no file"): ('file = "a.png"\n', ""),
        ("missing key", "no lights"): (one, ""),
        ("missing key", "no encoding"): ('encoding = "linear"\n', ""),
        ("missing key", "an unknown one"): ("ambient", "ambience"),
        ("missing key", "a key twice"): ("ambient = ", 'mask = "mask.png"\nambient = '),
        ("missing key", "no kind"): ('kind = "sphere", ', ""),
        ("missing key", "the image is not there"): ('"a.png"', '"c.png"'),
        ("wrong type", "geometry in words"): (
            'geometry = { kind = "sphere", center = [0, 0, 0], radius = 1.0 }',
            'geometry = "sphere"',
        ),
        ("wrong type", "an unknown kind"): ('"sphere"', '"cube"'),
        ("wrong type", "a kind that is a list"): ('"sphere"', '["sphere"]'),
        ("wrong type", "a file that is a number"): ('"a.png"', "1"),
        ("wrong type", "a folder"): ('"a.png"', '"."'),
        ("wrong type", "a name with a zero byte"): ('"a.png"', '"a\\u0000.png"'),
        ("wrong type", "a name of two lines"): ('"a.png"', '"a\\nb\\u001b[31m.png"'),
        ("wrong type", "a name of 10,000 letters"): ('"a.png"', f'"{"a" * 10_000}.png"'),
        ("wrong type", "an image in words"): ("[[image]]", "[image]"),
        ("wrong type", "an encoding"): ('"linear"', '"sRGB"'),
        ("wrong type", "an encoding that is a list"): ('"linear"', "[2.2]"),
        ("wrong type", "a mask that is no image"): ('"mask.png"', '"capture.toml"'),
    }
    for (kind, name), (old, new) in changes.items():
        yield replaced(CAPTURE, kind, name, old, new)
    yield from _numbers(CAPTURE, "radius = 1.0", "radius")
    yield from _numbers(CAPTURE, "extent = 2.2", "extent")
    for file in ("a.png", "mask.png"):
        yield from escapes(CAPTURE, file, _naming(CAPTURE, file))


def of_scene() -> Iterator[Case]:
    yield from any_file(SCENE, cuts=(0.02, 0.3, 0.5, 0.8))
    changes: dict[tuple[str, str], tuple[str, str]] = {
        ("wrong magic", "another schema"): ("scene/1", "scene/9"),
        ("wrong dtype", "a coefficient as text"): ("ks = 0.5", 'ks = "0.5"'),
        ("wrong dtype", "a coefficient below 0"): ("ks = 0.5", "ks = -0.5"),
        ("wrong dtype", "false"): ("shininess = 32", "shininess = false"),
        ("wrong shape", "two directions"): ("[0, 0, 1]", "[0, 0]"),
        ("wrong shape", "two coefficients"): ("[0.6, 0.3, 0.2]", "[0.6, 0.3]"),
        ("wrong shape", "the camera's"): ("width = 5", "width = 6"),
        ("NaN", "ambient"): ("ambient = 0.1", "ambient = nan"),
        ("NaN", "an intensity"): ("[1.0, 0.9, 0.8]", "[1.0, inf, 0.8]"),
        ("absurd header", "a camera of 100,000"): (
            "width = 5, height = 4",
            f"width = {HUGE}, height = {HUGE}",
        ),
        ("absurd header", "a camera of 2^31"): ("width = 5", f"width = {2**31}"),
        ("bomb", "nested lists"): ("ambient = 0.1", f"ambient = {'[' * 10**5}"),
        ("bomb", "nested tables"): ("ambient = 0.1", f"ambient = {'{a=' * 10**5}"),
        ("missing key", "no geometry"): ("geometry", "surface"),
        ("missing key", "no shininess"): ("shininess = 32\n", ""),
        ("missing key", "no term"): (
            "[material]\nkd = [0.6, 0.3, 0.2]\n[[material.specular]]\n",
            "",
        ),
        ("missing key", "no file"): (', file = "n.npy"', ""),
        ("missing key", "the file is not there"): ('"n.npy"', '"m.npy"'),
        ("wrong type", "shading"): ('"phong"', '"toon"'),
        ("wrong type", "a light that is to be fitted"): (
            'kind = "parallel", direction = [0, 0, 1]',
            'kind = "point", attenuation = { kind = "quadratic" }, position = [0, 0, 9]',
        ),
        ("wrong type", "a point light without positions"): (
            'kind = "parallel", direction = [0, 0, 1]',
            'kind = "point", position = [0, 0, 9]',
        ),
        ("wrong type", "a file of another kind"): ('"n.npy"', '"scene.toml"'),
        ("wrong type", "an environment that is no image"): (
            LAMP,
            'kind = "environment", file = "scene.toml", order = 1',
        ),
        ("missing key", "an environment of no order"): (
            LAMP,
            'kind = "environment", file = "a.exr"',
        ),
        ("absurd header", "an environment of order 10^9"): (
            LAMP,
            f'kind = "environment", file = "a.exr", order = {10**9}',
        ),
        ("wrong shape", "eight harmonics"): (
            LAMP,
            f'kind = "environment", harmonics = {[1] * 8}',
        ),
        ("NaN", "a harmonic"): (LAMP, 'kind = "environment", harmonics = [nan]'),
    }
    for (kind, name), (old, new) in changes.items():
        yield replaced(SCENE, kind, name, old, new)
    yield from _numbers(SCENE, "ks = 0.5", "ks")
    yield from _numbers(SCENE, "shininess = 32", "shininess")
    yield from escapes(SCENE, "n.npy", _naming(SCENE, "n.npy"))


def of_lp() -> Iterator[Case]:
    yield from any_file(LP, cuts=(0.01, 0.2, 0.9))
    changes: dict[tuple[str, str], tuple[str, str]] = {
        ("absurd header", "a billion images"): ("2\n", "1000000000\n"),
        ("absurd header", "10^30 images"): ("2\n", f"{10**30}\n"),
        ("absurd header", "a count of 5,000 digits"): ("2\n", "9" * 5000 + "\n"),
        ("NaN", "nan"): ("0.2 0.0 1.0", "0.2 nan 1.0"),
        ("NaN", "inf"): ("0.2 0.0 1.0", "0.2 inf 1.0"),
        ("NaN", "no direction"): ("0.2 0.0 1.0", "0 0 0"),
        ("NaN", "1e999"): ("0.2 0.0 1.0", "1e999 0 0"),
        ("wrong shape", "two numbers"): ("b.png 0.2 0.0 1.0", "b.png 0.2 0.0"),
        ("wrong shape", "a name alone"): ("b.png 0.2 0.0 1.0", "b.png"),
        ("wrong type", "a number in words"): ("0.2 0.0 1.0", "0.2 zero 1.0"),
        ("wrong type", "a folder"): ("b.png", ".."),
        ("wrong type", "a name in quotes"): ("b.png", '""'),
        ("missing key", "an image that is not there"): ("b.png", "c.png"),
        ("missing key", "no images"): ("a.png 0.0 0.1 1.0\nb.png 0.2 0.0 1.0\n", ""),
    }
    for (kind, name), (old, new) in changes.items():
        yield replaced(LP, kind, name, old, new)
    for file in ("a.png", "mask.png", "sphere.json"):
        yield from escapes(LP, file, lambda path, other: None, links_only=True)


def of_light_texts() -> Iterator[Case]:
    yield from any_file(NAMES, cuts=(0.1, 0.4, 0.7))
    for kind, name, new in (
        ("missing key", "not there", "c.png"),
        ("wrong type", "a folder", "."),
        ("wrong type", "no image", "sphere.json"),
        ("wrong type", "a long name", "a" * 10_000),
        ("wrong shape", "three", "a.png\na.png"),
        ("wrong type", "a web address", "https://example.org/a.png"),
    ):
        yield replaced(NAMES, kind, name, "a.png", new)
    yield from escapes(NAMES, "a.png", _naming(NAMES, "a.png"))
    for file in ("filenames.txt", "mask.png", "light_directions.txt"):
        yield from escapes(NAMES, file, lambda path, other: None, links_only=True)
    for format, row, number in ((LIGHTS, "0.0 0.1 1.0", "0.1"), (POWERS, "0.9 0.8 0.7", "0.8")):
        yield from any_file(format, cuts=(0.2, 0.4, 0.8))
        for value in ("nan", "inf", "1e999"):
            yield replaced(format, "NaN", value, number, value)
        yield replaced(format, "wrong shape", "two numbers", row, "0.5 0.5")
        yield replaced(format, "wrong shape", "four numbers", row, f"{row} 1.0")
        yield replaced(format, "wrong shape", "a row more", row, f"{row}\n{row}")
        yield replaced(format, "missing key", "a row less", f"{row}\n", "")
        yield replaced(format, "wrong type", "a number in words", number, "one")
        yield replaced(format, "wrong type", "commas", row, row.replace(" ", ","))
        yield replaced(format, "absurd header", "a row of 10^5 numbers", row, "1 " * 10**5)
    yield replaced(LIGHTS, "NaN", "no direction", "0.0 0.1 1.0", "0 0 0")
    yield replaced(POWERS, "NaN", "no intensity", "0.9 0.8 0.7", "0 0 0")


def json_changes(format: Format) -> Iterator[Case]:
    """The damage that any JSON file can have."""
    yield damaged(format, "wrong type", "a list", lambda _: b"[1, 2]")
    yield damaged(format, "wrong type", "null", lambda _: b"null")
    yield damaged(format, "wrong type", "a text", lambda _: b'"cx"')
    yield damaged(format, "missing key", "nothing", lambda _: b"{}")
    yield damaged(format, "bomb", "nested lists", lambda _: b"[" * 10**6)
    yield damaged(format, "bomb", "nested objects", lambda _: b'{"a":' * 10**6)
    yield damaged(
        format, "absurd header", "5,000 digits", lambda _: b'{"cx": ' + b"9" * 5000 + b"}"
    )


def of_sphere() -> Iterator[Case]:
    yield from any_file(SPHERE)
    yield from json_changes(SPHERE)
    values = {
        "NaN": ("NaN", "Infinity", "-Infinity", "1e999", str(10**400)),
        "wrong type": ('"4.5"', "true", "null", "[4.5]", "{}"),
        "wrong dtype": ("0", "-4.5"),
    }
    for kind, numbers in values.items():
        for number in numbers:
            yield replaced(SPHERE, kind, f"R {number[:9]}", "4.5", number)
    for kind, numbers in list(values.items())[:2]:
        for number in numbers:
            yield replaced(SPHERE, kind, f"cx {number[:9]}", "7.5", number)
    yield replaced(SPHERE, "missing key", "no R", '"R"', '"r"')
    yield replaced(SPHERE, "missing key", "no cx", '"cx"', '"x"')
    yield replaced(SPHERE, "absurd header", "a radius of 1e-300", "4.5", "1e-300")
    yield replaced(SPHERE, "absurd header", "a centre at 1e300", "7.5", "1e300")
    yield from escapes(SPHERE, "sphere.json", lambda path, other: None, links_only=True)


def of_fit() -> Iterator[Case]:
    yield from any_file(FITTED)
    yield from json_changes(FITTED)
    changes: dict[tuple[str, str], tuple[str, str]] = {
        ("wrong magic", "another schema"): ("fit/1", "fit/2"),
        ("NaN", "a shininess"): ("32.5", "NaN"),
        ("NaN", "an infinite one"): ("32.5", "Infinity"),
        ("NaN", "a coefficient"): ("0.4", "-Infinity"),
        ("NaN", "a constant"): ("0.25", "NaN"),
        ("NaN", "a whole number that is no float"): ("32.5", str(10**400)),
        ("wrong dtype", "below 0"): ("0.4", "-0.4"),
        ("wrong dtype", "true"): ("32.5", "true"),
        ("wrong dtype", "text"): ("0.4", '"0.4"'),
        ("wrong shape", "a list of a list"): ("0.4", "[0.4]"),
        ("wrong shape", "an empty list"): ("32.5", "[]"),
        ("wrong type", "a lobe"): ('"kind": "phong"', '"kind": "mirror"'),
        ("wrong type", "a law"): ('"quadratic"', '"cubic"'),
        ("wrong type", "a body"): ('"body": null', '"body": {}'),
        ("wrong type", "a body of glass"): ('"body": null', '"body": {"kind": "glass"}'),
        ("wrong dtype", "a body without refraction"): (
            '"body": null',
            '"body": {"kind": "fresnel", "index": 0}',
        ),
        ("missing key", "no roughness"): ('"kind": "phong"', '"kind": "ggx"'),
        ("missing key", "no coefficients"): ('"coefficients"', '"numbers"'),
        ("missing key", "no schema"): ('"schema"', '"scheme"'),
        ("missing key", "no shininess"): ('"shininess"', '"n"'),
        ("missing key", "no c2"): ('"c2"', '"c9"'),
    }
    for (kind, name), (old, new) in changes.items():
        yield replaced(FITTED, kind, name, old, new)
    no_terms = {**FIT, "coefficients": {"ka": None, "kd": None, "lobes": []}}
    yield damaged(FITTED, "missing key", "no term", lambda _: json.dumps(no_terms).encode())
    lobes = {**FIT, "coefficients": {**FIT["coefficients"], "lobes": "none"}}
    yield damaged(FITTED, "wrong type", "lobes in words", lambda _: json.dumps(lobes).encode())


def cases() -> Iterator[Case]:
    for of in (of_capture, of_scene, of_lp, of_light_texts, of_sphere, of_fit):
        yield from of()
