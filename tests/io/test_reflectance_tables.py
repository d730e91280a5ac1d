"""Microfacets, boundaries and bodies in a `scene.toml`."""

from pathlib import Path

import numpy as np
import pytest
from test_scene_toml import read

import diffshade as ds
from diffshade.errors import BadInput

PHONG = 'kind      = "phong"\nks        = 0.5\nshininess = 20'
KD = "kd = [0.6, 0.3, 0.2]"

GGX = 'kind = "ggx"\nks = 1.0\nalpha = 0.2\n'


def test_a_coated_material(tmp_path: Path) -> None:
    lobe = GGX + 'masking = "separable"\nfresnel = { kind = "dielectric", index = 1.4 }'
    body = KD + '\nbody = { kind = "fresnel", index = [1.4, 1.5, 1.6] }'
    material = read(tmp_path, (PHONG, lobe), (KD, body)).material
    (found,) = material.specular
    assert isinstance(found, ds.GGX)
    assert found.masking == "separable"
    assert isinstance(found.fresnel, ds.Dielectric)
    np.testing.assert_allclose(found.fresnel.index, 1.4)
    np.testing.assert_allclose(material.body.index, (1.4, 1.5, 1.6))


@pytest.mark.parametrize(
    ("fresnel", "kind"),
    [
        ('{ kind = "conductor", index = [0.2, 0.9, 1.1], extinction = 3.9 }', ds.Conductor),
        ('{ kind = "schlick", f0 = 0.04 }', ds.Schlick),
    ],
)
def test_other_boundaries(fresnel: str, kind: type, tmp_path: Path) -> None:
    lobe = f'kind = "beckmann"\nks = 1.0\nalpha = 0.2\nrational = true\nfresnel = {fresnel}'
    (found,) = read(tmp_path, (PHONG, lobe)).material.specular
    assert isinstance(found, ds.Beckmann)
    assert found.rational
    assert isinstance(found.fresnel, kind)


def test_a_weight(tmp_path: Path) -> None:
    (found,) = read(
        tmp_path, (PHONG, PHONG + '\nweight = { kind = "schlick", f0 = 0.04 }')
    ).material.specular
    assert isinstance(found.weight, ds.Schlick)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        (PHONG, GGX + "shininess = 20", 'lobe 1: unknown key "shininess"; the keys here are kind'),
        (PHONG, GGX.replace("0.2", "0"), "lobe 1: alpha is 0; give a number above 0"),
        (PHONG, 'kind = "ggx"\nks = 1', 'lobe 1: the key "alpha" is missing'),
        (PHONG, 'kind = "velvet"', "lobe 1: kind is 'velvet'; give one of \"phong\""),
        (PHONG, GGX + 'masking = "none"', "masking is 'none'; give one of \"height-correlated\""),
        (
            PHONG,
            GGX.replace("ggx", "torrance_sparrow") + 'masking = "separable"',
            "masking is 'separable': facets in grooves have 'v-groove'",
        ),
        (
            PHONG,
            GGX.replace("ggx", "beckmann") + "rational = 1",
            "rational is 1; give true or false",
        ),
        (PHONG, GGX + "fresnel = 1.5", "fresnel is 1.5; give a table"),
        (PHONG, GGX + "fresnel = {}", 'lobe 1, fresnel: the key "kind" is missing'),
        (
            PHONG,
            GGX + 'fresnel = { kind = "dielectric", index = -1 }',
            "lobe 1, fresnel: index is -1; give a number above 0",
        ),
        (
            PHONG,
            GGX + 'fresnel = { kind = "dielectric", index = [1.4, 1.5] }',
            "index has 2 numbers",
        ),
        (KD, KD + "\nbody = { index = 1.5 }", 'body: the key "kind" is missing'),
        (KD, 'body = { kind = "fresnel", index = 1.5 }', "a body is given without kd"),
    ],
)
def test_what_is_wrong_is_said(old: str, new: str, complaint: str, tmp_path: Path) -> None:
    with pytest.raises(BadInput) as refused:
        read(tmp_path, (old, new))
    assert complaint in str(refused.value)
    assert "\n" not in str(refused.value)
    assert str(refused.value).startswith(str(tmp_path / "scene.toml"))
