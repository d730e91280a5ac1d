"""glTF files as they are written: against the Khronos schema, another reader, and the formula by hand."""

import json
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from trimesh.exchange import gltf as by_trimesh

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.export.gltf import Metallic, as_gltf, write_gltf
from diffshade.io.toml_document import Table
from diffshade.vector import Vec3
from fitting.report import material_from_json

SPECULAR = "KHR_materials_specular"
MATERIALS = {
    "phong": ds.Material(0.1, (0.5, 0.3, 0.1), ds.Phong((0.3, 0.2, 0.1), 32.0)),
    "facets": ds.Material(kd=0.5, specular=ds.GGX(0.4, 0.1)),
    "schlick": ds.Material(specular=ds.GGX(0.4, 0.3, ds.Schlick(0.06))),
    "plastic": ds.Material(
        kd=(0.5, 0.3, 0.1), specular=ds.GGX(1.0, 0.2, ds.Dielectric()), body=ds.FresnelBody()
    ),
    "matt": ds.Material(kd=(0.5, 0.3, 0.1)),
}


def described(text: str) -> dict[str, Any]:
    (material,) = json.loads(text)["materials"]
    return material


@pytest.mark.parametrize("name", MATERIALS)
def test_it_is_valid(name: str) -> None:
    document = json.loads(as_gltf(MATERIALS[name]).text)
    by_trimesh.validate(document)  # the JSON schema of Khronos, which trimesh ships with
    assert document["extensionsUsed"] == [SPECULAR]
    own = document["materials"][0]["extensions"][SPECULAR]
    # What the extension's schema adds
    assert set(own) == {"specularFactor", "specularColorFactor"}
    assert 0 <= own["specularFactor"] <= 1
    assert len(own["specularColorFactor"]) == 3
    assert min(own["specularColorFactor"]) >= 0


def test_trimesh_and_our_reader_find_the_ball(tmp_path: Path) -> None:
    write_gltf(tmp_path / "a.gltf", MATERIALS["phong"], "shiny")
    (read,) = trimesh.load_scene(tmp_path / "a.gltf", process=False).geometry.values()
    assert read.is_watertight
    assert read.volume == pytest.approx(4 / 3 * np.pi, rel=0.02)
    np.testing.assert_allclose(read.vertex_normals, read.vertices, atol=1e-5)
    assert read.visual.material.name == "shiny"
    rough = described((tmp_path / "a.gltf").read_text())["pbrMetallicRoughness"]
    assert read.visual.material.roughnessFactor == rough["roughnessFactor"]
    ours = ds.load_mesh(tmp_path / "a.gltf")
    np.testing.assert_allclose(ours.vertices, read.vertices, atol=1e-6)


def test_a_mesh_of_the_users(tmp_path: Path) -> None:
    corners: Any = [[0, 0, 0], [2, 0, 0], [0, 3, 0], [9, 9, 9]]  # the last is of no face
    mesh = ds.Mesh(corners, [[0, 1, 2]])  # type: ignore[arg-type]
    write_gltf(tmp_path / "a.gltf", MATERIALS["matt"], mesh=mesh)
    by_trimesh.validate(json.loads((tmp_path / "a.gltf").read_text()))
    (read,) = trimesh.load_scene(tmp_path / "a.gltf", process=False).geometry.values()
    np.testing.assert_allclose(read.vertices, corners)
    assert read.faces.tolist() == [[0, 1, 2]]
    flat = ds.Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])  # type: ignore[arg-type]
    with pytest.raises(BadInput, match="without a normal"):
        as_gltf(MATERIALS["matt"], mesh=flat)


def by_the_specification(material: dict[str, Any], l: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Appendix B of glTF 2.0 with the changes of the extension, line by line, times n.l: [N, 3]."""
    rough, own = material["pbrMetallicRoughness"], material["extensions"][SPECULAR]
    alpha = rough["roughnessFactor"] ** 2
    h = (l + v) / np.linalg.norm(l + v, axis=1, keepdims=True)
    n_l, n_v, n_h, v_h = l[:, 2], v[:, 2], h[:, 2], (v * h).sum(axis=1)
    d = alpha**2 / (np.pi * (n_h**2 * (alpha**2 - 1) + 1) ** 2)
    root_l = np.sqrt(alpha**2 + (1 - alpha**2) * n_l**2)
    root_v = np.sqrt(alpha**2 + (1 - alpha**2) * n_v**2)
    visibility = 1 / (2 * (n_v * root_l + n_l * root_v))
    dielectric_f0 = np.minimum(0.04 * np.array(own["specularColorFactor"]), 1)
    dielectric_f0 = dielectric_f0 * own["specularFactor"]
    dielectric_f90 = own["specularFactor"]
    w = ((1 - np.abs(v_h)) ** 5)[:, None]
    fresnel = dielectric_f0 * (1 - w) + dielectric_f90 * w
    diffuse = np.array(rough["baseColorFactor"][:3]) / np.pi
    brdf = fresnel * (visibility * d)[:, None] + (1 - fresnel.max(axis=1, keepdims=True)) * diffuse
    return brdf * n_l[:, None]


@pytest.mark.parametrize("name", MATERIALS)
def test_what_is_compared_is_the_formula_of_gltf(name: str, tolerance: float) -> None:
    rng = np.random.default_rng(3)
    l, v = rng.normal(size=(2, 200, 3))
    for d in (l, v):
        d[:, 2] = np.abs(d[:, 2]) + 0.02
        d /= np.linalg.norm(d, axis=1, keepdims=True)
    own = described(as_gltf(MATERIALS[name], irradiance=3.0).text)
    found = Metallic.read(own, 3.0)(*(Vec3.from_array(jnp.asarray(d)) for d in (l, v)))
    found = np.broadcast_to(np.stack(found), (3, 200)).T
    expected = 3.0 * by_the_specification(own, l, v)
    np.testing.assert_allclose(found, expected, rtol=100 * tolerance, atol=tolerance)


@pytest.mark.parametrize("name", ["facets", "schlick", "matt"])
def test_what_gltf_has_is_exact(name: str) -> None:
    """Facets after GGX that reflect alike from all sides, or as Schlick's boundary does."""
    export = as_gltf(MATERIALS[name])
    assert max(export.error.relative_rms) < 1e-6
    assert export.notes == ()


def test_phong_is_close_where_light_is_high() -> None:
    export = as_gltf(MATERIALS["phong"])
    assert export.error.relative_rms[0] < 0.03
    assert export.error.relative_rms[1] < 0.03
    assert "ambient" in export.notes[0]
    own = described(export.text)["extensions"][SPECULAR]
    np.testing.assert_allclose(own["specularColorFactor"], 25 * np.array([1, 2 / 3, 1 / 3]))


@pytest.mark.parametrize("name", MATERIALS)
def test_the_exact_coefficients_stand_beside(name: str, tolerance: float) -> None:
    said = described(as_gltf(MATERIALS[name]).text)["extras"]["diffshade"]
    fit = {"schema": "diffshade.fit/1", "coefficients": said["coefficients"]}
    read, _ = material_from_json(Table(Path("a.gltf"), "", fit))
    for own in (read, MATERIALS[name]):
        probe = described(as_gltf(own).text)["extras"]["diffshade"]["coefficients"]
        assert probe == said["coefficients"]
    assert said["irradiance"] == pytest.approx(np.pi)
    assert len(said["error"]["relative_rms"]) == 4


@pytest.mark.parametrize(
    "material",
    [
        ds.Material(kd=(0.2, 0.9, 0.3), specular=ds.GGX(2.0, 0.1)),
        ds.Material(kd=0.2, specular=ds.GGX(7.0, 0.1, ds.Schlick())),
        ds.Material(specular=ds.BlinnPhong(1.0, 0.0)),
    ],
)
def test_the_irradiance_that_is_said_to_be_enough_is(material: ds.Material) -> None:
    with pytest.raises(BadInput, match="irradiance of") as refused:
        as_gltf(material, irradiance=0.5)
    enough = float(str(refused.value).split("irradiance of ")[1].split()[0])
    as_gltf(material, irradiance=enough)
    with pytest.raises(BadInput, match="irradiance of"):
        as_gltf(material, irradiance=0.98 * enough)
    with pytest.raises(BadInput, match="give a number above 0"):
        as_gltf(material, irradiance=0.0)
