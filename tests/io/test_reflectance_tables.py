"""Microfacets, boundaries and bodies in a `scene.toml`."""

from pathlib import Path

import equinox as eqx
import numpy as np
import pytest
from test_scene_toml import read

import diffshade as ds
from diffshade.cli import run
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
    ("table", "expected"),
    [
        ('{ kind = "interpolated", kt = 0.3 }', ds.InterpolatedTransparency(0.3)),
        ('{ kind = "filtered", kt = [0.5, 1, 0] }', ds.FilteredTransparency((0.5, 1, 0))),
        (
            '{ kind = "filtered", kt = 0.9, colour = [1, 0.6, 0.3] }',
            ds.FilteredTransparency(0.9, (1, 0.6, 0.3)),
        ),
    ],
)
def test_the_far_side_through_the_near_one(table: str, expected: object, tmp_path: Path) -> None:
    """By `diffshade render`: what the two sides of the sphere add up to, before black."""
    file = read(tmp_path, (KD, f"{KD}\ntransparency = {table}"))
    assert eqx.tree_equal(file.transparency, expected)
    out = tmp_path / "image.npy"
    assert run(["render", str(tmp_path / "scene.toml"), "--out", str(out)]) == 0
    near, far = (g for (g,) in file.layers(tmp_path / "scene.toml"))
    front, behind = (np.asarray(ds.render(g, file.scene, file.material)) for g in (near, far))
    a, b = map(np.asarray, expected.shares())
    image = np.load(out)
    assert image.max() > 0.3
    np.testing.assert_allclose(image, a * front + b * a * behind, atol=1e-5)
    plain = read(tmp_path)
    assert plain.transparency is None
    assert len(plain.layers(tmp_path / "scene.toml")) == 1


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        (PHONG, GGX + "shininess = 20", 'lobe 1: unknown key "shininess"; the keys here are kind'),
        (PHONG, GGX.replace("0.2", "0"), "lobe 1: alpha is 0; give a number above 0"),
        (PHONG, 'kind = "ggx"\nks = 1', 'lobe 1: the key "alpha" is missing'),
        (
            KD,
            f'{KD}\ntransparency = {{ kind = "glass" }}',
            "transparency: kind is 'glass'; give one of",
        ),
        (
            KD,
            f'{KD}\ntransparency = {{ kind = "interpolated", kt = 1.5 }}',
            "material, transparency: kt is 1.5: give a part of the light, 0 to 1",
        ),
        (
            KD,
            f'{KD}\ntransparency = {{ kind = "interpolated", kt = 1, colour = 1 }}',
            'transparency: unknown key "colour"',
        ),
        (
            KD,
            f'{KD}\ntransparency = {{ kind = "filtered", kt = [1, 1] }}',
            "kt has 2 numbers; give one number, or one for each channel",
        ),
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


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (("ambient ", 'shading = "flat"\nambient '), "is shaded once a pixel; leave out shading"),
        (("ambient ", "shadows = true\nambient "), "casts no full shadow; leave out shadows"),
        (
            (
                'kind = "sphere", center = [0, 0.1, 0], radius = 1.0',
                'kind = "normals", file = "n.npz"',
            ),
            "transparency: a map of normals has nothing behind it",
        ),
    ],
)
def test_what_has_no_layers(change: tuple[str, str], complaint: str, tmp_path: Path) -> None:
    up = np.tile([0.0, 0.0, 1.0], (20, 24, 1))
    np.savez(tmp_path / "n.npz", normal=up, position=up)
    see_through = KD + '\ntransparency = { kind = "interpolated", kt = 0.5 }'
    with pytest.raises(BadInput, match=complaint):
        read(tmp_path, (KD, see_through), change)
