"""Fits of microfacet lobes and bodies: every shape is searched, by its name, on a logarithmic scale."""

import json
from pathlib import Path

import jax
import numpy as np
import pytest

import diffshade as ds
import fitting
from diffshade.errors import BadInput
from diffshade.io.reflectance_tables import read_body, read_lobe
from diffshade.io.toml_document import Table
from fitting.report import _part_to_json
from fitting.shapes import boundaries, shape_names

GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(48, 48, 2.2))
SCENES = [
    ds.Scene(lights=ds.ParallelLight(direction, (1.0, 0.9, 0.8)))
    for direction in ((0.2, 0.3, 1.0), (0.8, -0.2, 0.6), (-0.9, 0.4, 0.3), (0.1, -0.9, 0.2))
]
OPEN = {"specular.ks": (0.0, None)}

LOBES = {
    "ggx": ds.GGX(0.3, 0.15, ds.Dielectric(1.5)),
    "beckmann": ds.Beckmann(0.3, 0.3, ds.Dielectric(1.5)),
    "torrance-sparrow": ds.TorranceSparrow(0.3, 0.2, ds.Dielectric(1.5)),
}


def images(truth: ds.Material) -> list[np.ndarray]:
    return [np.asarray(ds.render(GBUFFER, scene, truth)) for scene in SCENES]


def start(lobe: ds.GGX) -> ds.GGX:
    return type(lobe)(0.5, 0.5, ds.Dielectric(2.0))


@pytest.mark.slow
@pytest.mark.parametrize("name", LOBES)
def test_a_lobe_over_a_body_is_recovered(name: str) -> None:
    """Roughness and index, the one of lobe and body, and all that is linear."""
    truth = ds.Material(kd=(0.5, 0.3, 0.2), specular=LOBES[name], body=ds.FresnelBody(1.5))
    given = ds.Material(kd=0.5, specular=start(LOBES[name]), body=ds.FresnelBody(2.0))
    found = fitting.fit(images(truth), GBUFFER, SCENES, material=given, bounds=OPEN)
    assert found.converged
    assert found.unidentified == ()
    tolerance = 1e-6 if jax.config.jax_enable_x64 else 1e-2
    alpha = float(LOBES[name].alpha)
    for path, value in {
        "kd": (0.5, 0.3, 0.2),
        "specular.0.ks": 0.3,
        "specular.0.alpha": alpha,
        "specular.0.fresnel.index": 1.5,
        "body.index": 1.5,
    }.items():
        expected = np.broadcast_to(value, found.coefficients[path].shape)
        np.testing.assert_allclose(found.coefficients[path], expected, rtol=tolerance)
        assert np.isfinite(found.standard_errors[path]).all()
    assert isinstance(found.material.specular[0], type(LOBES[name]))
    assert float(found.material.body.index) == float(found.material.specular[0].fresnel.index)


@pytest.mark.slow
def test_a_lobe_over_lambert_cannot_tell_its_index() -> None:
    """F is the same wherever light from the front is mirrored: ks and the index trade, which is said."""
    scenes = [ds.Scene(lights=ds.ParallelLight(d)) for d in ((0.1, 0.2, 1.0), (-0.2, 0.1, 1.0))]
    truth = ds.Material(kd=0.4, specular=ds.GGX(0.8, 0.1, ds.Dielectric(1.5)))
    rng = np.random.default_rng(3)
    seen = [
        image + rng.normal(0, 1e-3, image.shape).astype(image.dtype)
        for image in (np.asarray(ds.render(GBUFFER, scene, truth)) for scene in scenes)
    ]

    def fitted(*hold: str) -> fitting.Fit:
        return fitting.fit(seen, GBUFFER, scenes, material=truth, bounds=OPEN, hold=hold)

    named = {name for item in fitted().unidentified for name in item.coefficients}
    assert "specular.0.fresnel.index" in named
    held = fitted("specular.fresnel.index")
    assert held.unidentified == ()
    np.testing.assert_allclose(held.coefficients["specular.0.alpha"], 0.1, rtol=2e-2)
    np.testing.assert_allclose(held.coefficients["specular.0.ks"], 0.8, rtol=2e-2)


def test_names_are_paths() -> None:
    lobes = (
        ds.Phong(0.1, 9),
        ds.GGX(0.1, 0.2, ds.Conductor(0.2, 3.9)),
        ds.GGX(0.1, 0.3, ds.Dielectric()),
    )
    material = ds.Material(kd=0.5, specular=lobes, body=ds.FresnelBody())
    assert shape_names(material) == (
        "specular.0.shininess",
        "specular.1.alpha",
        "specular.1.fresnel.index",
        "specular.1.fresnel.extinction",
        "specular.2.alpha",
        "specular.2.fresnel.index",
        "body.index",
    )
    assert boundaries(material) == ("specular.2.fresnel.index", "body.index")


@pytest.mark.slow
def test_the_comparison_finds_the_model_that_it_was() -> None:
    truth = ds.Material(kd=0.4, specular=LOBES["ggx"], body=ds.FresnelBody(1.5))
    noise = np.random.default_rng(4)
    seen = [
        image + noise.normal(0, 2e-3, image.shape).astype(image.dtype) for image in images(truth)
    ]
    models = ("phong", "lambert", "ggx", "plastic")
    rows = fitting.compare(seen, GBUFFER, SCENES, materials=models)
    assert rows[0].name == "plastic"
    assert rows[0].weight > 0.99
    with pytest.raises(BadInput, match="there is no model 'velvet': give one of phong"):
        fitting.compare(seen, GBUFFER, SCENES, materials=["velvet"])


def test_bounds_of_one_number_must_overlap() -> None:
    material = ds.Material(kd=0.5, specular=LOBES["ggx"], body=ds.FresnelBody())
    bounds = {"body.index": (1.1, 1.3), "specular.fresnel.index": (1.4, 1.6)}
    with pytest.raises(BadInput, match=r"one number, leave nothing between 1\.4 and 1\.3"):
        fitting.fit(images(material), GBUFFER, SCENES, material=material, bounds=bounds)


@pytest.mark.parametrize("name", LOBES)
def test_parts_go_to_a_document_and_back(name: str) -> None:
    for part, read in ((LOBES[name], read_lobe), (ds.FresnelBody(1.4), read_body)):
        document = _part_to_json(part, "", lambda path: _at(part, path))  # noqa: B023
        document = {k: v for k, v in json.loads(json.dumps(document)).items() if v is not None}
        again = read(Table(Path("fit.json"), "", document))
        assert jax.tree.structure(again) == jax.tree.structure(part)
        for a, b in zip(jax.tree.leaves(again), jax.tree.leaves(part), strict=True):
            assert float(a) == float(b)


def _at(part: object, path: str) -> object:
    for step in path.strip(".").split("."):
        part = getattr(part, step)
    return part
