"""The page as a text: complete in itself, of the parts that a scene has, and true to its numbers."""

import base64
import hashlib
import json
import re
import zlib
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from view_scenes import FIT, SCENES, make_page, write

import diffshade as ds
from diffshade.cli import run
from diffshade.errors import BadInput
from diffshade.io.scene_toml import read_scene_toml
from diffshade.web.page import page_text, write_page
from diffshade.web.shown import Shown

VOID = {"meta", "input", "link"}


class Page(HTMLParser):
    """Tags and texts of a page; fails where a tag is not closed in its turn."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []  # a tag, with its type where it has one
        self.attributes: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, str] = {}
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(" ".join(filter(None, (tag, dict(attrs).get("type")))))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop().split()[0] == tag

    def handle_data(self, text: str) -> None:
        if self.open:
            self.texts[self.open[-1]] = self.texts.get(self.open[-1], "") + text

    @property
    def data(self) -> dict[str, Any]:
        found = json.loads(self.texts["script application/json"])
        assert isinstance(found, dict)
        return found

    @property
    def functions(self) -> set[str]:
        return set(re.findall(r"^\w+ (\w+)\(", self.data["shader"], re.M))


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Page]:
    found = {}
    for name in (*SCENES, "fit"):
        page = make_page(tmp_path_factory.mktemp("page"), name)
        found[name] = Page(page.read_text(encoding="utf-8"))
    return found


def shown(**changes: Any) -> Shown:
    camera = ds.OrthographicCamera(20, 20, 2.4)
    light, material = ds.ParallelLight((0, 0, 1)), ds.Material(kd=0.5)
    one = Shown("t", ds.Sphere(), camera, None, ds.Scene(lights=light), material, {})
    return one._replace(**changes)


def page(**changes: Any) -> Page:
    return Page(page_text(shown(**changes)))


# Complete in itself


def test_it_loads_nothing(pages: dict[str, Page]) -> None:
    for made in pages.values():
        refers = {key for _, given in made.attributes for key in given}
        assert not refers & {"src", "href", "srcset", "action", "style", "onclick"}
        assert not {"link", "iframe", "object", "base", "img"} & {t for t, _ in made.attributes}
        for text in made.texts.values():
            assert not re.search(
                r"https?:|url\(|@import|\bimport\b|fetch\(|XMLHttp|WebSocket", text
            )


def test_its_policy_allows_its_own_script_and_style_and_no_more(pages: dict[str, Page]) -> None:
    for made in pages.values():
        (policy,) = (a["content"] for _, a in made.attributes if a.get("http-equiv"))
        hashes = [
            base64.b64encode(hashlib.sha256(made.texts[part].encode()).digest()).decode()
            for part in ("script module", "style")
        ]
        assert policy == (
            f"default-src 'none'; script-src 'sha256-{hashes[0]}'; style-src 'sha256-{hashes[1]}'"
        )


def test_names_end_no_element(tmp_path: Path) -> None:
    folder = tmp_path / "<b>&amp;<"
    folder.mkdir()
    mesh = tmp_path / "<b>&amp;<" / "script>"
    mesh.mkdir()
    source = write(tmp_path, "blinn mesh")
    (mesh / "$title.obj").write_text((tmp_path / "torus.obj").read_text())
    text = source.read_text().replace("torus.obj", "<b>&amp;</script>/$title.obj")
    (tmp_path / "<i>.toml").write_text(text)
    assert run(["view", str(tmp_path / "<i>.toml")]) == 0
    made = Page((tmp_path / "<i>.html").read_text(encoding="utf-8"))
    assert made.texts["h1"] == made.texts["title"] == "<i>.toml"
    assert '"<b>&amp;</script>/$title.obj"' in made.data["toml"]
    assert not {"b", "i"} & {tag for tag, _ in made.attributes}
    assert "</script" not in made.texts["script module"]


# What is there, and what is not


def test_a_lambert_ball_has_nothing_else(pages: dict[str, Page]) -> None:
    assert pages["grey"].functions == {
        *("lambert", "reflected", "radiance", "main"),
        *("ray", "towards_viewer", "shaded", "ratio", "root", "to_srgb", "display"),
    }
    assert [one["name"] for one in pages["grey"].data["parameters"]] == [
        *("kd", "lights.0.intensity", "lights.0.direction"),
    ]


def test_what_is_absent_is_in_no_line() -> None:
    lobe, light = ds.Phong(0.5, 20.0), ds.PointLight((0, 0, 5), 1.0)
    cases = {
        ("ambient", "ka", "phong", "direction"): shown(),
        ("od", "os", "kd"): shown(material=ds.Material(specular=lobe)),
        ("length", "quadratic", "window"): shown(scene=ds.Scene(lights=light)),
        ("kd", "lambert", "lights_0"): shown(
            scene=ds.Scene(ambient=0.5), material=ds.Material(ka=0.5, kd=0.5)
        ),
        ("ka", "ambient"): shown(material=ds.Material(ka=0.5, kd=0.5)),
        ("reflected", "kd", "lights_0"): shown(
            scene=ds.Scene(0.3, ds.ParallelLight((0, 0, 1))), material=ds.Material(ka=0.5)
        ),
        ("v", "dielectric"): shown(),
    }
    for absent, scene in cases.items():
        shader = re.sub(r"//.*", "", Page(page_text(scene)).data["shader"])
        for word in absent:
            assert not re.search(rf"\b{word}\b", shader.replace("vec3 ray", "")), word


def test_every_snippet_is_in_some_page(pages: dict[str, Page]) -> None:
    every = "\n".join(made.data["shader"] for made in pages.values())
    found = list(Path(str(files("diffshade.web") / "glsl")).rglob("*.glsl"))
    assert len(found) > 25
    for path in found:
        lines = path.read_text(encoding="utf-8").strip().splitlines()
        own = "\n".join(line for line in lines if not line.startswith("#include"))
        assert own in every, path.name


def test_every_coefficient_has_a_slider_that_reaches_it(pages: dict[str, Page]) -> None:
    for made in pages.values():
        uniforms = set(re.findall(r"^uniform (?:vec3|float) (\w+);", made.data["shader"], re.M))
        sliders = {one["uniform"] for one in made.data["parameters"]}
        assert sliders == uniforms - {"side", "radius"}
        for one in made.data["parameters"]:
            low, high = one["range"]
            assert all(low <= value <= high for value in one["values"]), one["name"]
            assert low > 0 or not one["log"]
    bright = ds.Scene(lights=ds.PointLight((900, 0, 5), 1e3))
    lobe = ds.Phong(2.5, 0.25)
    for one in page(scene=bright, material=ds.Material(specular=lobe)).data["parameters"]:
        assert all(one["range"][0] <= x <= one["range"][1] for x in one["values"]), one["name"]


# True to the numbers


def filled(made: Page) -> str:
    """The scene.toml of a page, as its script fills it in."""
    values = {one["name"]: one for one in made.data["parameters"]}

    def number(match: re.Match[str]) -> str:
        one = values[match[1]]
        listed = one["kind"] in ("position", "direction") or len(one["values"]) > 1
        return str(one["values"] if listed else one["values"][0])

    return re.sub(r"\$\{([\w.]+)\}", number, made.data["toml"])


@pytest.mark.parametrize("name", SCENES)
def test_the_text_is_the_scene(name: str, pages: dict[str, Page], tmp_path: Path) -> None:
    path = write(tmp_path, name)
    again = tmp_path / "again.toml"
    again.write_text(filled(pages[name]))
    found, expected = read_scene_toml(again), read_scene_toml(path)
    assert jax.tree.structure(found) == jax.tree.structure(expected)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_fit_is_shown_at_its_reference_distance(pages: dict[str, Page], tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(filled(pages["fit"]))
    scene = read_scene_toml(path).scene
    (light,) = scene.lights
    assert isinstance(light, ds.PointLight)
    np.testing.assert_allclose(np.linalg.norm(light.position), 3.5, atol=1e-3)
    assert isinstance(light.attenuation, ds.QuadraticAttenuation)
    assert float(light.attenuation.c0) == pytest.approx(0.9)
    values = {one["name"]: one["values"] for one in pages["fit"].data["parameters"]}
    assert values["kd"] == FIT["coefficients"]["kd"]
    assert values["specular.0.fresnel.index"] == values["body.index"] == [1.45]


def test_the_pixels_and_faces_are_those_of_the_library(tmp_path: Path) -> None:
    path = write(tmp_path, "blinn mesh")
    file = read_scene_toml(path)
    assert isinstance(file.geometry, ds.Mesh)
    assert file.camera is not None
    made = page(geometry=file.geometry, camera=file.camera)
    textures = {}
    for one in made.data["surface"]["textures"]:
        kind = "<f4" if one["format"].endswith("F") else "<i4"
        flat = np.frombuffer(zlib.decompress(base64.b64decode(one["data"])), kind)
        textures[one["name"]] = flat.reshape(one["height"], one["width"], -1)
    seen = ds.visibility(file.geometry, file.camera)
    number = textures["seen"].reshape(-1)
    assert (np.flatnonzero(number >= 0) == np.asarray(seen.index)).all()
    faces = textures["faces"].reshape(-1, 3)[number[number >= 0]]
    corners = textures["vertices"].reshape(-1, 3)[faces] + made.data["surface"]["origin"]
    face, _ = seen.on_mesh()
    expected = np.asarray(file.geometry.vertices)[np.asarray(file.geometry.faces)[np.asarray(face)]]
    np.testing.assert_allclose(corners, expected, atol=1e-6)
    assert textures["faces"].reshape(-1, 3).any(axis=1).sum() < len(file.geometry.faces)


# What is refused


def refused(match: str, **changes: Any) -> None:
    with pytest.raises(BadInput, match=match):
        page_text(shown(**changes))


def test_what_no_slider_moves_is_refused() -> None:
    lit = ds.Scene(lights=ds.SphereLight((0, 0, 3), 0.5))
    refused("light 1 of the scene has extent", scene=lit)
    refused("no faces to shade", shading=ds.FlatShading())
    slots = ds.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], slot=[0])
    refused("Gouraud shading", geometry=slots, shading=ds.GouraudShading())
    refused("2 channels", material=ds.Material(kd=(0.1, 0.2)))
    refused("is a map", material=ds.Material(kd=np.ones((1, 5))))
    shaded = ds.PointLight((0, 0, 9), 1.0, visible=np.ones(316))
    refused("a PointLight has visible", scene=ds.Scene(lights=shaded))
    many = [ds.PointLight((k, 0, 9), 1.0, ds.QuadraticAttenuation(1.0)) for k in range(50)]
    refused("WebGL room for 200", scene=ds.Scene(lights=many))
    constants = ds.QuadraticAttenuation(1.0, (0.1, 0.2, 0.3))
    refused("c1 has 3 numbers", scene=ds.Scene(lights=ds.PointLight((0, 0, 5), 1.0, constants)))

    class Other(ds.Schlick):
        pass

    lobe = ds.GGX(1.0, 0.2, Other(0.04))
    refused("knows no boundary Other", material=ds.Material(specular=lobe))


SLOTS = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nusemtl a\nf 1 2 3\nusemtl b\nf 2 4 3\n"
BAD: dict[str, tuple[str, dict[str, str], str]] = {
    "no file": ("absent.toml", {}, "there is no such file"),
    "no fit": ("fit.json", {"fit.json": '{"schema": "other/1"}'}, "schema"),
    "no JSON": ("fit.json", {"fit.json": "{"}, "is not JSON"),
    "no light": (
        "scene.toml",
        {"scene.toml": SCENES["grey"].replace("[[lights]]", "[[lamps]]")},
        "lamps",
    ),
    "a lamp": (
        "scene.toml",
        {
            "scene.toml": SCENES["grey"]
            .replace('"parallel"', '"sphere"')
            .replace(
                "direction = [0, 1, 0.5]\nintensity", "center = [0, 0, 9]\nradius = 1\nradiance"
            )
        },
        "light 1 of the scene has extent",
    ),
    "shadows": (
        "scene.toml",
        {"scene.toml": f"shadows = true\n{SCENES['grey']}"},
        "the scene has shadows",
    ),
    "transparency": (
        "scene.toml",
        {
            "scene.toml": SCENES["grey"].replace(
                "[material]\n", '[material]\ntransparency = { kind = "interpolated", kt = 0.5 }\n'
            )
        },
        "the material has transparency",
    ),
    "two materials": (
        "scene.toml",
        {
            "scene.toml": SCENES["blinn mesh"].split("[material]")[0].replace("torus", "two"),
            "two.obj": SLOTS,
            "a.mtl": "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n",
        },
        "the mesh has 2 materials",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, texts, complaint = BAD[name]
    for file, text in texts.items():
        (tmp_path / file).write_text(text)
    assert run(["view", str(tmp_path / source)]) == 3
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.count("\n") == 1
    assert told.err.startswith(f"diffshade: {tmp_path}")
    assert complaint in told.err
    assert not list(tmp_path.glob("*.html"))


def test_where_it_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = write(tmp_path, "grey")
    out = tmp_path / "other.html"
    assert run(["view", str(source), "--out", str(out)]) == 0
    assert capsys.readouterr() == (f"{out}\n", "")
    assert out.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    for wrong, complaint in (("page.png", "ends in .html"), ("new/page.html", "does not exist")):
        assert run(["view", str(source), "--out", str(tmp_path / wrong)]) == 3
        assert complaint in capsys.readouterr().err
    with pytest.raises(BadInput, match=r"ends in \.html"):
        write_page(tmp_path / "page", shown())
    assert {p.name for p in tmp_path.iterdir()} == {"scene.toml", "torus.obj", "other.html"}
