"""Every lobe, boundary and body there is, in every format: written, or refused in one line."""

import json
from typing import Any

import numpy as np
import pytest

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.export.gltf import as_gltf
from diffshade.export.mitsuba import as_mitsuba
from diffshade.export.mtl import as_mtl
from diffshade.export.threejs import as_threejs

FORMATS = {"mtl": as_mtl, "gltf": as_gltf, "threejs": as_threejs, "mitsuba": as_mitsuba}
COPPER: dict[str, Any] = {"index": (0.2, 0.92, 1.1), "extinction": (3.9, 2.45, 2.14)}
BOUNDARIES = (None, ds.Dielectric(1.3), ds.Conductor(**COPPER), ds.Schlick((0.02, 0.04, 0.06)))
MATERIALS = {
    "three lobes": ds.Material(
        0.1,
        0.2,
        (
            ds.Phong(0.3, (9.0, 10.0, 11.0)),
            ds.BlinnPhong(0.0, 0.0),
            ds.GGX(0.1, 0.4, BOUNDARIES[1]),
        ),
    ),
    "weighed": ds.Material(specular=ds.BlinnPhong((0.1, 0.2, 0.3), 40.0, ds.Schlick())),
    "grooves": ds.Material(kd=1e-30, specular=ds.TorranceSparrow(0.2, 0.2, BOUNDARIES[2])),
    "wide": ds.Material(kd=0.1, specular=ds.Beckmann(0.2, 3.0, BOUNDARIES[3]), od=(1, 0.5, 0)),
    "thin body": ds.Material(kd=0.1, body=ds.FresnelBody(0.8)),
    "black": ds.Material(kd=0.0, specular=ds.Phong(0.0, 5.0)),
}


@pytest.mark.parametrize("to", FORMATS)
def test_any_material_is_written_with_a_finite_error(to: str) -> None:
    for name, material in MATERIALS.items():
        export = FORMATS[to](material)
        assert np.isfinite(export.error).all(), name
        assert all(len(note.splitlines()) == 1 for note in export.notes)
        if to != "mtl":
            json.loads(export.text, parse_constant=lambda constant: pytest.fail(constant))


@pytest.mark.parametrize("to", FORMATS)
@pytest.mark.parametrize(
    ("material", "told"),
    [
        (ds.Material(kd=0.1, specular=ds.GGX(0.1, 1e-5)), "that of a mirror"),
        (ds.Material(kd=np.ones((3, 5))), "one material at a time"),
    ],
)
def test_what_no_tool_has_is_refused(to: str, material: ds.Material, told: str) -> None:
    with pytest.raises(BadInput, match=told):
        FORMATS[to](material)


def test_what_is_told_of_what_was_lost() -> None:
    weighed, many = (as_gltf(MATERIALS[name]).notes for name in ("weighed", "three lobes"))
    assert any("weight of the angle of incidence" in note for note in weighed)
    assert any("exponent is 9, 10, 11" in note for note in many)
    assert any("3 lobes are written as one" in note for note in many)
    assert any("torrance_sparrow" in note for note in as_mitsuba(MATERIALS["grooves"]).notes)
    thin = as_gltf(MATERIALS["thin body"]).notes
    assert any("body" in note for note in thin)
