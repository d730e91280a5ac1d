"""Rendering in float32 against float64: a ball in perspective, under lights with attenuation."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import diffshade as ds
from benchmarks.figures import Figure
from benchmarks.figures import table as as_table
from benchmarks.scenes import Case, ours, perspective

__all__ = [
    "EXPONENTS",
    "GRADIENT",
    "IMAGE",
    "figures",
    "gbuffer_error",
    "gradient_error",
    "image_error",
    "scene",
    "slope",
    "table",
]

EXPONENTS = (1.0, 10.0, 32.0, 100.0, 200.0, 1e3, 1e5)
IMAGE = {1: 6e-7, 16: 6e-7}
"""The largest error of an image over its maximum, by lights, for exponents up to 200."""
GRADIENT = 1e-6
"""Of a gradient over its largest component."""

Shaded = tuple[ds.GBuffer, ds.Scene, ds.Material]


def image_error(lights: int, exponent: float, size: int = 512, lobe: Any = ds.Phong) -> float:
    """The largest absolute error of an image over its maximum."""
    single, double = (_image(wide, lights, exponent, size, lobe) for wide in (False, True))
    return _relative(single, double)


def gradient_error(lights: int, exponent: float, size: int = 512) -> float:
    """That of the squared error's gradient, 13 coefficients, over the largest of them."""
    observed = 0.9 * _image(True, lights, exponent, size, ds.Phong)
    single, double = (
        _gradient(wide, lights, exponent, size, observed.astype(np.float32))
        for wide in (False, True)
    )
    return _relative(single, double)


def gbuffer_error(size: int) -> float:
    """That of the points and normals of the ball, in units in the last place of 1."""
    case = Case(size=size)
    planes = []
    for wide in (False, True):
        with jax.enable_x64(wide):
            gbuffer = ds.gbuffer(ds.Sphere(), perspective(case))
            planes.append(np.stack(jax.tree.leaves((gbuffer.position, gbuffer.normal))))
    return float(np.abs(planes[0] - planes[1]).max() / np.finfo(np.float32).eps)


def scene(lights: int, exponent: float, size: int, lobe: Any) -> Shaded:
    """In the precision that JAX has now."""
    case = Case(size=size, lights=lights)
    gbuffer, scene, material = ours(case, perspective(case))
    form = lobe(material.specular[0].ks, jnp.asarray(exponent))
    return gbuffer, scene, ds.Material(material.ka, material.kd, form)


def _image(wide: bool, *what: Any) -> np.ndarray:
    with jax.enable_x64(wide):
        return np.asarray(ds.render(*scene(*what)))


def _gradient(wide: bool, lights: int, exponent: float, size: int, observed: Any) -> np.ndarray:
    with jax.enable_x64(wide):
        gbuffer, lit, material = scene(lights, exponent, size, ds.Phong)
        unknown = material, lit.lights[0].attenuation
        found = slope(unknown, gbuffer, lit, jnp.asarray(observed, float))
        return np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(found)])


@partial(jax.jit, compiler_options=ds.compiler_options())
@jax.grad
def slope(unknown: Any, gbuffer: ds.GBuffer, lit: ds.Scene, observed: jax.Array) -> jax.Array:
    material, law = unknown
    lights = tuple(ds.PointLight(x.position, x.intensity, law) for x in lit.lights)
    return ds.mean_squared_error(gbuffer, ds.Scene(lit.ambient, lights), material, observed)


def _relative(single: np.ndarray, double: np.ndarray) -> float:
    return float(np.abs(single - double).max() / np.abs(double).max())


def figures() -> Iterator[Figure]:
    """Errors, with bounds for exponents up to 200."""
    unit = "units in the last place of 1"
    yield Figure("points and normals", gbuffer_error(512), unit, most=0.5)
    for lights, bound in IMAGE.items():
        for n in EXPONENTS:
            name, bounded = f"n = {n:g}, {lights} lights", n <= 200
            yield Figure(f"image, {name}", image_error(lights, n), most=bound if bounded else None)
            yield Figure(
                f"gradient, {name}", gradient_error(lights, n), most=GRADIENT if bounded else None
            )


def table() -> str:
    """The figures, as Markdown."""
    return as_table(figures())
