"""Random truths, as an outside check would draw them: a ball, near lights, every coefficient unknown."""

from typing import NamedTuple

import numpy as np

import diffshade as ds


class Truth(NamedTuple):
    """A material and a scene; the attenuation's constants are the same for all lights."""

    scene: ds.Scene
    material: ds.Material
    constants: tuple[float, float, float] | None


def draw(rng: np.random.Generator, light_count: int, *, attenuated: bool) -> Truth:
    """n from 2 to 400, k in (0, 1), lights in front of a unit ball at 2 to 5 radii."""
    constants = (
        (1.0, float(rng.uniform(0, 0.5)), float(rng.uniform(0, 0.3))) if attenuated else None
    )
    lights = tuple(
        ds.PointLight(
            (*rng.uniform(-1.6, 1.6, 2), rng.uniform(1.8, 4.5)),
            rng.uniform(0.5, 1.5, 3),
            None if constants is None else ds.QuadraticAttenuation(*constants),
        )
        for _ in range(light_count)
    )
    lobe = ds.Phong(
        ks=rng.uniform(0.1, 0.7, 3), shininess=float(np.exp(rng.uniform(np.log(2), np.log(400))))
    )
    material = ds.Material(ka=rng.uniform(0.02, 0.2, 3), kd=rng.uniform(0.1, 0.7, 3), specular=lobe)
    return Truth(ds.Scene(ambient=1.0, lights=lights), material, constants)
