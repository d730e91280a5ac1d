"""Numbers that other projects' own tests assert for the same formulas, at their tolerance.

Every entry is either of a formula that is covered, and checked here or where `ELSEWHERE` says, or of
one that is not covered yet; none is passed over in silence.
"""

import json
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from shared import SHARED

import diffshade as ds
import fitting
from diffshade.io.encoding import decode, encode_srgb
from diffshade.vector import Vec3, reflect

FILE = SHARED / "data" / "reference_values.json"
ENTRIES: list[dict[str, Any]] = json.loads(FILE.read_text()) if FILE.exists() else []

pytestmark = pytest.mark.skipif(
    not ENTRIES, reason="../shared/data/reference_values.json is absent"
)

ELSEWHERE = {
    "face_normals (flat shading)": "tests/geometry/test_normals.py",
    "vertex_normals (Gouraud/Phong shading)": "tests/geometry/test_normals.py",
}
"""Entries that the test of the module itself checks."""

NOT_COVERED_YET = (
    "Beckmann",
    "Smith G1",
    "exact dielectric Fresnel",
    "s-polarised",
    "spot emitter",
    "FIT recovery: cos(theta_h)",
    "Blinn-Phong exponent from roughness",
)
"""Microfacets, Fresnel, spot lights and conversions between models."""


def shade(
    position: Any, normal: Any, lights: Any, material: ds.Material, *, eye: Any = None
) -> np.ndarray:
    """The radiance of points [N, 3], by `render`."""
    normals = np.atleast_2d(np.asarray(normal, float))
    positions = np.broadcast_to(np.asarray(position, float), normals.shape)
    inside = np.ones((1, len(normals)), bool)
    gbuffer = ds.GBuffer.from_arrays(positions[None], normals[None], inside, eye=eye)
    return np.asarray(ds.render(gbuffer, ds.Scene(lights=lights), material))[0]


def lambertian(i: dict[str, Any], expected: np.ndarray) -> np.ndarray:
    """rho / pi where light and viewer are in front: k_d = rho / pi, and n.l is not part of a BRDF."""
    n, l = np.array(i["surface_normal"]), -np.array(i["direction_incoming_light"])
    image = shade((0, 0, 0), n, ds.ParallelLight(l), ds.Material(kd=np.array(i["albedo"]) / np.pi))
    seen = n @ np.array(i["direction_outgoing_light"]) > 0
    n_dot_l = n @ l / np.linalg.norm(l)
    return image[0] / abs(n_dot_l) * seen


def lobe(kind: type[ds.Phong] | type[ds.BlinnPhong], normalised: Callable[[float], float]):  # type: ignore[no-untyped-def]
    """A normalised BRDF: k_s = albedo times the factor of the note."""

    def of(i: dict[str, Any], expected: np.ndarray) -> np.ndarray:
        n, l = np.array(i["surface_normal"]), -np.array(i["direction_incoming_light"])
        v = np.array(i["direction_outgoing_light"])
        power = i["shininess"]
        specular = kind(ks=np.array(i["albedo"]) * normalised(power), shininess=power)
        image = shade((0, 0, 0), n, ds.ParallelLight(l), ds.Material(specular=specular), eye=v)
        return image[0] * (n @ v > 0)

    return of


def point_radiance(i: dict[str, Any], expected: np.ndarray) -> np.ndarray:
    """radiance brdf cos / (4 pi d^2); nothing where the observer is behind; the BRDF returns v."""
    n, p = np.array(i["surface_normal"]), np.array(i["surface_point"])
    s = np.array(i["observation_point"]) - p
    brdf = s / np.linalg.norm(s)
    if i["reflected_light_fall_off"]:
        brdf = brdf / (s @ s)
    radiance = i["light_radiance"][0] / (4 * np.pi)
    light = ds.PointLight(i["light_position"], radiance, ds.InverseSquare())
    return shade(p, n, light, ds.Material(kd=brdf))[0] * (n @ s >= 0)


def diffuse(i: dict[str, Any], expected: np.ndarray) -> np.ndarray:
    """k_d n.l of a point or a parallel light; packed entries hold one light and normal a mesh."""
    material = ds.Material(kd=i["diffuse_color"])
    if "location" in i:
        return shade(i["point"], i["normal"], ds.PointLight(i["location"]), material)[0]
    if "point_to_mesh" not in i:
        return shade((0, 0, 0), i["normal"], ds.ParallelLight(i["direction_to_light"]), material)[0]
    return np.stack(
        [
            shade(
                (0, 0, 0), i["normal"][m], ds.ParallelLight(i["direction_to_light"][m]), material
            )[0]
            for m in i["point_to_mesh"]
        ]
    )


def specular(i: dict[str, Any], expected: np.ndarray) -> np.ndarray:
    """k_s (r.v)^n of a point or a parallel light."""
    if "point_to_mesh" in i:
        per_mesh = ("direction_to_light", "camera_position", "normal", "specular_color")
        meshes = [{**i, "point": (0, 0, 0), **{k: i[k][m] for k in per_mesh}} for m in (0, 1)]
        for mesh in meshes:
            del mesh["point_to_mesh"]
        return np.stack([specular(meshes[m], expected) for m in i["point_to_mesh"]])
    material = ds.Material(specular=ds.Phong(i["specular_color"], i["shininess"]))
    if "location" in i:
        light: Any = ds.PointLight(i["location"])
    else:
        light = ds.ParallelLight(i["direction_to_light"])
    return shade(i["point"], i["normal"], light, material, eye=i["camera_position"])[0]


def reflected(i: dict[str, Any], expected: np.ndarray) -> np.ndarray:
    """v - 2 (n.v) n is the mirror direction of -v."""
    v, n = (Vec3(*map(jnp.asarray, map(float, i[k]))) for k in ("v", "n"))
    return np.asarray(reflect(-v, n).to_array())


def diffuse_bsdf(i: dict[str, Any], expected: np.ndarray) -> np.ndarray:
    """rho / pi n.l: the light comes along theta_o."""
    l = (np.sin(i["theta_o"]), 0.0, np.cos(i["theta_o"]))
    return shade(
        (0, 0, 0), i["normal"], ds.ParallelLight(l), ds.Material(kd=i["reflectance"] / np.pi)
    )[0, 0]


def fitted_power(i: dict[str, Any], expected: Any) -> dict[str, float]:
    """y = k_s x^N: a flat mirror seen along directions with r.v = x, fitted without a diffuse part."""
    x = np.arange(99) / 100
    view = np.stack([np.sqrt(1 - x**2), 0 * x, x], axis=-1)[None]
    normal = np.broadcast_to([0.0, 0.0, 1.0], view.shape)
    gbuffer = ds.GBuffer.from_arrays(-view, normal, np.ones((1, 99), bool), eye=(0, 0, 0))
    fit = fitting.fit(
        (2.1 * x**3.14)[None, :, None],
        gbuffer,
        ds.Scene(lights=ds.ParallelLight((0, 0, 1))),
        material=ds.Material(specular=ds.Phong(ks=i["start"]["ks"], shininess=i["start"]["N"])),
        bounds={"specular.ks": (0, None)},
    )
    lobe = fit.material.specular[0]
    return {"ks": float(lobe.ks[0]), "N": float(lobe.shininess)}


FORMULAS: dict[str, Callable[[dict[str, Any], Any], Any]] = {
    "lambertian.brdf": lambertian,
    "phong.brdf": lobe(ds.Phong, lambda n: (n + 2) / (2 * np.pi)),
    "blinn_phong.brdf": lobe(
        ds.BlinnPhong, lambda n: (n + 2) * (n + 4) / (8 * np.pi * (2 ** (-n / 2) + n))
    ),
    "point_light.estimate_radiance": point_radiance,
    "srgb.from_linear_rgb": lambda i, _: encode_srgb(np.array(i["linear"])),
    "linear_rgb.from_srgb": lambda i, _: decode(np.array(i["srgb"]), "srgb"),
    "eotf_sRGB": lambda i, _: decode(np.array(i["srgb"]), "srgb"),
    "reflect(v,n)=v-2(n.v)n": reflected,
    "DirectionalLights.diffuse": diffuse,
    "PointLights.diffuse": diffuse,
    "DirectionalLights.diffuse (packed, 2 meshes: 6+4 points)": diffuse,
    "DirectionalLights.specular": specular,
    "PointLights.specular": specular,
    "DirectionalLights.specular (packed)": specular,
    "diffuse BSDF*cos, reflectance 0.5": diffuse_bsdf,
    "FIT recovery: y=ks*x^N": fitted_power,
}


def test_every_entry_is_accounted_for() -> None:
    for entry in ENTRIES:
        name = entry["function"]
        assert name in FORMULAS or name in ELSEWHERE or name.startswith(NOT_COVERED_YET), name


@pytest.mark.float64
@pytest.mark.parametrize("k", [k for k, e in enumerate(ENTRIES) if e["function"] in FORMULAS])
def test_entry(k: int) -> None:
    entry = ENTRIES[k]
    expected, allowed = entry["expected"], entry["tol"]
    found = FORMULAS[entry["function"]](entry["inputs"], expected)
    relative = allowed.get("rtol", allowed.get("suggested_rtol", 0))
    if not isinstance(expected, dict):
        found, expected = {"value": found}, {"value": expected}
    for name, value in expected.items():
        np.testing.assert_allclose(
            found[name], value, rtol=relative, atol=allowed.get("atol", 0), err_msg=entry["source"]
        )
