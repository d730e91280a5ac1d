"""As few samples of a light with extent as a tolerance takes."""

from itertools import pairwise

import jax.numpy as jnp
from jaxtyping import Array, Float

from diffshade.arrays import ArrayLike, positive
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.distributed import AbstractEmitter
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from diffshade.shading.render import render

__all__ = ["resolved"]

SAMPLES = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
"""Along a side; each rule is judged by the next."""


def resolved(
    emitter: AbstractEmitter, gbuffer: GBuffer, material: Material, tolerance: ArrayLike
) -> AbstractEmitter:
    """The light with the fewest samples for which no pixel is off by more than `tolerance`.

    The error of a rule is its difference from the next finer one, in radiance, on the pixels of this
    G-buffer: an estimate, not a bound. It falls like a power of 1/e with the samples where a surface sees
    all of the light, and like their square where the horizon cuts it. What a sharp lobe mirrors needs
    as many samples as highlights fit into the light side by side.

    Raises `BadInput` where 24 samples along a side are not enough.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(16, 16, 2.2))
    >>> lamp = ds.RectangleLight((0, 0, 4), (1, 0, 0), (0, -1, 0), radiance=5.0)
    >>> resolved(lamp, g, ds.Material(kd=0.5), tolerance=1e-3).samples
    2
    """
    most = float(positive("tolerance")(tolerance))

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
