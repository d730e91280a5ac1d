"""`capture.toml`."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import reference
from capture_files import HEIGHT, SRGB, WIDTH, codes, disc, refusal, write_mask, write_png

import diffshade
from diffshade.io.read_capture import read_capture
from diffshade.light.attenuation import (
    ExponentialAttenuation,
    LinearAttenuation,
    QuadraticAttenuation,
)
from diffshade.light.parallel import ParallelLight
from diffshade.light.point import PointLight

TOP = """
schema   = "diffshade.capture/1"
encoding = "linear"
ambient  = [0.5, 0.6, 0.7]
geometry = { kind = "sphere", center = [0.1, 0.0, 0.0], radius = 1.0 }
camera   = { kind = "orthographic", width = 16, height = 12, extent = 3.2 }
"""
POINT = 'kind = "point", position = [1, 2, 3.5], intensity = [0.9, 0.8, 0.7]'
IMAGES = f"""
[[image]]
file   = "a.png"
lights = [{{ {POINT}, attenuation = {{ kind = "quadratic", c0 = 1, c1 = 0.0, c2 = 0.1 }} }}]
[[image]]
file   = "b.png"
lights = [{{ kind = "parallel", direction = [0, 0, 2], intensity = 2 }},
          {{ {POINT} }}]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_png(tmp_path / "a.png", codes(1))
    write_png(tmp_path / "b.png", codes(2))
    return tmp_path


def toml(folder: Path, *changes: tuple[str, str], text: str = TOP + IMAGES) -> Path:
    """The capture with parts of its text replaced; every part has to be there."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "capture.toml"
    path.write_text(text)
    return path


def test_nothing_is_divided_and_lights_are_as_written(folder: Path) -> None:
    capture = read_capture(toml(folder))
    assert capture.names == ("a.png", "b.png")
    np.testing.assert_allclose(capture.images[0], codes(1) / 65535, rtol=1e-6)
    first, second = capture.scenes
    np.testing.assert_allclose(first.ambient, (0.5, 0.6, 0.7), rtol=1e-6)
    (point,) = first.lights
    assert isinstance(point, PointLight)
    np.testing.assert_allclose(point.position, (1, 2, 3.5))
    np.testing.assert_allclose(point.intensity, (0.9, 0.8, 0.7), rtol=1e-6)
    assert isinstance(point.attenuation, QuadraticAttenuation)
    np.testing.assert_allclose(float(point.attenuation.c2), 0.1, rtol=1e-6)
    parallel, plain = second.lights
    assert isinstance(parallel, ParallelLight)
    assert float(parallel.intensity) == 2
    assert plain.attenuation is None
    assert capture.fit_attenuation is None


def test_the_geometry_is_what_the_camera_sees_of_it(folder: Path) -> None:
    capture = read_capture(toml(folder))
    seen = reference.see(
        {"kind": "sphere", "center": (0.1, 0, 0), "radius": 1.0},
        {"kind": "orthographic", "width": WIDTH, "height": HEIGHT, "extent": 3.2},
    )
    np.testing.assert_array_equal(capture.gbuffer.mask, seen.mask)
    np.testing.assert_array_equal(capture.valid[1], seen.mask)
    n = capture.gbuffer.normal
    np.testing.assert_allclose(np.stack([n.x, n.y, n.z], -1), seen.normal[seen.mask], atol=2e-6)


def test_a_mask_confines_the_geometry(folder: Path) -> None:
    inside = disc(9.0, 6.0, 4.0)
    inside[0, 0] = True  # where there is no sphere
    write_mask(folder / "mask.png", inside)
    capture = read_capture(toml(folder, ("ambient", 'mask = "mask.png"\nambient')))
    inside[0, 0] = False
    np.testing.assert_array_equal(capture.gbuffer.mask, inside)
    lost = f"1 of the mask's {inside.sum() + 1} pixels have no geometry: left out"
    assert lost in capture.notes


def test_clipping_and_white_are_as_in_a_folder(folder: Path) -> None:
    image = codes(1)
    image[6, 8, 2] = 65000
    write_png(folder / "a.png", image)
    assert np.argwhere(read_capture(toml(folder)).clipped[0]).tolist() == [[6, 8]]
    assert read_capture(folder, white=0.5).clipped[0].sum() > 1
    toml(folder, ("encoding =", "white = 0.5\nencoding ="))
    stated, given = read_capture(folder), read_capture(folder, white=0.7)
    assert stated.clipped[0].sum() > given.clipped[0].sum() > 1, "what is given goes before"


def test_images_in_folders_keep_their_names_apart(folder: Path) -> None:
    for name in ("left", "right"):
        (folder / name).mkdir()
        write_png(folder / name / "a.png", codes(1))
    path = toml(folder, ('"a.png"', '"left/a.png"'), ('"b.png"', '"right/a.png"'))
    assert read_capture(path).names == ("left/a.png", "right/a.png")


def test_a_folder_with_a_capture_is_that_capture(folder: Path) -> None:
    toml(folder)
    assert read_capture(folder).names == ("a.png", "b.png")
    assert "--circle" in refusal(folder, names=folder / "capture.toml", circle=(1.0, 2.0, 3.0))


@pytest.mark.parametrize("kind", ["linear", "exponential"])
def test_other_laws_without_numbers_are_to_be_fitted(folder: Path, kind: str) -> None:
    unknown, known = f'attenuation = {{ kind = "{kind}" }}', 'kind = "quadratic", c0 = 1, c1 = 0.0'
    path = toml(
        folder,
        (f"attenuation = {{ {known}, c2 = 0.1 }}", unknown),
        (f"{{ {POINT} }}", f"{{ {POINT}, {unknown} }}"),
    )
    law = {"linear": LinearAttenuation, "exponential": ExponentialAttenuation}[kind]
    capture = read_capture(path)
    assert capture.fit_attenuation is law
    point = capture.scenes[1].lights[1]
    assert isinstance(point.attenuation, law)
    mixed = toml(
        folder,
        (f"attenuation = {{ {known}, c2 = 0.1 }}", unknown),
        (f"{{ {POINT} }}", f'{{ {POINT}, attenuation = {{ kind = "quadratic" }} }}'),
    )
    assert "of another kind" in refusal(folder, names=mixed)


def test_attenuation_without_numbers_is_to_be_fitted(folder: Path) -> None:
    unknown = 'attenuation = { kind = "quadratic" }'
    path = toml(
        folder,
        ('attenuation = { kind = "quadratic", c0 = 1, c1 = 0.0, c2 = 0.1 }', unknown),
        (f"{{ {POINT} }}", f"{{ {POINT}, {unknown} }}"),
    )
    capture = read_capture(path)
    assert capture.fit_attenuation is QuadraticAttenuation
    parallel, point = capture.scenes[1].lights
    start = point.attenuation
    assert [float(c) for c in (start.c0, start.c1, start.c2)] == [1, 0, 0]
    assert isinstance(parallel, ParallelLight)


def test_attenuation_is_fitted_for_all_point_lights_or_for_none(folder: Path) -> None:
    path = toml(
        folder, ('{ kind = "quadratic", c0 = 1, c1 = 0.0, c2 = 0.1 }', '{ kind = "quadratic" }')
    )
    assert "image 2, light 2: its attenuation is known where that of image 1, light 1" in refusal(
        path
    )


def test_encoding_here_is_needed_where_files_do_not_say(folder: Path) -> None:
    no_encoding = ('encoding = "linear"', "")
    assert "does not say" in refusal(toml(folder, no_encoding), names=folder / "a.png")
    v = codes(1) / 65535
    toml(folder, ('"linear"', "2.0"))
    np.testing.assert_allclose(read_capture(folder).images[0], v**2, rtol=1e-6)
    np.testing.assert_allclose(read_capture(folder, encoding="linear").images[0], v, rtol=1e-6)
    write_png(folder / "a.png", codes(1), chunk=SRGB)
    write_png(folder / "b.png", codes(2), chunk=SRGB)
    capture = read_capture(toml(folder, no_encoding))
    np.testing.assert_allclose(
        capture.images[0], ((v + 0.055) / 1.055) ** 2.4, rtol=2e-3, atol=1e-3
    )
    assert "images read as srgb" in capture.notes


def test_geometry_of_normals_needs_no_camera(folder: Path) -> None:
    normal = np.zeros((HEIGHT, WIDTH, 3))
    normal[2:8, 3:9] = 0, 0, 1
    np.save(folder / "n.npy", normal)
    change = [
        (
            '{ kind = "sphere", center = [0.1, 0.0, 0.0], radius = 1.0 }',
            '{ kind = "normals", file = "n.npy" }',
        ),
        ('camera   = { kind = "orthographic", width = 16, height = 12, extent = 3.2 }', ""),
    ]
    path = toml(folder, *change)
    assert "image 1, light 1: a point light needs positions" in refusal(path)
    lights = 'lights = [{ kind = "parallel", direction = [0, 0, 1], intensity = 1 }]'
    image = f'[[image]]\nfile = "a.png"\n{lights}\n'
    path = toml(folder, *change, text=TOP + image)
    assert read_capture(path).gbuffer.pixel_count == 36
    np.save(folder / "n.npy", normal[1:])
    assert "16 x 11 pixels where" in refusal(path, names=folder / "n.npy")


def test_normals_with_positions_take_the_cameras_viewer_or_their_own(folder: Path) -> None:
    normal = np.ones((HEIGHT, WIDTH, 3))
    np.savez(folder / "n.npz", normal=normal, position=normal, eye=np.array([0.0, 0.0, 9.0]))
    geometry = (
        '{ kind = "sphere", center = [0.1, 0.0, 0.0], radius = 1.0 }',
        '{ kind = "normals", file = "n.npz" }',
    )
    camera = 'camera   = { kind = "orthographic", width = 16, height = 12, extent = 3.2 }'
    perspective = camera.replace("extent = 3.2", "fov = 0.5, position = [0, 0, 9]")
    perspective = perspective.replace("orthographic", "perspective")
    for text in ("", perspective):
        viewer: Any = read_capture(toml(folder, geometry, (camera, text))).gbuffer.viewer
        np.testing.assert_allclose(viewer.position, (0, 0, 9))
    assert "is not that of the camera" in refusal(toml(folder, geometry), names=folder / "n.npz")


def test_geometry_of_a_mesh(folder: Path) -> None:
    (folder / "quad.obj").write_text("v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3 4\n")
    sphere = '{ kind = "sphere", center = [0.1, 0.0, 0.0], radius = 1.0 }'
    path = toml(folder, (sphere, '{ kind = "mesh", file = "quad.obj" }'))
    assert read_capture(path).gbuffer.pixel_count == 100
    (folder / "quad.obj").write_text("v 0 0 0\n")
    assert refusal(path, names=folder / "quad.obj")
    path = toml(folder, (sphere, '{ kind = "mesh", file = "none.obj" }'))
    assert "no such file" in refusal(path, names=folder / "none.obj")


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("capture/1", "capture/2", "capture/2'; give one of \"diffshade.capture/1\""),
        ('schema   = "diffshade.capture/1"', "", 'the key "schema" is missing'),
        ("encoding =", "encodnig =", 'unknown key "encodnig"; the keys here are schema'),
        ("encoding =", "material = { kd = 1 }\nencoding =", "this is a scene, whose material is known"),
        ('"linear"', '"log"', "encoding is 'log'"),
        ("ambient  = [0.5, 0.6, 0.7]", "ambient = [0.5, 0.6]", "ambient has 2 numbers where"),
        ("ambient  = [0.5, 0.6, 0.7]", "ambient = -1", "ambient is -1; give a number of at least 0"),
        ("ambient  = [0.5, 0.6, 0.7]", "ambient = [0.5, true]", "or a list with one a channel"),
        ('"sphere"', '"cube"', "geometry: kind is 'cube'; give one of \"sphere\", \"mesh\", \"normals\""),
        ("radius = 1.0", "radius = 0", "geometry: radius is 0; give a number above 0"),
        (", radius = 1.0", "", 'geometry: the key "radius" is missing'),
        ("center = [0.1, 0.0, 0.0]", "center = [0.1, 0.0]", "three numbers"),
        ("width = 16", "width = 17", "the camera has 17 x 12 pixels where"),
        ("width = 16", "width = 16.5", "camera: width is 16.5; give a whole number"),
        ("extent = 3.2", 'extent = "3.2"', "camera: extent is '3.2'; give a number"),
        ("extent = 3.2", "extent = 3.2, up = [0, 0, 1]", "looks along its own up"),
        ("extent = 3.2", "extent = 3.2, position = [9, 9, 9], target = [9, 9, 5]", "sees nothing"),
        ('"orthographic"', '"perspective"', 'camera: unknown key "extent"'),
        ("[0, 0, 2]", "[0, 0, 0]", "image 2, light 1: direction is zero"),
        ("[0, 0, 2]", "[0, 0, nan]", "image 2, light 1: direction is [0, 0, nan]; give three numbers"),
        ("intensity = 2 ", "intensity = -2 ", "image 2, light 1: intensity is -2"),
        ("file   =", "exposure = [1, 2]\nfile =", "image 1: exposure has 2 numbers"),
        ("encoding =", "white = 0\nencoding =", "white is 0; give a number above 0"),
        ("encoding =", "white = 1.5\nencoding =", "white is 1.5, beyond the full scale of a.png; give"),
        ("intensity = 2 ", "intensity = [1, 2] ", "image 2, light 1: intensity has 2 numbers"),
        ("position = [1, 2, 3.5]", "postion = [1, 2, 3.5]", 'light 1: unknown key "postion"; the keys'),
        ("c0 = 1, ", "", 'light 1, attenuation: the key "c0" is missing'),
        ("c1 = 0.0", "c1 = -0.1", "attenuation: c1 is -0.1; give a number of at least 0"),
        ('"quadratic"', '"cubic"', "attenuation: kind is 'cubic'; give one of \"quadratic\", \"linear\""),
        ('file   = "b.png"', "", 'image 2: the key "file" is missing'),
        ('file   = "b.png"', "file = 3", "image 2: file is 3; give a text"),
        ("encoding =", "encoding", "is not valid TOML"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_refused(folder: Path, old: str, new: str, told: str) -> None:
    path = toml(folder, (old, new))
    assert told in refusal(path, names=f"{path}: ")


def test_a_syntax_error_is_told_with_its_line(folder: Path) -> None:
    assert "line 3" in refusal(toml(folder, text='schema = "x"\n\nencoding linear\n'))
    (folder / "capture.toml").write_bytes(b"\xff\xfe")
    assert "UTF-8" in refusal(folder / "capture.toml")


def test_without_images_or_light_there_is_nothing_to_fit(folder: Path) -> None:
    assert "there is no [[image]]" in refusal(toml(folder, text=f"{TOP}image = []\n"))
    dark = (
        TOP.replace("ambient  = [0.5, 0.6, 0.7]", "") + '[[image]]\nfile = "a.png"\nlights = []\n'
    )
    assert "image 1: lights is empty" in refusal(toml(folder, text=dark))


def test_files_that_are_missing_or_do_not_match_are_named(folder: Path) -> None:
    path = toml(folder)
    write_png(folder / "b.png", codes(2, (HEIGHT, WIDTH)))
    told = refusal(path, names=folder / "b.png")
    assert "16 x 12 pixels of 1 channel where" in told
    (folder / "b.png").unlink()
    assert "no such file" in refusal(path, names=folder / "b.png")
    (folder / "a.png").write_text("text")
    assert "not an image" in refusal(path, names=folder / "a.png")


def test_the_capture_that_ships_is_read() -> None:
    path = Path(diffshade.__file__).parent / "captures" / "glossy_ball"
    capture = read_capture(path)
    assert len(capture.names) >= 4
    assert capture.fit_attenuation is QuadraticAttenuation
    assert all(valid.sum() == capture.gbuffer.pixel_count for valid in capture.valid)
    assert capture.notes == ("images read as linear",)
