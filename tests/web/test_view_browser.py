"""The page in headless Chromium: its picture beside the library's own, and what moves it.

Needs Playwright (the extra `browser`) and a Chromium: the system's, or Playwright's own. WebGL runs in
software (SwiftShader), so that no graphics card is asked for. All pixels are compared, also those of the
outline.
"""

import base64
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import imagecodecs
import numpy as np
import pytest
from view_scenes import SCENES, make_page

from diffshade.cli import run
from diffshade.io.scene_toml import read_scene_toml

NO_BROWSER = "Playwright is not installed: the extra `browser`"
SOFTWARE = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
READ_BACK = "() => document.getElementById('picture').toDataURL('image/png')"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    api = pytest.importorskip("playwright.sync_api", reason=NO_BROWSER)
    with api.sync_playwright() as playwright:
        own = playwright.chromium.executable_path
        named = map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))
        found = own if Path(own).exists() else next(filter(None, named), None)
        if found is None:
            pytest.skip("there is no Chromium: install one, or run `playwright install chromium`")
        # A container's root has no sandbox to go into.
        options = {"executable_path": found, "args": SOFTWARE, "chromium_sandbox": False}
        chromium = playwright.chromium.launch(**options)
        yield chromium
        chromium.close()


class Viewed(NamedTuple):
    """A page in the browser, and the folder that it lies in."""

    tab: Any
    folder: Path

    def do(self, script: str) -> Any:
        """What a script of the page gives; what it throws is raised."""
        return self.tab.evaluate(script)

    def picture(self) -> np.ndarray:
        """The canvas, [H, W, 3] in 8 bits."""
        text = self.do(READ_BACK).split(",")[1]
        return imagecodecs.png_decode(base64.b64decode(text))[..., :3].astype(int)

    def differences(self) -> np.ndarray:
        """By how many levels each pixel is off the library's own picture of what the page now says."""
        scene, image = self.folder / "now.toml", self.folder / "now.png"
        scene.write_text(self.do("diffshade.toml()"))
        assert run(["render", str(scene), "--out", str(image)]) == 0
        expected = imagecodecs.png_decode(image.read_bytes()).astype(int)
        expected = expected[..., None] if expected.ndim == 2 else expected
        assert expected.max() > 60
        return np.abs(self.picture() - expected).max(axis=-1)

    def matches(self) -> None:
        """At most one level in any pixel, and none in nearly all."""
        off = self.differences()
        assert off.max() <= 1
        assert np.mean(off > 0) < 2e-3


@pytest.fixture
def view(browser: Any, tmp_path: Path) -> Iterator[Any]:
    """A function that shows the page of a scene; whatever goes wrong in the page fails the test."""
    wrong: list[str] = []
    context = browser.new_context(viewport={"width": 1200, "height": 900})

    def show(name: str, hash: str = "", before: str | None = None) -> Viewed:
        page = make_page(tmp_path, name)
        tab = context.new_page()
        tab.on("console", lambda message: wrong.append(message.text))
        tab.on("pageerror", lambda error: wrong.append(str(error)))
        tab.on("request", lambda r: r.url.startswith(page.as_uri()) or wrong.append(r.url))
        if before is not None:
            tab.add_init_script(before)
        tab.goto(f"{page.as_uri()}{hash}")
        tab.wait_for_function("window.diffshade || !document.getElementById('trouble').hidden")
        return Viewed(tab, tmp_path)

    yield show
    context.close()
    assert wrong == []


@pytest.mark.parametrize("name", [*SCENES, "fit"])
def test_the_picture_is_that_of_the_library(view: Any, name: str) -> None:
    view(name).matches()


def test_so_it_is_after_values_were_set(view: Any) -> None:
    shown = view("everything")
    before = shown.picture()
    shown.do(
        """diffshade.set({
        kd: [0.1, 0.3, 0.5], od: 1, "body.index": 1.8, "specular.0.alpha": [0.05, 0.1, 0.2],
        "specular.1.ks": 0.8, "specular.2.alpha": 0.6, "specular.3.fresnel.index": [1, 2, 0.5],
        "specular.4.shininess": 12, "lights.0.position": [-1, 2, 3], "lights.0.cutoff": 0.5,
        "lights.0.direction": [1, -2, -2.6], "lights.1.direction": [-1, 1, 0.5], "lights.2.intensity": 0.2
        })"""
    )
    assert np.abs(shown.picture() - before).max() > 40
    assert shown.do("diffshade.get('specular.4.shininess')") == [12]
    file = read_scene_toml_of(shown)
    np.testing.assert_allclose(file.material.kd, (0.1, 0.3, 0.5), rtol=1e-6)
    np.testing.assert_allclose(file.scene.lights[0].position, (-1, 2, 3))
    shown.matches()
    shown.do("diffshade.reset()")
    assert (shown.picture() == before).all()


def read_scene_toml_of(shown: Viewed) -> Any:
    path = shown.folder / "said.toml"
    path.write_text(shown.do("diffshade.toml()"))
    return read_scene_toml(path)


def test_what_cannot_be_set_changes_nothing(view: Any) -> None:
    shown = view("phong ball")
    before = shown.do("diffshade.toml()")
    for changes, complaint in {
        "{kd: 0.5, nothing: 1}": "nothing: there is no such value; there are ka, kd",
        "{kd: -0.5}": "kd: -0.5 is below 0",
        "{kd: [1, 2]}": "kd: 2 numbers are given; give 1 or 3",
        "{kd: 'red'}": "kd: red is no number",
        "{kd: NaN}": "kd: NaN is no number",
        "{'lights.0.position': 1}": "lights.0.position: 1 numbers are given; give 3",
    }.items():
        found = shown.do(f"try {{ diffshade.set({changes}) }} catch (error) {{ error.message }}")
        assert found.startswith(complaint)
    assert shown.do("diffshade.toml()") == before


def test_sliders_and_numbers_move_the_picture(view: Any) -> None:
    shown = view("phong ball")
    slider = shown.tab.get_by_label("Lobe, Phong: shininess", exact=True)
    slider.focus()
    shown.tab.keyboard.press("Home")
    assert shown.do("diffshade.get('specular.0.shininess')") == [1]
    for _ in range(3):
        shown.tab.keyboard.press("PageUp")
    # Logarithmic: three tenths of the way from 1 to 10,000.
    assert shown.do("diffshade.get('specular.0.shininess')")[0] == pytest.approx(15.8)
    number = shown.tab.get_by_label("Material: kd, diffuse, G, as a number")
    number.fill("0.75")
    number.press("Tab")
    assert shown.do("diffshade.get('kd')") == [0.6, 0.75, 0.2]
    shown.matches()
    number.fill("-1")
    number.press("Tab")
    assert shown.tab.locator("#status").inner_text() == "kd: -1 is below 0"
    assert number.input_value() == "0.75"
    # One number for all channels, and one each again.
    shown.tab.locator(".row", has_text="kd, diffuse").get_by_role("button").click()
    assert shown.do("diffshade.get('kd')") == [pytest.approx(0.5167)]
    shown.tab.locator(".row", has_text="ks, specular").get_by_role("button").click()
    assert shown.do("diffshade.get('specular.0.ks')") == [0.5, 0.5, 0.5]
    shown.matches()
    shown.tab.get_by_role("button", name="Reset").click()
    assert shown.do("diffshade.get('kd')") == [0.6, 0.3, 0.2]


def test_values_in_the_address(view: Any) -> None:
    shown = view("phong ball", "#kd=0.1,0.5,0.2&specular.0.shininess=2.5e%2B2")
    assert shown.do("[diffshade.get('kd'), diffshade.get('specular.0.shininess')]") == [
        [0.1, 0.5, 0.2],
        [250],
    ]
    shown.matches()
    shown.do("navigator.clipboard.writeText = (text) => { window.copied = text; }")
    shown.tab.get_by_role("button", name="Copy link").click()
    assert shown.do("copied").endswith("#kd=0.1,0.5,0.2&specular.0.shininess=250")
    shown.do("location.hash = '#kd=1'")
    shown.tab.wait_for_function("diffshade.get('kd').length === 1")
    assert shown.do("diffshade.get('specular.0.shininess')") == [60]
    shown.tab.get_by_role("button", name="Copy as TOML").click()
    assert shown.do("copied") == shown.do("diffshade.toml()")
    assert "kd = 1\n" in shown.do("copied")
    shown.do("location.hash = '#kd=red'")
    shown.tab.wait_for_function("document.getElementById('status').textContent !== ''")
    assert shown.tab.locator("#status").inner_text() == "kd: NaN is no number"


def drag(shown: Viewed, *places: tuple[float, float]) -> None:
    """Press the mouse at the first place and release it at the last, in pixels of the picture."""
    box = shown.tab.locator("#picture").bounding_box()
    height, width = shown.picture().shape[:2]
    mouse = shown.tab.mouse
    for number, (x, y) in enumerate(places):
        mouse.move(
            box["x"] + x / width * box["width"], box["y"] + y / height * box["height"], steps=3
        )
        if number == 0:
            mouse.down()
    mouse.up()


def brightest(shown: Viewed) -> np.ndarray:
    """The middle, x and y, of the brightest pixels."""
    level = shown.picture().sum(axis=-1)
    rows, columns = np.nonzero(level >= 0.98 * level.max())
    return np.array([columns.mean() + 0.5, rows.mean() + 0.5])


def test_the_highlight_follows_the_mouse(view: Any) -> None:
    shown = view("phong ball")
    shown.do("diffshade.set({kd: 0, ka: 0, 'specular.0.shininess': 400, 'lights.1.intensity': 0})")
    distance = np.linalg.norm(shown.do("diffshade.get('lights.0.position')") - CENTRE)
    for place in ((60.0, 50.0), (100.0, 80.0), (75.0, 100.0)):
        drag(shown, (70, 70), place)
        assert np.abs(brightest(shown) - place).max() < 1.5
        moved = shown.do("diffshade.get('lights.0.position')")
        assert np.linalg.norm(moved - CENTRE) == pytest.approx(distance, rel=1e-3)
    assert shown.differences().max() <= 1
    # The other light, once it is chosen; the mouse alone moves nothing.
    shown.tab.get_by_label("Light 2, point", exact=True).check()
    first = shown.do("diffshade.get('lights.0.position')")
    drag(shown, (90, 60))
    assert shown.do("diffshade.get('lights.0.position')") == first
    assert shown.do("diffshade.get('lights.1.position')") != [-3, 0.5, 21]
    second = shown.do("diffshade.get('lights.1.position')")
    shown.tab.mouse.move(300, 300)
    assert shown.do("diffshade.get('lights.1.position')") == second


CENTRE = np.array([0.1, 0.05, 20])


def test_a_parallel_light_is_dragged_behind_the_ball_and_a_spot_goes_on_shining_at_it(
    view: Any,
) -> None:
    shown = view("everything")
    shown.tab.get_by_label("Light 2, parallel", exact=True).check()
    drag(shown, (60, 50), (119, 50))  # beside the ball
    towards = np.array(shown.do("diffshade.get('lights.1.direction')"))
    eye = np.array([0.5, 1, 4]) / np.linalg.norm([0.5, 1, 4])
    assert np.linalg.norm(towards) == pytest.approx(1, abs=1e-4)
    assert towards @ eye < -0.8
    shown.tab.get_by_label("Light 1, spot", exact=True).check()
    before = [np.array(shown.do(f"diffshade.get('lights.0.{x}')")) for x in LIGHT]
    drag(shown, (40, 40))
    after = [np.array(shown.do(f"diffshade.get('lights.0.{x}')")) for x in LIGHT]
    assert np.linalg.norm(after[0] - before[0]) > 0.3
    cosines = [p @ d / np.linalg.norm(p) / np.linalg.norm(d) for p, d in (before, after)]
    assert cosines[1] == pytest.approx(cosines[0], abs=1e-3)
    shown.matches()


LIGHT = ("position", "direction")


def test_keys_turn_the_light(view: Any) -> None:
    shown = view("phong ball")
    shown.do("diffshade.set({'lights.0.position': [0.1, 0.05, 25]})")
    shown.tab.locator("#picture").focus()
    for key, expected in {
        "ArrowRight": (5 * np.sin(np.pi / 60), 0, 5 * np.cos(np.pi / 60)),
        "ArrowLeft": (0, 0, 5),
        "ArrowUp": (0, 5 * np.sin(np.pi / 60), 5 * np.cos(np.pi / 60)),
        "ArrowDown": (0, 0, 5),
        "+": (0, 0, 5.5),
        "-": (0, 0, 5),
    }.items():
        shown.tab.keyboard.press(key)
        place = np.array(shown.do("diffshade.get('lights.0.position')")) - CENTRE
        np.testing.assert_allclose(place, expected, atol=2e-3, err_msg=key)


def test_it_is_seen_on_the_screen_as_it_is_in_the_canvas(view: Any) -> None:
    shown = view("fit")  # as wide as on the screen
    seen = imagecodecs.png_decode(shown.tab.locator("#picture").screenshot())[..., :3].astype(int)
    assert (seen == shown.picture()).all()


@pytest.mark.parametrize("width", [320, 390, 1200])
def test_nothing_lies_beside_a_narrow_screen(view: Any, width: int) -> None:
    shown = view("everything")
    shown.tab.set_viewport_size({"width": width, "height": 700})
    assert shown.do("document.documentElement.scrollWidth") <= width
    box = shown.tab.locator("#picture").bounding_box()
    assert box["width"] / box["height"] == pytest.approx(120 / 102, rel=0.02)


@pytest.mark.parametrize("width", [320, 1200])
def test_numbers_are_seen_whole(view: Any, width: int) -> None:
    shown = view("phong ball")
    shown.tab.set_viewport_size({"width": width, "height": 700})
    shown.do(
        """diffshade.set({
        kd: [0.123456, 0.000123456, 0.00000123456], "specular.0.shininess": 12345.6,
        "lights.0.position": [-12.5, -0.00000123456, -1234.56]
        })"""
    )
    hidden = shown.do(
        """[...document.querySelectorAll("input[type=number]")]
        .filter((field) => field.scrollWidth > field.clientWidth + 1).map((field) => field.value)"""
    )
    assert hidden == []


def test_a_browser_without_webgl_2_is_told(view: Any) -> None:
    shown = view("grey", before="HTMLCanvasElement.prototype.getContext = () => null;")
    trouble = shown.tab.locator("#trouble")
    assert trouble.is_visible()
    assert "has no WebGL 2" in trouble.inner_text()
