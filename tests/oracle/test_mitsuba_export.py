"""Dictionaries for Mitsuba 3, loaded and evaluated by it (the extra `compare`)."""

import json
from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from mitsuba_scalar import mitsuba

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.export.mitsuba import Blend, as_mitsuba, mitsuba_bsdf
from diffshade.export.response import Exact
from diffshade.vector import Vec3

COPPER: dict[str, Any] = {"index": (0.2, 0.92, 1.1), "extinction": (3.9, 2.45, 2.14)}
MATERIALS = {
    "phong": ds.Material(0.1, (0.5, 0.3, 0.1), (ds.Phong(0.3, 50.0), ds.Phong(0.1, 8.0))),
    "facets": ds.Material(
        kd=(0.5, 0.3, 0.1), specular=ds.GGX((0.4, 0.3, 0.2), 0.2, None, "separable")
    ),
    "copper": ds.Material(
        specular=ds.Beckmann(1.0, 0.3, ds.Conductor(**COPPER), "separable", rational=True)
    ),
    "plastic": ds.Material(
        kd=(0.3, 0.2, 0.1),
        specular=ds.GGX(1.0, 0.2, ds.Dielectric(1.49), "separable"),
        body=ds.FresnelBody(1.49),
    ),
    "schlick": ds.Material(specular=ds.GGX(0.5, 0.3, ds.Schlick(0.05))),
}
MITSUBA_HAS_IT = ("facets", "copper", "plastic")


@cache
def directions() -> tuple[np.ndarray, np.ndarray]:
    """l and v above the surface z = 0, half of the pairs about the mirror direction."""
    rng = np.random.default_rng(7)
    l, v = rng.normal(size=(2, 300, 3))
    v[:150] = l[:150] * [-1, -1, 1] + 0.2 * rng.normal(size=(150, 3))
    for d in (l, v):
        d[:, 2] = np.abs(d[:, 2]) + 0.05
        d /= np.linalg.norm(d, axis=1, keepdims=True)
    return l, v


def theirs(bsdf: dict[str, Any]) -> np.ndarray:
    mi = mitsuba()
    loaded, context, point = mi.load_dict(bsdf), mi.BSDFContext(), mi.SurfaceInteraction3f()
    found = []
    for l, v in zip(*directions(), strict=True):
        point.wi = mi.Vector3f(*v)
        found.append(np.array(loaded.eval(context, point, mi.Vector3f(*l))).ravel())
    return np.array(found)


def ours(response: Any) -> np.ndarray:
    planes = response(*(Vec3.from_array(jnp.asarray(d)) for d in directions()))
    return np.broadcast_to(np.stack(planes), (3, len(directions()[0]))).T


@pytest.mark.parametrize("name", MATERIALS)
def test_mitsuba_computes_what_is_compared(name: str) -> None:
    bsdf = json.loads(as_mitsuba(MATERIALS[name], irradiance=2.5).text)
    expected = 2.5 * theirs(bsdf)
    found = ours(Blend.read(bsdf, 2.5))
    # Of a body Mitsuba's mean reflectance from inside is a fit of a table
    assert np.abs(found - expected).max() < (1e-3 if name == "plastic" else 1e-4) * expected.max()


@pytest.mark.parametrize("name", MITSUBA_HAS_IT)
def test_what_mitsuba_has_is_exact(name: str) -> None:
    export = as_mitsuba(MATERIALS[name], irradiance=2.5)
    assert max(export.error.relative_rms) < 2e-6
    found, exact = 2.5 * theirs(json.loads(export.text)), ours(Exact(MATERIALS[name]))
    assert np.abs(found - exact).max() < 1e-3 * exact.max()


def test_phong_is_close_about_its_peak() -> None:
    export = as_mitsuba(MATERIALS["phong"])
    assert export.error.relative_rms[0] < 0.02
    assert any("power of a cosine" in note for note in export.notes)
    assert mitsuba().load_dict(mitsuba_bsdf(MATERIALS["phong"])) is not None


def test_the_irradiance_that_is_said_to_be_enough_is() -> None:
    with pytest.raises(BadInput, match="irradiance of") as refused:
        as_mitsuba(MATERIALS["facets"], irradiance=0.5)
    enough = float(str(refused.value).split("irradiance of ")[1].split()[0])
    assert theirs(mitsuba_bsdf(MATERIALS["facets"], irradiance=enough)).max() > 0
    with pytest.raises(BadInput, match="nothing to write"):
        mitsuba_bsdf(ds.Material(ka=0.5))


def test_a_ball_rendered_by_both() -> None:
    """A directional light of the irradiance in Mitsuba is one of I_p = 1 here; 64 samples a pixel."""
    mi, size, irradiance, sharp = mitsuba(), 20, 2.5, 4
    towards = np.array([0.4, 0.5, 1.0]) / np.linalg.norm([0.4, 0.5, 1.0])
    pose = mi.ScalarTransform4f().look_at(origin=[0, 0, 5], target=[0, 0, 0], up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}}
    scene = {
        "type": "scene",
        "integrator": {"type": "direct"},
        "sensor": {
            "type": "orthographic",
            "to_world": pose @ mi.ScalarTransform4f().scale([1.1, 1.1, 1]),
            "film": film,
            "sampler": {"type": "multijitter", "sample_count": 64},
        },
        "ball": {
            "type": "sphere",
            "bsdf": json.loads(as_mitsuba(MATERIALS["facets"], irradiance=irradiance).text),
        },
        "light": {
            "type": "directional",
            "direction": (-towards).tolist(),
            "irradiance": {"type": "rgb", "value": irradiance},
        },
    }
    traced = np.array(mi.render(mi.load_dict(scene)))[..., :3]
    camera = ds.OrthographicCamera(sharp * size, sharp * size, 2.2)
    light = ds.Scene(lights=ds.ParallelLight(towards))
    fine = np.asarray(ds.render(ds.gbuffer(ds.Sphere(), camera), light, MATERIALS["facets"]))
    mean = fine.reshape(size, sharp, size, sharp, 3).mean(axis=(1, 3))
    y, x = (np.mgrid[:size, :size] + 0.5 - size / 2) * 2.2 / size
    inside = (np.hypot(x, y) < 0.85) & (mean[..., 0] > 0.05)
    assert np.abs(traced[inside] / mean[inside] - 1).max() < 0.01
    assert abs(traced[inside].mean() / mean[inside].mean() - 1) < 0.001
