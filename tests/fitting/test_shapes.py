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
from fitting.degeneracies import SEEN_NOTHING, Move, say
from fitting.limits import limits
from fitting.model import held_names, model_of
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


def test_who_holds_one_index_of_a_boundary_holds_all() -> None:
    material = ds.Material(kd=0.5, specular=LOBES["ggx"], body=ds.FresnelBody(1.5))
    both = {"body.index", "specular.0.fresnel.index"}
    for name in ("body.index", "specular.fresnel.index"):
        held = held_names([name], material)
        assert held == both
        assert model_of(material, held, 3).searched == (("specular.0.alpha",),)
    apart = ds.Material(kd=0.5, specular=LOBES["ggx"], body=ds.FresnelBody(1.4))
    with pytest.raises(BadInput, match="are one number and have several values"):
        fitting.fit(images(material), GBUFFER, SCENES, material=apart, hold=["body.index"])


def test_where_a_search_begins() -> None:
    """Lobes of one type are ordered by their widths, and nothing else is; metals have their own range."""
    schlick = [ds.GGX(0.1, 0.1, ds.Schlick()) for _ in range(3)]
    model = model_of(ds.Material(kd=0.5, specular=schlick), frozenset(), 3)
    grid = limits(model, frozenset(), model.material, {}, start_given=False).grid
    alphas, f0s = grid.shapes[:, ::2], grid.shapes[:, 1::2]
    assert (np.diff(alphas, axis=1) > 0).all()
    assert len(np.unique(f0s, axis=0)) == 8
    metal = ds.Material(specular=(ds.GGX(0.1, 0.1, ds.Conductor(0.2, 3.9)), LOBES["ggx"]))
    model = model_of(metal, frozenset(), 3)
    assert [names[0] for names in model.searched] == [
        "specular.0.alpha",
        "specular.0.fresnel.index",
        "specular.0.fresnel.extinction",
        "specular.1.alpha",
        "specular.1.fresnel.index",
    ]
    box = np.exp(limits(model, frozenset(), metal, {}, start_given=False).box)
    np.testing.assert_allclose(box[:, 1], (0.05, 10))
    np.testing.assert_allclose(box[:, 4], (1.01, 5))


def test_what_trades_is_named() -> None:
    def said(moves: dict[str, float], **values: float) -> str:
        arrays = {name: np.array(value) for name, value in moves.items()}
        known = arrays | {name.replace("_", "."): np.array(x) for name, x in values.items()}
        return say(Move(arrays, dict.fromkeys(moves, 0.5), known, SEEN_NOTHING))

    widths = {"specular_0_alpha": 0.05, "specular_1_alpha": 0.3}
    trade = {"kd": 0.3, "specular.0.ks": 1.0, "specular.0.fresnel.index": -0.2, "body.index": -0.2}
    assert "F hardly varies over what is seen" in said(trade, **widths)
    lobes = {f"specular.{j}.{name}": 1.0 for j in (0, 1) for name in ("ks", "fresnel.index")}
    assert "same shape" not in said(lobes, **widths)
    same = {f"specular.{j}.{name}": 1.0 for j in (0, 1) for name in ("ks", "alpha")}
    assert "have the same shape (alpha 0.2 and 0.2)" in said(
        same, specular_0_alpha=0.2, specular_1_alpha=0.2
    )


@pytest.mark.slow
def test_one_number_is_reported_once_among_correlations() -> None:
    truth = ds.Material(kd=0.5, specular=LOBES["ggx"], body=ds.FresnelBody(1.5))
    found = fitting.fit(images(truth), GBUFFER, SCENES, material=truth, bounds=OPEN)
    names = found.correlations.names
    assert "specular.0.fresnel.index" in names
    assert "body.index" not in names
    assert found.correlations.matrix.shape == (len(names), len(names))


@pytest.mark.slow
def test_a_fitted_attenuation_is_of_point_lights_alone() -> None:
    """Spots and lights with extent keep the law that they have."""
    law = ds.QuadraticAttenuation(1.0, 0.2, 0.3)
    lamp = ds.RectangleLight((0.5, 1.0, 2.5), (1, 0, 0), (0, -0.6, 0.6), 2.0, samples=2)
    spot = ds.SpotLight((-1, 1, 2), (1, -1, -2), 0.4, 4.0, attenuation=ds.InverseSquare())
    scenes = [
        ds.Scene(lights=(ds.PointLight(place, 1.0, law), *more))
        for place, *more in (((0, 0, 2), lamp), ((1, 1, 2.5), spot), ((-1, 0.5, 4), spot))
    ]
    truth = ds.Material(kd=0.6)
    seen = [np.asarray(ds.render(GBUFFER, scene, truth)) for scene in scenes]
    found = fitting.fit(
        seen, GBUFFER, scenes, material=truth, attenuation=ds.QuadraticAttenuation, hold=["kd"]
    )
    assert found.relative_residual < 1e-3
    for name, value in {"c0": 1.0, "c1": 0.2, "c2": 0.3}.items():
        np.testing.assert_allclose(found.coefficients[f"attenuation.{name}"], value, atol=0.02)
    for scene in found.scene:
        for light in scene.lights[1:]:
            assert isinstance(light.attenuation, ds.InverseSquare)


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
