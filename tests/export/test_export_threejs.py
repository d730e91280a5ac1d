"""three.js materials as they are written, against its shader, transliterated."""

import json
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.export.threejs import MeshPhong, as_threejs
from diffshade.vector import Vec3

MATERIALS = {
    "blinn": ds.Material(0.1, (0.5, 0.3, 0.1), ds.BlinnPhong((0.3, 0.2, 0.1), 60.0)),
    "matt": ds.Material(kd=(1.0, 0.5, 0.0)),
}


def linear(code: int) -> np.ndarray:
    """`Color.setHex`: sRGB to linear."""
    c = np.array([code >> 16 & 255, code >> 8 & 255, code & 255]) / 255
    return np.where(c < 0.04045, c * 0.0773993808, (c * 0.9478672986 + 0.0521327014) ** 2.4)


def shaded(document: dict[str, Any], l: np.ndarray, v: np.ndarray) -> np.ndarray:
    """RE_Direct_BlinnPhong of three.js for a directional light of intensity 1: [N, 3]."""
    h = (l + v) / np.linalg.norm(l + v, axis=1, keepdims=True)
    dot_nl, dot_nh = l[:, 2:], h[:, 2:]
    dot_vh = (v * h).sum(axis=1, keepdims=True)
    fresnel = np.exp2((-5.55473 * dot_vh - 6.98316) * dot_vh)
    f = linear(document["specular"]) * (1 - fresnel) + fresnel
    n = document["shininess"]
    d = (n * 0.5 + 1.0) * dot_nh**n / np.pi
    return dot_nl * (linear(document["color"]) / np.pi + f * 0.25 * d)


@pytest.mark.parametrize("name", MATERIALS)
def test_what_is_compared_is_the_shader_of_threejs(name: str, tolerance: float) -> None:
    rng = np.random.default_rng(3)
    l, v = rng.normal(size=(2, 200, 3))
    for d in (l, v):
        d[:, 2] = np.abs(d[:, 2]) + 0.02
        d /= np.linalg.norm(d, axis=1, keepdims=True)
    own = json.loads(as_threejs(MATERIALS[name], irradiance=3.5).text)
    response = MeshPhong.read(own["color"], own["specular"], own["shininess"], 3.5)
    found = np.stack(response(*(Vec3.from_array(jnp.asarray(d)) for d in (l, v)))).T
    # The constants of sRGB there have ten digits
    np.testing.assert_allclose(
        found, 3.5 * shaded(own, l, v), rtol=1e-6 + 1e3 * tolerance, atol=1e-6
    )


def test_the_document() -> None:
    export = as_threejs(MATERIALS["blinn"], "shiny")
    document = json.loads(export.text)
    assert (document["type"], document["name"]) == ("MeshPhongMaterial", "shiny")
    assert document["metadata"]["type"] == "Material"
    assert document["shininess"] == pytest.approx(60)
    assert isinstance(document["color"], int)
    assert document["userData"]["diffshade"]["coefficients"]["kd"] == [0.5, 0.3, 0.1]
    # (n + 2) / (8 pi) f0 E = ks, at E = pi, to half a code of sRGB
    np.testing.assert_allclose(linear(document["specular"]) * 62 / 8, [0.3, 0.2, 0.1], rtol=0.03)
    np.testing.assert_allclose(linear(document["color"]), [0.5, 0.3, 0.1], atol=0.005)


def test_what_eight_bits_lose_is_told() -> None:
    export = as_threejs(MATERIALS["blinn"])
    document = json.loads(export.text)
    off = np.abs(linear(document["color"]) - [0.5, 0.3, 0.1]).max()
    assert any(f"0x{document['color']:06x}: off by {off:.2g}" in note for note in export.notes)
    assert any("ambient" in note for note in export.notes)


def test_colours_above_1_are_refused() -> None:
    with pytest.raises(BadInput, match=r"color would be above 1.*irradiance of 4\.403"):
        as_threejs(ds.Material(kd=1.4))
