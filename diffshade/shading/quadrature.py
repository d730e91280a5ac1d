"""As few samples of a light with extent, or degrees of an environment, as a tolerance takes."""

from itertools import pairwise
from math import pi
from typing import TypeVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diffshade.arrays import ArrayLike, positive
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.distributed import AbstractEmitter
from diffshade.light.environment import COSINE, EnvironmentLight
from diffshade.reflectance.material import Material
from diffshade.reflectance.phong import Phong, blurred
from diffshade.scene import Scene
from diffshade.shading.cull import largest
from diffshade.shading.prefiltered import refuse
from diffshade.shading.render import render

__all__ = ["resolved"]

SAMPLES = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
"""Along a side; each rule is judged by the next."""


L = TypeVar("L", AbstractEmitter, EnvironmentLight)


def resolved(emitter: L, gbuffer: GBuffer, material: Material, tolerance: ArrayLike) -> L:
    """The light with the fewest samples for which no pixel is off by more than `tolerance`.

    An environment: up to the lowest order for which none is, of what its harmonics hold. A lobe of
    shininess n tells little of the degrees beyond sqrt(2 n log(1 / tolerance)). By Cauchy's inequality
    what is left out is at most the sum of a_l |L_l| sqrt((2 l + 1) / 4 pi), |L_l| the norm of the
    coefficients of a degree: a bound, on any surface.

    Of a light with extent the error of a rule is its difference from the next finer one, in radiance,
    on the pixels of this G-buffer: an estimate, not a bound. It falls like a power of 1/e with the
    samples where a surface sees all of the light, and like their square where the horizon cuts it. What
    a sharp lobe mirrors needs as many samples as highlights fit into the light side by side.

    Raises `BadInput` where 24 samples along a side are not enough.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(16, 16, 2.2))
    >>> lamp = ds.RectangleLight((0, 0, 4), (1, 0, 0), (0, -1, 0), radiance=5.0)
    >>> resolved(lamp, g, ds.Material(kd=0.5), tolerance=1e-3).samples
    2
    """
    most = float(positive("tolerance")(tolerance))
    if isinstance(emitter, EnvironmentLight):
        return emitter.truncated(_lowest_order(emitter, material, most))

    def image(samples: int) -> Float[Array, "H W C"]:
        elements = emitter.with_samples(samples).elements()
        return render(gbuffer, Scene(lights=elements), material)

    coarse, error = image(SAMPLES[0]), float("inf")
    for samples, finer in pairwise(SAMPLES):
        fine = image(finer)
        error = float(jnp.abs(fine - coarse).max(initial=0))
        if error <= most:
            return emitter.with_samples(samples)
        coarse = fine
    raise BadInput(
        f"the light is off by {error:.2g} with {SAMPLES[-2]} samples along a side, more than the"
        f" tolerance of {most:g}: give a larger tolerance, or samples of your own"
    )


def _lowest_order(light: EnvironmentLight, material: Material, most: float) -> int:
    """The order beyond which all degrees together add at most so much."""
    if material.body is not None:
        refuse(material.body)
    reflected = np.zeros((light.order + 1, 1))
    for l, a in enumerate(COSINE[: light.order + 1]):
        reflected[l] += np.max(largest(material.kd, material.od)) * a
    for lobe in material.specular:
        if not isinstance(lobe, Phong) or lobe.weight is not None:
            refuse(lobe)
        factors = [np.max(np.abs(a)) for a in blurred(lobe.shininess, light.order)]
        reflected += np.max(largest(lobe.ks, material.os)) * np.array(factors)[:, None]
    squares = np.asarray(light.harmonics, float).reshape(len(light.harmonics), -1) ** 2
    starts = np.arange(light.order + 1) ** 2
    norms = np.sqrt(
        np.add.reduceat(squares, starts) * ((2 * np.sqrt(starts) + 1) / (4 * pi))[:, None]
    )
    arriving = norms * np.abs(np.asarray(light.intensity, float))
    beyond = np.cumsum((arriving * reflected)[::-1], axis=0)[::-1].max(axis=1)
    return int(np.argmax(np.append(beyond[1:], 0) <= most))
