"""`scene.toml`."""

from pathlib import Path

import numpy as np
import pytest
import reference

from diffshade.errors import BadInput
from diffshade.geometry.camera import OrthographicCamera, PerspectiveCamera
from diffshade.geometry.frequency import FlatShading, GouraudShading, PhongShading
from diffshade.geometry.mesh import Mesh
from diffshade.geometry.sphere import Sphere
from diffshade.io.scene_toml import SceneFile, read_scene_toml
from diffshade.light.attenuation import (
    ExponentialAttenuation,
    InverseSquare,
    LinearAttenuation,
    QuadraticAttenuation,
    Windowed,
)
from diffshade.reflectance.blinn_phong import BlinnPhong
from diffshade.reflectance.phong import Phong
from diffshade.shading.render import render

SCENE = """
geometry = { kind = "sphere", center = [0, 0.1, 0], radius = 1.0 }
camera   = { kind = "perspective", width = 24, height = 20, fov = 0.5, position = [1, 1, 5] }
ambient  = 0.1
[[lights]]
kind        = "point"
position    = [2, 3, 4]
intensity   = [1, 0.9, 0.8]
attenuation = { kind = "quadratic", c0 = 1, c2 = 0.05 }
[[lights]]
kind      = "parallel"
direction = [-1, 0, 1]
intensity = 0.5
[material]
ka = 0.2
kd = [0.6, 0.3, 0.2]
[[material.specular]]
kind      = "phong"
ks        = 0.5
shininess = 20
"""
MESH = """
v -1 -1 0
v  1 -1 0
v  1  1 0
v -1  1 0
f 1 2 3 4
"""


def write(folder: Path, *changes: tuple[str, str]) -> Path:
    text = SCENE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "scene.toml"
    path.write_text(text)
    return path


def read(folder: Path, *changes: tuple[str, str]) -> SceneFile:
    return read_scene_toml(write(folder, *changes))


def on_mesh(folder: Path, *changes: tuple[str, str], mesh: str = MESH) -> tuple[SceneFile, Path]:
    (folder / "quad.obj").write_text(mesh)
    geometry = '{ kind = "sphere", center = [0, 0.1, 0], radius = 1.0 }'
    path = write(folder, (geometry, '{ kind = "mesh", file = "quad.obj" }'), *changes)
    return read_scene_toml(path), path


def test_a_scene_renders_as_its_numbers_say(tmp_path: Path) -> None:
    path = write(tmp_path)
    file = read_scene_toml(path)
    image = np.asarray(render(file.gbuffer(path), file.scene, file.material))
    expected = reference.render(
        [
            (
                {"kind": "sphere", "center": (0, 0.1, 0), "radius": 1.0},
                {"ka": 0.2, "kd": (0.6, 0.3, 0.2), "ks": 0.5, "shininess": 20},
            )
        ],
        [
            {
                "kind": "point",
                "position": (2, 3, 4),
                "intensity": (1, 0.9, 0.8),
                "attenuation": {"c0": 1, "c2": 0.05},
            },
            {"kind": "parallel", "direction": (-1, 0, 1), "intensity": 0.5},
        ],
        {"kind": "perspective", "width": 24, "height": 20, "fov": 0.5, "position": (1, 1, 5)},
        ambient=0.1,
    )
    np.testing.assert_allclose(image, expected, atol=2e-5)
    assert image.max() > 0.3


def test_what_is_left_out_is_absent(tmp_path: Path) -> None:
    specular = '[[material.specular]]\nkind      = "phong"\nks        = 0.5\nshininess = 20\n'
    file = read(tmp_path, ("ka = 0.2\n", ""), (specular, ""), ("ambient  = 0.1\n", ""))
    assert file.scene.ambient is None
    assert file.material.ka is None
    assert file.material.od is None
    assert file.material.specular == ()
    assert file.shading is None


def test_the_kinds(tmp_path: Path) -> None:
    file = read(tmp_path)
    assert isinstance(file.geometry, Sphere)
    assert isinstance(file.camera, PerspectiveCamera)
    assert isinstance(file.material.specular[0], Phong)
    blinn = read(tmp_path, ('"phong"', '"blinn_phong"'), ("ka = 0.2", "od = [1, 0, 0]\nos = 0.5"))
    assert isinstance(blinn.material.specular[0], BlinnPhong)
    np.testing.assert_allclose(blinn.material.od, (1, 0, 0))
    assert float(blinn.material.os) == 0.5
    quadratic = '{ kind = "quadratic", c0 = 1, c2 = 0.05 }'
    for text, kind in {
        quadratic: QuadraticAttenuation,
        '{ kind = "linear", c0 = 1, c1 = 0.5 }': LinearAttenuation,
        '{ kind = "inverse_square" }': InverseSquare,
        '{ kind = "exponential", a = 0.5 }': ExponentialAttenuation,
        '{ kind = "inverse_square", reach = 9 }': Windowed,
    }.items():
        assert type(read(tmp_path, (quadratic, text)).scene.lights[0].attenuation) is kind
    camera = 'kind = "perspective", width = 24, height = 20, fov = 0.5, position = [1, 1, 5]'
    flat = 'kind = "orthographic", width = 24, height = 20, extent = 3, up = [1, 0, 0]'
    file = read(tmp_path, (camera, flat))
    assert isinstance(file.camera, OrthographicCamera)
    np.testing.assert_allclose(file.camera.up, (1, 0, 0))


@pytest.mark.parametrize(
    ("name", "kind"), [("phong", PhongShading), ("flat", FlatShading), ("gouraud", GouraudShading)]
)
def test_the_shading_of_a_mesh(tmp_path: Path, name: str, kind: type) -> None:
    file, path = on_mesh(tmp_path, ("ambient", f'shading = "{name}"\nambient'))
    assert isinstance(file.geometry, Mesh)
    assert type(file.shading) is kind
    image = render(file.gbuffer(path), file.scene, file.material)
    assert image.shape == (20, 24, 3)
    assert float(image.max()) > 0


def test_a_mesh_may_bring_its_materials(tmp_path: Path) -> None:
    (tmp_path / "m.mtl").write_text("newmtl a\nKd 0.1 0.2 0.3\nnewmtl b\nKd 0.6 0.5 0.4\n")
    mesh = "mtllib m.mtl\n" + MESH.replace("f 1 2 3 4", "usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4")
    material = SCENE[SCENE.index("[material]") :]
    file, path = on_mesh(tmp_path, (material, ""), mesh=mesh)
    assert len(file.material) == 2
    image = render(file.gbuffer(path), file.scene, file.material)
    lower, upper = np.asarray(image)[13, 15], np.asarray(image)[6, 8]
    assert lower[0] < lower[2]
    assert upper[0] > upper[2]
    with pytest.raises(BadInput, match='the key "material" is missing'):
        on_mesh(tmp_path, (material, ""))


def test_a_map_of_normals_is_shaded_without_a_camera(tmp_path: Path) -> None:
    normal = np.zeros((20, 24, 3))
    normal[4:8, 5:9] = 0, 0, 1
    np.save(tmp_path / "n.npy", normal)
    changes = [
        ('kind = "sphere", center = [0, 0.1, 0], radius = 1.0', 'kind = "normals", file = "n.npy"'),
        (SCENE[SCENE.index("camera") : SCENE.index("ambient")], ""),
        (SCENE[SCENE.index("[[lights]]") : SCENE.rindex("[[lights]]")], ""),
    ]
    path = write(tmp_path, *changes)
    file = read_scene_toml(path)
    assert file.camera is None
    image = np.asarray(render(file.gbuffer(path), file.scene, file.material))
    # I_a k_a + I (k_d / sqrt(2) + k_s / sqrt(2)^20)
    expected = 0.1 * 0.2 + 0.5 * (np.array([0.6, 0.3, 0.2]) * 0.5**0.5 + 0.5 * 0.5**10)
    np.testing.assert_allclose(image[5, 6], expected, rtol=1e-5)
    assert not image[0].any()


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("ambient ", "ambeint ", 'unknown key "ambeint"; the keys here are geometry, schema'),
        ("ambient ", 'schema = "x"\nambient ', 'give one of "diffshade.scene/1"'),
        ("ambient ", 'shading = "toon"\nambient ', 'give one of "phong", "flat", "gouraud"'),
        ("ambient ", 'shading = "flat"\nambient ', "which has no faces"),
        ("ambient ", "image = []\nambient ", "this is a capture, of photographs; give it"),
        ("ambient ", "shadows = 1\nambient ", "shadows is 1; give true or false"),
        (", c0 = 1, c2 = 0.05", "", "light 1: its attenuation has no numbers"),
        ("c0 = 1, c2 = 0.05", "reach = 3", 'the key "c0" is missing'),
        ("fov = 0.5", "fov = 45", "camera: fov is 45"),
        (", position = [1, 1, 5]", "", 'camera: the key "position" is missing'),
        ("kd = [0.6, 0.3, 0.2]", "kd = [0.6, 0.3]", "one for each channel"),
        ("kd = [0.6, 0.3, 0.2]", "kd = []", "material: kd is []"),
        ("kd = [0.6, 0.3, 0.2]", "kd = -0.1", "material: kd is -0.1"),
        ("kd = [0.6, 0.3, 0.2]", "Kd = 0.1", 'material: unknown key "Kd"'),
        ('"phong"', '"ward"', 'material, lobe 1: kind is \'ward\'; give one of "phong", "blinn_phong"'),
        ("shininess = 20", "", 'material, lobe 1: the key "shininess" is missing'),
        ("shininess = 20", "shininess = inf", "material, lobe 1: shininess is inf"),
        (SCENE[SCENE.index("ka = 0.2") :], "", "material: it has no term; give ka, kd or specular"),
        (SCENE[SCENE.index("ambient") : SCENE.index("[material]")], "", "there is no light"),
        (SCENE[SCENE.index("[[lights]]") : SCENE.index("[material]")], "lights = [3]\n", "lights is [3]"),
        ("[[material.specular]]", "[material.specular]", "material: specular is one table, and there may"
         " be several: write [[material.specular]] with two brackets, or specular = [{ ... }]"),
        ("[[material.specular]]", "[[specular]]", "specular stands at the top, and is the material's:"
         " write it below [[material.specular]]"),
        ("[[material.specular]]", "[specular]", "specular stands at the top, and is the material's"),
        ("[material]\n", "", "light 2: unknown key \"ka\""),
        (SCENE[SCENE.index("[[lights]]") : SCENE.index("ka = 0.2")], "", "ka stands at the top, and"
         " is the material's: write it below [material]"),
        (SCENE[SCENE.index("[[lights]]") : SCENE.index("[material]")], "[lights]\nkind = 'point'\n",
         "lights is one table, and there may be several: write [[lights]] with two brackets"),
        (SCENE, "geometry = 3", 'there is no light'),
        (SCENE, "geometry = 3\nambient = 1", "geometry is 3; give a table"),
        (SCENE, "", 'the key "geometry" is missing'),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_refused(tmp_path: Path, old: str, new: str, told: str) -> None:
    path = write(tmp_path, (old, new))
    with pytest.raises(BadInput) as caught:
        read_scene_toml(path).gbuffer(path)
    message = str(caught.value)
    assert told in message
    assert message.startswith(f"{path}: ")
    assert "\n" not in message


def test_a_mesh_in_its_own_shadow(tmp_path: Path) -> None:
    """A roof over half of a floor: under a light from above what it covers has the ambient light."""
    rows = [
        "v -1 -1 0",
        "v 1 -1 0",
        "v 1 1 0",
        "v -1 1 0",
        "v 0 -1 1",
        "v 2 -1 1",
        "v 2 1 1",
        "v 0 1 1",
    ]
    faces = ["f 1 2 3", "f 1 3 4", "f 5 6 7", "f 5 7 8"]
    (tmp_path / "roof.obj").write_text("\n".join([*rows, *faces]) + "\n")
    text = """
        ambient = 0.5
        shadows = true
        material = { ka = 0.2, kd = 0.5 }
        geometry = { kind = "mesh", file = "roof.obj" }
        [camera]
        kind = "orthographic"
        width = 24
        height = 24
        extent = 1.9
        position = [0, 0, 0.5]
        target = [0, 0, 0]
        up = [0, 1, 0]
        [[lights]]
        kind = "parallel"
        direction = [0, 0, 1]
        intensity = 1.0
        [[lights]]
        kind = "rectangle"
        center = [0, 0, 40]
        u = [1, 0, 0]
        v = [0, -1, 0]
        radiance = 800
        samples = 2
    """
    path = tmp_path / "roof.toml"
    path.write_text(text)
    file = read_scene_toml(path)
    assert len(file.lights) == 2
    gbuffer = file.gbuffer(path)
    image = np.asarray(render(gbuffer, file.lit(gbuffer), file.material))[..., 0]
    np.testing.assert_allclose(image[:, 13:], 0.1, rtol=1e-5)
    np.testing.assert_allclose(image[:, :10], 0.1 + 0.5 * (1 + 0.5), rtol=5e-3)
    path.write_text(text.replace("shadows = true", ""))
    assert read_scene_toml(path).lit(gbuffer).lights[0].visible is None


def test_a_map_of_normals_has_no_shadows(tmp_path: Path) -> None:
    np.save(tmp_path / "n.npy", np.ones((4, 4, 3)))
    path = tmp_path / "s.toml"
    path.write_text(
        'geometry = { kind = "normals", file = "n.npy" }\nambient = 1\nshadows = true\n'
        "material = { ka = 1 }\n"
    )
    with pytest.raises(BadInput, match="shadows need a surface"):
        read_scene_toml(path)
