"""Gradient checks validate the equations: forward = reverse = finite differences, for every input.

The function differentiated is `render` itself, of a few surface points at a time: coefficients,
shininess, attenuation, light position and intensity, positions and normals are all inputs.
"""

from itertools import product

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradients import check_gradients, dead_inputs
from registry import FREQUENCIES, LIGHTS, LOBES, SHININESS

import diffshade as ds
from diffshade.light.base import AbstractLight
from diffshade.vector import Vec3

pytestmark = [pytest.mark.float64, pytest.mark.slow]

POSITION = np.array([0.05, -0.1, 0.2])
"""The surface point; the lights of the registry lie up and to the right, in front."""

NORMALS = {
    "normal": (0.25, 0.3, 0.9),
    "grazing": (0.97, -0.45, -0.03),
    "back-facing": (-0.5, -0.4, -0.75),
}
"""Facing the light, almost along the terminator on its lit side, and away from it."""

EYE = np.array([-0.6, 0.2, 3.0])


def shade(inputs):  # type: ignore[no-untyped-def]
    """The radiance of one point, by `render`, of everything that is continuous."""
    position, normal, light, material, eye = inputs
    gbuffer = ds.GBuffer.from_arrays(
        position[None, None], normal[None, None], np.ones((1, 1), bool), eye=eye
    )
    return ds.render(gbuffer, ds.Scene(ambient=jnp.array([0.3, 0.2, 0.1]), lights=light), material)


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("lobe", LOBES)
def test_every_input(lobe: str, light: str) -> None:
    source = LIGHTS[light]
    names, cases, steps = [], [], []
    for (label, n), (where, normal) in product(SHININESS.items(), NORMALS.items()):
        material = ds.Material(
            ka=(0.2, 0.3, 0.1),
            kd=(0.6, 0.4, 0.5),
            specular=LOBES[lobe](ks=(0.5, 0.3, 0.4), shininess=n),
        )
        if n == 400.0 and where == "normal":
            normal = mirror_normal(source) + np.array([0.02, -0.03, 0.01])
        names.append((label, where))
        cases.append((POSITION, np.asarray(normal, float), source, material, EYE))
        # A lobe so narrow bends within a thousandth of a unit.
        steps.append(1e-4 if n == 400.0 else 1e-3)

    for (label, where), largest in zip(
        names, check_gradients(shade, cases, steps=steps), strict=True
    ):
        dead = dead_inputs(largest)
        if where == "back-facing":
            # Nothing is left but the ambient term, and nothing but k_a moves it.
            alive = [leaf for leaf in jax.tree.leaves(largest) if np.any(np.asarray(leaf) > 0)]
            assert len(alive) == 1
            assert np.all(np.asarray(largest[3].ka) > 0)
        elif where == "grazing":
            # The lobe may be out of sight; the diffuse term is not, and depends on all of these.
            lit = (largest[1], largest[2].intensity, largest[3].kd)
            assert all(np.all(np.asarray(leaf) > 0) for leaf in lit), f"{label}: dark at grazing"
        elif where == "normal":
            clamped = [name for name in dead if "attenuation" in name] if "clamped" in light else []
            assert dead == clamped, f"{label}: nothing depends on {dead}"


def mirror_normal(light: AbstractLight) -> np.ndarray:
    """The normal at which the mirror direction of a light points to the eye."""
    l = np.asarray(light.incidence(Vec3(*map(jnp.asarray, POSITION))).l.to_array())
    v = (EYE - POSITION) / np.linalg.norm(EYE - POSITION)
    return (l + v) / np.linalg.norm(l + v)


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_vertices_of_a_mesh(frequency: str) -> None:
    vertices = jnp.array([[-1.0, -1.0, 0.1], [1.2, -0.9, 0.0], [0.9, 1.1, 0.2], [-1.0, 0.8, -0.1]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    camera = ds.OrthographicCamera(5, 5, 1.5)
    seen = ds.visibility(ds.Mesh(vertices, faces), camera)
    light = ds.PointLight((0.5, 0.4, 2.0), (0.9, 0.8, 0.7), ds.QuadraticAttenuation(0.9, 0.1, 0.05))
    material = ds.Material(kd=(0.6, 0.4, 0.5), specular=ds.Phong(ks=0.5, shininess=12.0))

    def image(inputs):  # type: ignore[no-untyped-def]
        vertices, light = inputs
        gbuffer = ds.gbuffer(ds.Mesh(vertices, faces), camera, seen, shading=FREQUENCIES[frequency])
        return ds.render(gbuffer, ds.Scene(lights=light), material)

    (largest,) = check_gradients(image, [(vertices, light)])
    assert dead_inputs(largest) == []


def test_sphere_and_camera() -> None:
    sphere = ds.Sphere((0.1, -0.05, 0.2), 0.9)
    camera = ds.PerspectiveCamera(5, 5, 0.5, position=(0.3, 0.2, 5.0), target=(0.1, 0.0, 0.0))
    seen = ds.visibility(sphere, camera)
    # The outline, where the depth has no derivative, is left out.
    inner = eqx.tree_at(lambda s: s.index, seen, jnp.asarray([6, 7, 8, 11, 12, 13, 16, 17, 18]))
    scene = ds.Scene(lights=ds.PointLight((1.0, 2.0, 3.0), 0.9, ds.InverseSquare()))
    material = ds.Material(kd=0.6, specular=ds.Phong(ks=0.5, shininess=9.0))

    def image(inputs):  # type: ignore[no-untyped-def]
        sphere, camera = inputs
        return ds.render(ds.gbuffer(sphere, camera, inner), scene, material)

    (largest,) = check_gradients(image, [(sphere, camera)])
    assert dead_inputs(largest) == []


def test_object_colours_and_maps() -> None:
    gbuffer = ds.GBuffer.from_arrays(None, np.tile([0.1, 0.2, 0.9], (2, 2, 1)))
    scene = ds.Scene(ambient=0.4, lights=ds.ParallelLight((0.2, 0.1, 0.9), (0.7, 0.8, 0.9)))
    material = ds.Material(
        ka=jnp.full((1, 4), 0.2),
        kd=jnp.array([[0.1, 0.2, 0.3, 0.4]]),
        specular=ds.Phong(ks=0.5, shininess=jnp.array([[1.0, 5.0, 9.0, 20.0]])),
        od=(0.9, 0.8, 0.7),
        os=(0.5, 0.6, 0.7),
    )
    (largest,) = check_gradients(lambda m: ds.render(gbuffer, scene, m), [material])
    assert dead_inputs(largest) == []


def test_composes_with_jit_vmap_scan_and_hessian() -> None:
    gbuffer = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.4))
    scene = ds.Scene(lights=ds.PointLight((1.0, 2.0, 3.0), 0.9))

    def total(n: jax.Array) -> jax.Array:
        return ds.render(gbuffer, scene, ds.Material(kd=0.5, specular=ds.Phong(0.4, n))).sum()

    exponents = jnp.array([0.7, 3.0, 40.0])
    one_by_one = jnp.stack([total(n) for n in exponents])
    np.testing.assert_allclose(jax.vmap(total)(exponents), one_by_one, rtol=1e-13)
    scanned = jax.lax.scan(lambda c, n: (c, total(n)), 0.0, exponents)[1]
    np.testing.assert_allclose(scanned, one_by_one, rtol=1e-13)
    second = jax.vmap(jax.grad(jax.grad(total)))(exponents)
    np.testing.assert_allclose(jax.jit(jax.vmap(jax.hessian(total)))(exponents), second, rtol=1e-9)
    assert np.all(second > 0)  # the sum of x^n is convex in n
