"""Our own shading in the form of the rivals: from planes to planes."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import diffshade as ds
from diffshade.geometry.viewer import Eye
from diffshade.shading.image import image_planes
from diffshade.shading.kept_geometry import KeptGeometry
from diffshade.vector import Vec3

__all__ = ["forward", "gradient", "more", "prepared"]


def prepared(
    points: np.ndarray, normals: np.ndarray, eye: np.ndarray, scene: dict[str, Any]
) -> tuple[ds.GBuffer, ds.Scene, ds.Material]:
    """G-buffer, scene and material: the foreground is an image of one row."""
    gbuffer = ds.GBuffer(
        shape=(1, points.shape[1]),
        normal=Vec3(*(jnp.asarray(x) for x in normals)),
        viewer=Eye(np.asarray(eye, np.float32)),
        position=Vec3(*(jnp.asarray(x) for x in points)),
    )
    constants = scene["constants"]
    law = None if constants is None else ds.QuadraticAttenuation(*constants)
    lights = tuple(
        ds.PointLight(position, intensity, law)
        for position, intensity in zip(
            np.asarray(scene["positions"]).tolist(),
            np.asarray(scene["intensities"]).tolist(),
            strict=True,
        )
    )
    lobe = ds.Phong(ks=scene["ks"], shininess=scene["shininess"])
    material = ds.Material(ka=scene["ka"], kd=scene["kd"], specular=lobe)
    return gbuffer, ds.Scene(scene["ambient"], lights), material


def forward(
    points: np.ndarray, normals: np.ndarray, eye: np.ndarray, scene: dict[str, Any]
) -> Callable[[], Any]:
    """The image's planes: what `render` compiles, without the placing into an image."""
    gbuffer, lit, material = prepared(points, normals, eye, scene)
    surface = KeptGeometry(gbuffer, None)
    shade = jax.jit(
        lambda *a: image_planes(*a, plain=False), compiler_options=ds.compiler_options()
    )
    return lambda: jax.block_until_ready(shade(surface, lit, material))


def gradient(
    points: np.ndarray,
    normals: np.ndarray,
    eye: np.ndarray,
    scene: dict[str, Any],
    target: np.ndarray,
) -> Callable[[], tuple[float, np.ndarray]]:
    """The loss and its 13 derivatives."""
    gbuffer, lit, material = prepared(points, normals, eye, scene)
    step = _step(gbuffer, lit, material, target, {"material", "law"})

    def call() -> tuple[float, np.ndarray]:
        value, by = step()
        by_material, by_law = by["material"], by["law"]
        by_law = ds.QuadraticAttenuation(0.0, 0.0, 0.0) if by_law is None else by_law
        lobe = by_material.specular[0]
        parts = (by_material.ka, by_material.kd, lobe.ks, lobe.shininess[None])
        constants = np.array([by_law.c0, by_law.c1, by_law.c2])
        return float(value), np.concatenate([*parts, constants])

    return call


def more(
    points: np.ndarray,
    normals: np.ndarray,
    eye: np.ndarray,
    scene: dict[str, Any],
    target: np.ndarray,
) -> dict[str, Callable[[], Any]]:
    """The same with the geometry kept, and gradients of more than the coefficients."""
    gbuffer, lit, material = prepared(points, normals, eye, scene)
    kept = ds.keep_geometry(gbuffer, lit, material)
    coefficients = {"material", "law"}
    return {
        "gradient, geometry kept": _step(kept, lit, material, target, coefficients),
        "gradient, and of colours": _step(
            gbuffer, lit, material, target, coefficients | {"intensities"}
        ),
        "gradient, and of colours and positions": _step(
            gbuffer, lit, material, target, coefficients | {"intensities", "positions"}
        ),
        "gradient of everything": _step(
            gbuffer, lit, material, target, coefficients | {"intensities", "positions", "surface"}
        ),
    }


def _step(
    surface: ds.GBuffer | ds.KeptGeometry,
    lit: ds.Scene,
    material: ds.Material,
    target: np.ndarray,
    moving: set[str],
) -> Callable[[], tuple[jax.Array, dict[str, Any]]]:
    """The loss and its derivatives in what is named."""
    every: dict[str, Any] = {
        "material": material,
        "law": lit.lights[0].attenuation,
        "intensities": [x.intensity for x in lit.lights],
        "positions": [x.position for x in lit.lights],
        "surface": surface,
        "ambient": lit.ambient,
        "observed": jnp.asarray(target),
    }

    def loss(moved: dict[str, Any], held: dict[str, Any]) -> jax.Array:
        x = moved | held
        lights = tuple(
            ds.PointLight(position, intensity, x["law"])
            for position, intensity in zip(x["positions"], x["intensities"], strict=True)
        )
        under = ds.Scene(x["ambient"], lights)
        return ds.mean_squared_error(x["surface"], under, x["material"], x["observed"])

    step = jax.jit(jax.value_and_grad(loss, allow_int=True), compiler_options=ds.compiler_options())
    moved = {name: every[name] for name in every if name in moving}
    held = {name: every[name] for name in every if name not in moving}
    return lambda: jax.block_until_ready(step(moved, held))
