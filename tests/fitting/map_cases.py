"""A surface, lights and random maps of materials, for the tests of maps."""

from collections.abc import Sequence

import numpy as np

import diffshade as ds

SIZE = 40
GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(SIZE, SIZE, 2.2))
PIXELS = GBUFFER.pixel_count
KD, KS, N = "kd", "specular.0.ks", "specular.0.shininess"


def directions(count: int, rng: np.random.Generator) -> np.ndarray:
    """Towards lights spread over the hemisphere in front."""
    z, turn = rng.uniform(0.25, 1, count), rng.uniform(0, 2 * np.pi, count)
    side = np.sqrt(1 - z**2)
    return np.stack([side * np.cos(turn), side * np.sin(turn), z], -1)


def scenes(count: int = 24, seed: int = 0) -> list[ds.Scene]:
    rng = np.random.default_rng(seed)
    return [ds.Scene(lights=ds.ParallelLight(d)) for d in directions(count, rng)]


def truth(rng: np.random.Generator, channels: int = 1, lobe: type = ds.Phong) -> ds.Material:
    """Random maps."""
    shape = channels, PIXELS
    return ds.Material(
        kd=rng.uniform(0.1, 0.9, shape),
        specular=lobe(
            ks=np.exp(rng.uniform(np.log(0.05), np.log(0.9), shape)),
            shininess=np.exp(rng.uniform(np.log(2), np.log(100), (1, PIXELS))),
        ),
    )


def rendered(lit: Sequence[ds.Scene], material: ds.Material) -> list[np.ndarray]:
    return [np.asarray(ds.render(GBUFFER, scene, material)) for scene in lit]
