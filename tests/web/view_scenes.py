"""Scenes that pages are made of: each part that a page can show is in one of them."""

import json
import math
from pathlib import Path

from diffshade.cli import run

__all__ = ["FIT", "SCENES", "make_page", "write"]

BALL = """
geometry = { kind = "sphere", center = [0.1, 0.05, 20], radius = 1.0 }
camera = { kind = "orthographic", width = 144, height = 135, extent = 2.4 }
ambient = [0.1, 0.1, 0.12]
[[lights]]
kind = "point"
position = [2, 3, 24]
intensity = [1.0, 0.9, 0.8]
attenuation = { kind = "quadratic", c0 = 1.0, c1 = 0.02, c2 = 0.01 }
[[lights]]
kind = "point"
position = [-3, 0.5, 21]
intensity = [0.2, 0.3, 0.5]
attenuation = { kind = "linear", c0 = 0.5, c1 = 0.1 }
[material]
ka = [0.4, 0.2, 0.1]
kd = [0.6, 0.3, 0.2]
[[material.specular]]
kind = "phong"
ks = 0.5
shininess = 60
"""
MESH = """
geometry = { kind = "mesh", file = "torus.obj" }
camera = { kind = "perspective", width = 150, height = 120, fov = 0.5, position = [0.5, 3, 4.5] }
ambient = 0.1
[[lights]]
kind = "point"
position = [1, 2, 3]
intensity = 9.0
attenuation = { kind = "inverse_square", reach = 9 }
[[lights]]
kind = "parallel"
direction = [-1, 0.2, 0.4]
intensity = [0.2, 0.25, 0.3]
[material]
ka = 0.3
kd = [0.3, 0.25, 0.2]
[[material.specular]]
kind = "blinn_phong"
ks = 0.3
shininess = 80
"""
EVERYTHING = """
geometry = { kind = "sphere", center = [0, 0, 0], radius = 1.0 }
camera = { kind = "perspective", width = 120, height = 102, fov = 0.6, position = [0.5, 1, 4] }
[[lights]]
kind = "spot"
position = [2, 2, 3]
direction = [-2, -2, -2.8]
intensity = 2.0
exponent = 20
cutoff = 0.3
attenuation = { kind = "exponential", a = 0.1 }
[[lights]]
kind = "parallel"
direction = [-1, 0.2, -0.1]
intensity = [1, 0.8, 0.9]
[[lights]]
kind = "parallel"
direction = [-0.2, -1, 1]
intensity = 0.4
[material]
kd = [0.3, 0.25, 0.2]
od = [0.9, 1, 0.8]
os = 0.9
body = { kind = "fresnel", index = 1.5 }
[[material.specular]]
kind = "ggx"
ks = 1
alpha = 0.2
fresnel = { kind = "dielectric", index = 1.5 }
[[material.specular]]
kind = "beckmann"
ks = 0.4
alpha = 0.3
masking = "separable"
fresnel = { kind = "schlick", f0 = [0.1, 0.2, 0.3] }
[[material.specular]]
kind = "beckmann"
ks = 0.2
alpha = [0.5, 0.4, 0.3]
rational = true
[[material.specular]]
kind = "torrance_sparrow"
ks = 0.2
alpha = 0.25
fresnel = { kind = "conductor", index = [0.2, 0.92, 1.1], extinction = [3.9, 2.45, 2.14] }
[[material.specular]]
kind = "phong"
ks = 0.2
shininess = 3000
weight = { kind = "schlick", f0 = 0.04 }
"""
GREY = """
geometry = { kind = "sphere", center = [0, 0, 0], radius = 2.0 }
camera = { kind = "orthographic", width = 90, height = 70, extent = 3.0, position = [3, 2, 3] }
[[lights]]
kind = "parallel"
direction = [0, 1, 0.5]
intensity = 0.9
[material]
kd = 0.8
"""
SCENES = {
    "phong ball": BALL,
    "blinn mesh": MESH,
    "flat mesh": f'shading = "flat"{MESH}',
    "gouraud mesh": f'shading = "gouraud"{MESH}',
    "everything": EVERYTHING,
    "grey": GREY,
}
FIT = {
    "schema": "diffshade.fit/1",
    "coefficients": {
        "ka": [0.05, 0.04, 0.03],
        "kd": [0.4, 0.2, 0.1],
        "lobes": [
            {
                "kind": "ggx",
                "ks": 1.0,
                "alpha": 0.15,
                "masking": "height-correlated",
                "fresnel": {"kind": "dielectric", "index": 1.45},
            }
        ],
        "body": {"kind": "fresnel", "index": 1.45},
        "attenuation": {"kind": "quadratic", "c0": 0.9, "c1": 0.01, "c2": 0.02}
        | {"reference_distance": 3.5},
    },
}


def write(folder: Path, name: str) -> Path:
    """A scene, or the "fit", as a file; a mesh lies beside it."""
    if name == "fit":
        path = folder / "fit.json"
        path.write_text(json.dumps(FIT))
        return path
    (folder / "torus.obj").write_text(torus())
    path = folder / "scene.toml"
    path.write_text(SCENES[name])
    return path


def make_page(folder: Path, name: str) -> Path:
    """The page of a scene, as the command line writes it."""
    source = write(folder, name)
    assert run(["view", str(source)]) == 0
    return source.with_suffix(".html")


def torus(around: int = 24, across: int = 14) -> str:
    """A torus of coarse faces, some of which hide others."""
    lines = []
    for i in range(around):
        for j in range(across):
            u, v = 2 * math.pi * i / around, 2 * math.pi * j / across
            ring = 1 + 0.45 * math.cos(v)
            lines.append(f"v {ring * math.cos(u)} {0.45 * math.sin(v)} {-ring * math.sin(u)}")
    for i in range(around):
        for j in range(across):
            here, next_i, next_j = i * across, (i + 1) % around * across, (j + 1) % across
            a, b, c, d = here + j, next_i + j, next_i + next_j, here + next_j
            lines.append(f"f {a + 1} {b + 1} {c + 1} {d + 1}")
    return "\n".join(lines) + "\n"
