"""glTF 2.0 with `KHR_materials_specular`: Lambert's term under one lobe of GGX's facets.

    f = (1 - w max F(h.l)) baseColor / pi + w F(h.l) D G / (4 n.l n.v)
    F = min(0.04 specularColor, 1), and 1 at grazing angles, by Schlick;  w = specularFactor
    alpha = roughness^2, G of Smith, height-correlated

(glTF 2.0, appendix B; KHR_materials_specular). A lobe whose share of reflected light does not grow
towards grazing angles, as Phong's, has specularColor 25, of which F is 1 everywhere, and w says how much
it reflects. The exact coefficients stand in the material's `extras`.
"""

import base64
import json
import os
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diffshade.channels import Channels, channels, plus, times
from diffshade.errors import BadInput
from diffshade.export.angular_error import angular_error
from diffshade.export.coefficients import RGB, Highlight, diffuse, highlight
from diffshade.export.document import (
    NO_AMBIENT,
    Export,
    check_reflects,
    extras,
    in_gamut,
    lit_by,
    write,
)
from diffshade.export.response import AbstractResponse, Exact, upright
from diffshade.geometry.mesh import Mesh
from diffshade.reflectance.conversion import alpha_of
from diffshade.reflectance.fresnel import Schlick, schlick
from diffshade.reflectance.lambert import lambert
from diffshade.reflectance.material import Material
from diffshade.reflectance.microfacet import GGX
from diffshade.vector import Vec3, dot, halfway

__all__ = ["as_gltf", "write_gltf"]

SPECULAR = "KHR_materials_specular"
F0 = 0.04
"""Of the index of refraction 1.5, which glTF takes where nothing else is said."""


def as_gltf(
    material: Material,
    name: str = "material",
    *,
    mesh: Mesh | None = None,
    irradiance: float = np.pi,
) -> Export:
    """A scene of one object, a ball of radius 1 unless a `mesh` is given, of this material.

    `irradiance` is that of a light of I_p = 1 in the other tool. Raises `BadInput` for maps, and where
    a colour would be above 1, with the irradiance that is enough.

    >>> document = json.loads(as_gltf(Material(kd=(0.6, 0.3, 0.2))).text)
    >>> document["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"]
    [0.6, 0.3, 0.2, 1.0]
    """
    check_reflects(material)
    lobe = highlight(material)
    notes: tuple[str, ...] = () if material.ka is None else (NO_AMBIENT,)
    if lobe is not None:
        notes += lobe.notes
    if material.body is not None:
        notes += ("the body is darkened by the facets' boundary alone, as light enters it",)
    described = _material(name, material, lobe, lit_by(irradiance))
    error = angular_error(Exact(material), Metallic.read(described, irradiance))
    described["extras"] = {"diffshade": extras(material, error, notes, irradiance)}
    document = {"asset": {"version": "2.0", "generator": "diffshade"}, **_scene(mesh or _ball())}
    document |= {"extensionsUsed": [SPECULAR], "materials": [described]}
    return Export(json.dumps(document, indent=2, allow_nan=False) + "\n", error, notes)


def write_gltf(
    path: str | os.PathLike[str],
    material: Material,
    name: str = "material",
    *,
    mesh: Mesh | None = None,
    irradiance: float = np.pi,
) -> Export:
    """Write a `.gltf` that holds all of it, as `as_gltf` makes it; atomic.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_gltf(f"{folder}/a.gltf", Material(kd=0.5)).error.relative_rms[0] < 1e-6
    True
    """
    return write(path, as_gltf(material, name, mesh=mesh, irradiance=irradiance))


class Metallic(AbstractResponse):
    """What the formula of glTF makes of its numbers, in light of an irradiance; not metallic."""

    base: Float[Array, "3"]
    facets: GGX
    irradiance: Float[Array, ""]

    @classmethod
    def read(cls, described: dict[str, Any], irradiance: float) -> "Metallic":
        """From a material of a file."""
        own, rough = described["extensions"][SPECULAR], described["pbrMetallicRoughness"]
        f0: Any = np.minimum(F0 * np.array(own["specularColorFactor"]), 1)
        facets = GGX(own["specularFactor"], rough["roughnessFactor"] ** 2, Schlick(f0))
        return cls(
            jnp.asarray(rough["baseColorFactor"][:3], float), facets, jnp.asarray(irradiance, float)
        )

    def __call__(self, l: Vec3, v: Vec3) -> Channels:
        assert isinstance(self.facets.fresnel, Schlick)
        passed = 1 - self.facets.ks * schlick(dot(halfway(l, v), l), self.facets.fresnel.f0.max())
        below = tuple(base / np.pi * passed * lambert(l.z) for base in channels(self.base))
        above = times((self.facets.ks,), self.facets.shape(upright(l), l, v, l.z))
        return times((self.irradiance,), plus(below, above))


def _material(
    name: str, material: Material, lobe: Highlight | None, irradiance: float
) -> dict[str, Any]:
    weight, f0, alpha = _facets(lobe, irradiance)
    kd = diffuse(material)
    albedo = np.zeros(3) if kd is None else np.pi * kd / irradiance
    mirrored = weight * min(float(f0.max()), 1.0)
    enough = irradiance * max(float(albedo.max()) + mirrored, weight)
    weight = in_gamut("specularFactor", np.array([weight]), enough)[0]
    passed = 1 - mirrored
    base = in_gamut("baseColorFactor", albedo / passed if passed > 0 else albedo + 1, enough)
    return {
        "name": name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [*base, 1.0],
            "metallicFactor": 0.0,
            "roughnessFactor": float(np.sqrt(alpha)),
        },
        "extensions": {
            SPECULAR: {"specularFactor": weight, "specularColorFactor": (f0 / F0).tolist()}
        },
    }


def _facets(lobe: Highlight | None, irradiance: float) -> tuple[float, RGB, float]:
    """w, F head-on and alpha, of as high a peak: E w F / (4 pi alpha^2) = k_s."""
    if lobe is None:
        return 0.0, np.full(3, F0), 1.0
    alpha = min(float(alpha_of(lobe.exponent)), 1.0)
    reflected = lobe.ks * 4 * np.pi * alpha**2 / irradiance
    share = reflected if lobe.f0 is None else reflected / np.maximum(lobe.f0, 1e-12)
    weight = float(share.max())
    return weight, reflected / weight if weight else np.full(3, F0), alpha


def _scene(mesh: Mesh) -> dict[str, Any]:
    """One mesh with normals, its numbers inside the file."""
    positions = np.asarray(mesh.vertices, "<f4")
    normals = np.array(mesh.vertex_normals().to_array(), "<f4")
    used = np.unique(np.asarray(mesh.faces))
    if not np.isclose(np.linalg.norm(normals[used], axis=1), 1, atol=1e-3).all():
        raise BadInput(
            "the mesh has vertices without a normal: glTF has none; leave out such faces"
        )
    normals[~np.isin(np.arange(len(normals)), used)] = 0, 0, 1
    corners = np.asarray(mesh.faces, "<u4").ravel()
    parts = [positions.tobytes(), normals.tobytes(), corners.tobytes()]
    starts = np.cumsum([0, *map(len, parts)]).tolist()
    vectors = {"componentType": 5126, "type": "VEC3", "count": len(positions)}
    data = base64.b64encode(b"".join(parts)).decode()
    return {
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [
            {
                "primitives": [
                    {"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0}
                ]
            }
        ],
        "accessors": [
            {
                "bufferView": 0,
                **vectors,
                "min": positions.min(axis=0).tolist(),
                "max": positions.max(axis=0).tolist(),
            },
            {"bufferView": 1, **vectors},
            {"bufferView": 2, "componentType": 5125, "type": "SCALAR", "count": len(corners)},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": len(part), "target": target}
            for start, part, target in zip(starts, parts, (34962, 34962, 34963), strict=False)
        ],
        "buffers": [
            {"byteLength": starts[-1], "uri": f"data:application/octet-stream;base64,{data}"}
        ],
    }


def _ball() -> Mesh:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=3)
    vertices: Any = np.asarray(ball.vertices)
    faces: Any = np.asarray(ball.faces)
    return Mesh(vertices, faces, normals=vertices)
