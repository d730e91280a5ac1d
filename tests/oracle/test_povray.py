"""Our renders against POV-Ray, which shares nothing with them (`tests/povray.py`).

Float64 only: a float32 image's own error is as large as the rounding of POV-Ray's 16-bit file.

Images are compared on the pixels that both programs see. Both trace the ray of a pixel's centre,
so they may disagree about a pixel only if its ray passes the outline within 1e-6 of the radius:
POV-Ray drops a chord whose squared half is under 1e-10.
"""

import importlib.util
import json
import tomllib
from pathlib import Path
from typing import Any

import imagecodecs
import jax
import numpy as np
import povray
import pytest
import reference

import diffshade as ds
from diffshade.vector import dot

SPHERE_TOLERANCE = 1.6e-5
"""The step of a 16-bit file is 1.53e-5, half of it the rounding."""
MESH_TOLERANCE = 1e-4
"""POV-Ray keeps a mesh's vertices and normals in single precision."""

CAPTURE = Path(ds.__file__).parent / "captures" / "glossy_ball"

SPHERE: dict[str, Any] = {"kind": "sphere", "center": (0.05, -0.03, 0.1), "radius": 1.0}
AMBIENT = (1.0, 0.8, 0.9)

MATERIALS: dict[str, dict[str, Any]] = {
    "matte": {"ka": (0.1, 0.05, 0.02), "kd": (0.5, 0.3, 0.2)},
    "satin": {"ka": (0.1, 0.0, 0.05), "kd": (0.4, 0.2, 0.0), "ks": 0.2, "shininess": 6.5},
    "glossy": {"ka": 0.02, "kd": (0.2, 0.3, 0.25), "ks": (0.1, 0.3, 0.2), "shininess": 120.0},
}


def _point(position: Any, intensity: Any, **attenuation: float) -> dict[str, Any]:
    light = {"kind": "point", "position": position, "intensity": intensity}
    return {**light, "attenuation": attenuation} if attenuation else light


def _parallel(direction: Any, intensity: Any) -> dict[str, Any]:
    return {"kind": "parallel", "direction": direction, "intensity": intensity}


LIGHTS: dict[str, list[dict[str, Any]]] = {
    "points": [_point((2, 3, 4), (0.6, 0.5, 0.4)), _point((-2, 0.5, -1), (0.5, 0.2, 0.6))],
    "attenuated": [
        _point((1.5, 1.0, 2.0), (1.1, 1.0, 0.9), c0=1.0, c2=0.2),
        _point((-1.2, 0.4, 1.1), (0.4, 0.5, 0.1), c0=1.0, c2=1.0),
        _point((0, -3, 1.5), (0.6, 0.8, 1.0), c0=1.5, c1=0.2),
    ],
    "parallel": [_parallel((1, 2, 3), (0.5, 0.6, 0.7)), _parallel((-2, 1, -0.3), 0.4)],
    "all": [
        _point((2, 3, 4), (0.3, 0.3, 0.2)),
        _point((-1.2, 0.4, 1.1), (0.4, 0.5, 0.1), c0=1.0, c2=0.5),
        _parallel((1, -2, 1), (0.3, 0.2, 0.1)),
        _point((0, 0, 5), 0.2),
    ],
}

CAMERAS: dict[str, dict[str, Any]] = {
    "orthographic": {"kind": "orthographic", "width": 64, "height": 64, "extent": 2.4},
    "orthographic-oblique": {
        "kind": "orthographic",
        "width": 72,
        "height": 48,
        "extent": 4.0,
        "position": (3, 2, 4),
        "target": (0.1, 0.1, 0),
        "up": (0.1, 1, 0),
    },
    "perspective": {
        "kind": "perspective",
        "width": 80,
        "height": 60,
        "fov": 1.0,
        "position": (2, 1, 2),
        "target": (0.1, 0, 0),
        "up": (0.3, 1, 0),
    },
}


@pytest.fixture
def float64_only() -> None:
    """Skip where JAX's 64-bit mode is off."""
    if not jax.config.read("jax_enable_x64"):
        pytest.skip("float32 errs as much as the 16-bit file rounds")


def _ours(
    geometry: dict[str, Any], material: dict[str, Any], lights: list[Any], camera: dict[str, Any]
) -> tuple[ds.GBuffer, np.ndarray]:
    """The same scene by this library: its G-buffer and its image."""
    kinds: dict[str, Any] = {
        "sphere": ds.Sphere,
        "mesh": ds.Mesh,
        "orthographic": ds.OrthographicCamera,
        "perspective": ds.PerspectiveCamera,
    }
    gbuffer = ds.gbuffer(*(kinds[x["kind"]](**_without_kind(x)) for x in (geometry, camera)))
    specular = None
    if "ks" in material:
        specular = ds.Phong(ks=material["ks"], shininess=material["shininess"])
    scene = ds.Scene(ambient=AMBIENT, lights=tuple(_light(light) for light in lights))
    surface = ds.Material(ka=material["ka"], kd=material["kd"], specular=specular)
    return gbuffer, np.asarray(ds.render(gbuffer, scene, surface))


def _light(light: dict[str, Any]) -> Any:
    if light["kind"] == "parallel":
        return ds.ParallelLight(**_without_kind(light))
    fields = _without_kind(light)
    if "attenuation" in fields:
        constants = {"c0": 1.0, "c1": 0.0, "c2": 0.0, **fields["attenuation"]}
        fields["attenuation"] = ds.QuadraticAttenuation(**constants)
    return ds.PointLight(**fields)


def _without_kind(fields: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in fields.items() if key != "kind"}


@povray.requires_povray
@pytest.mark.usefixtures("float64_only")
@pytest.mark.parametrize("camera", ["orthographic", "perspective"])
@pytest.mark.parametrize("lights", LIGHTS)
@pytest.mark.parametrize("material", MATERIALS)
def test_sphere(material: str, lights: str, camera: str) -> None:
    """The whole sphere, outline included, within the rounding of the file."""
    _compare_spheres(SPHERE, MATERIALS[material], LIGHTS[lights], CAMERAS[camera])


@povray.requires_povray
@pytest.mark.usefixtures("float64_only")
def test_sphere_by_an_oblique_orthographic_camera() -> None:
    camera = CAMERAS["orthographic-oblique"]
    _compare_spheres(SPHERE, MATERIALS["glossy"], LIGHTS["all"], camera)


@povray.requires_povray
@pytest.mark.usefixtures("float64_only")
def test_pixels_on_the_outline() -> None:
    """Twelve pixel centres lie on the outline exactly: 3.5^2 + 0.5^2 = 2.5^2 + 2.5^2 = 12.5."""
    camera = {"kind": "orthographic", "width": 10, "height": 10, "extent": 10.0}
    ball = {"kind": "sphere", "center": (0.0, 0.0, 0.0), "radius": 12.5**0.5}
    assert (np.abs(_outline_distance(ball, camera)) < 1e-12).sum() == 12
    _compare_spheres(ball, MATERIALS["matte"], LIGHTS["parallel"], camera)


def _compare_spheres(
    ball: dict[str, Any], material: dict[str, Any], lights: list[Any], camera: dict[str, Any]
) -> None:
    gbuffer, image = _ours(ball, material, lights, camera)
    theirs = povray.render([(ball, material)], lights, camera, ambient=AMBIENT)
    seen, seen_by_them = np.asarray(gbuffer.mask), povray.mask([ball], camera)
    disputed = seen != seen_by_them
    assert np.all(np.abs(_outline_distance(ball, camera)[disputed]) < 1e-6)
    both = seen & seen_by_them
    assert both.sum() > 20
    error = np.abs(image - theirs)[both].max()
    assert error <= SPHERE_TOLERANCE, f"error {error:.2e}"


def _outline_distance(ball: dict[str, Any], camera: dict[str, Any]) -> np.ndarray:
    """How far outside the sphere each pixel's ray passes, in units of the radius."""
    origin, direction = reference.rays(camera)
    to_center = np.asarray(ball["center"]) - origin
    across = to_center - reference.dot(to_center, direction) * direction
    return np.linalg.norm(across, axis=-1) / ball["radius"] - 1.0


@povray.requires_povray
@pytest.mark.usefixtures("float64_only")
@pytest.mark.parametrize("camera", ["orthographic", "perspective"])
@pytest.mark.parametrize("material", ["matte", "glossy"])
def test_mesh_with_smooth_normals(material: str, camera: str) -> None:
    """A torus, wherever its interpolated normal faces the viewer.

    Next to the outline of a coarse mesh the interpolated normal may face away. POV-Ray turns such
    a normal around and we do not; there is no right answer.
    """
    torus = _torus(32, 16, major=0.7, minor=0.3, tilt=0.9)
    coefficients, lights = MATERIALS[material], LIGHTS["all"]
    gbuffer, image = _ours(torus, coefficients, lights, CAMERAS[camera])
    theirs = povray.render([(torus, coefficients)], lights, CAMERAS[camera], ambient=AMBIENT)
    seen, seen_by_them = np.asarray(gbuffer.mask), povray.mask([torus], CAMERAS[camera])
    assert (seen != seen_by_them).sum() <= 2
    view = gbuffer.viewer.direction(gbuffer.position)
    facing = np.asarray(gbuffer.to_image((dot(gbuffer.normal, view),)))[..., 0] > 0.0
    compared = seen & seen_by_them & facing
    assert compared.sum() > 0.97 * seen.sum()
    error = np.abs(image - theirs)[compared].max()
    assert error <= MESH_TOLERANCE, f"error {error:.2e}"


def _torus(around: int, across: int, *, major: float, minor: float, tilt: float) -> dict[str, Any]:
    u, v = np.meshgrid(
        np.arange(around) * 2 * np.pi / around,
        np.arange(across) * 2 * np.pi / across,
        indexing="ij",
    )
    normals = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1)
    ring = np.stack([np.cos(u), np.sin(u), np.zeros_like(u)], axis=-1)
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    next_i, next_j = (i + 1) % around, (j + 1) % across
    a, b, c, d = (
        (p * across + q).ravel() for p, q in ((i, j), (next_i, j), (next_i, next_j), (i, next_j))
    )
    cos, sin = np.cos(tilt), np.sin(tilt)
    turn = np.array([[1, 0, 0], [0, cos, sin], [0, -sin, cos]])
    return {
        "kind": "mesh",
        "vertices": (major * ring + minor * normals).reshape(-1, 3) @ turn,
        "faces": np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]),
        "normals": normals.reshape(-1, 3) @ turn,
    }


def test_the_shipped_capture_is_its_truth_and_noise() -> None:
    """The images minus an independent render of the truth: noise of the stated size, no bias."""
    make = _maker()
    capture = tomllib.loads((CAPTURE / "capture.toml").read_text())
    truth = json.loads((CAPTURE / "truth.json").read_text())
    hits = reference.see(capture["geometry"], capture["camera"])
    for image in capture["image"]:
        lights = [{**light, "attenuation": truth["attenuation"]} for light in image["lights"]]
        p, n, v = (plane[hits.mask] for plane in (hits.position, hits.normal, hits.view))
        expected = reference.shade(p, n, v, lights, truth, ambient=capture["ambient"])
        pixels = imagecodecs.png_decode((CAPTURE / image["file"]).read_bytes())
        assert pixels.dtype == np.uint16
        assert not pixels[~hits.mask].any()
        observed = pixels[hits.mask] / 65535.0
        assert 0.85 < observed.max() < 0.95
        noise = (observed - expected) / make.NOISE
        assert abs(noise.std() - 1.0) < 0.02
        assert abs(noise.mean()) < 4.0 / noise.size**0.5
        assert np.abs(noise).max() < 6.0


def test_the_shipped_scene_is_what_its_script_writes() -> None:
    make = _maker()
    for name, text in (
        ("scene.pov", make.scene()),
        ("capture.toml", make.capture()),
        ("truth.json", make.truth()),
    ):
        assert (CAPTURE / name).read_text() == text, f"{name}: run make.py"


def _maker() -> Any:
    spec = importlib.util.spec_from_file_location("make_glossy_ball", CAPTURE / "make.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
