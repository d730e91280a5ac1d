"""Light from all around: an environment, in spherical harmonics (Ramamoorthi and Hanrahan 2001).

The radiance L(w) that arrives from the direction w is sum over l, m of L_lm Y_lm(w), to an order. What a
surface makes of it needs no ray: a matt one sends E(n) on, a smooth function of the normal, which nine
coefficients tell to about a hundredth; a shiny one mirrors L, blurred by its lobe.
"""

from dataclasses import replace
from functools import reduce
from math import pi, sqrt
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from diffshade.arrays import ArrayLike, floats
from diffshade.channels import Channels, channels, per_channel, plus, times
from diffshade.errors import BadInput
from diffshade.harmonics import bands, each_harmonic, order_of
from diffshade.light.base import AbstractLight, share
from diffshade.light.parallel import ParallelLight
from diffshade.vector import Vec3

__all__ = ["EnvironmentLight"]

COSINE = (pi, 2 * pi / 3, pi / 4)
"""A_l of max(0, cos): pi, 2 pi / 3, pi / 4, 0, -pi / 24, ... (2001, equation 8)."""
LOWEST = (
    (sqrt(1 / (4 * pi)),),
    (sqrt(3 / (4 * pi)),) * 3,
    tuple(sqrt(15 / (4 * pi)) * part for part in (1, 1, sqrt(1 / 12), 1, 0.5)),
)
"""What stands before 1; y, z, x; xy, yz, 3 z^2 - 1, xz, x^2 - y^2 in Y_lm (2001, equation 3)."""


class EnvironmentLight(AbstractLight):
    """The radiance L(w) that arrives from each direction w, to infinity, whatever the position.

    `harmonics` are its coefficients L_lm, [(order + 1)^2] or [(order + 1)^2, C], in the order (0, 0),
    (1, -1), (1, 0), (1, 1), (2, -2), ... of `diffshade.harmonics`, which are real, without the sign of
    Condon and Shortley, about the world's z; L is in the unit of the image. `intensity` is a factor on
    it, one number or one a channel.

    A matt surface shows k_d E(n), k_d being the plain coefficient: an albedo rho has k_d = rho / pi.

        E(n) = integral of L(w) max(0, n.w) dw  =  sum over l <= 2 of A_l sum over m of L_lm Y_lm(n)

    with A_l = pi, 2 pi / 3, pi / 4. What higher degrees would add is at most 3/32 of the integral of L,
    under one far lamp and square to it; of photographed rooms and skies it is 1 % on the average and 3
    % at most (2001). E may be a little below 0. A Phong lobe shows the integral of L(w) max(0, r.w)^n,
    r where the viewer is mirrored to (`Phong.filtered`), of all degrees. The gate n.w > 0 of other
    lights is dropped, as in every pre-filtered map: light from below the horizon shows at grazing
    angles. On a ball under a sky that is 2, 0.5 and 0.3 % of the brightest for n = 5, 20 and 80 on the
    average, and at the very rim a third, a fifth and a tenth. Other lobes, weighted lobes and bodies
    have no such form and are refused: light them by `as_lights`. How high a degree a lobe can tell,
    `ds.resolved` says. `visible` is a factor on both terms, as ambient occlusion is; shadows by rays
    are cast by the `as_lights`.

    Nothing is lit where a normal is zero; elsewhere smooth. Raises `BadInput` for harmonics of another
    number.

    >>> EnvironmentLight([1.0, 0.0, 0.4, 0.0]).order
    1
    """

    harmonics: Float[Array, "..."] = eqx.field(converter=floats("the environment's harmonics"))  # type: ignore[misc]
    intensity: Float[Array, "..."] = eqx.field(
        converter=floats("the environment's intensity"), default=1.0
    )
    visible: Float[Array, "..."] | None = eqx.field(converter=share, default=None, kw_only=True)

    def __check_init__(self) -> None:
        shape = self.harmonics.shape
        if len(shape) not in (1, 2) or order_of(shape[0]) is None or 0 in shape:
            raise BadInput(
                f"the environment's harmonics have shape {shape}: give [(order + 1)^2] or"
                " [(order + 1)^2, C] numbers, as 9 of order 2"
            )
        if len(shape) == 2:
            per_channel((None,) * max(self.intensity.size, 1), shape[1])

    @classmethod
    def from_image(cls, image: ArrayLike, order: int) -> "EnvironmentLight":
        """From a latitude-longitude image of all directions, [H, W] or [H, W, C], linear radiance.

        The top row looks up, along y, and the bottom row down. The middle column looks where a camera
        looks, along -z; from there the columns go round by x, a quarter of the width to the right, and
        meet behind the camera at +z. (Images of OpenEXR have +z in the middle: roll them by W / 2.)
        The harmonics are sums over the pixels, with the solid angle of each; derivatives reach the image.

        Raises `BadInput` for an image that has fewer than order + 1 rows, or 2 (order + 1) columns.

        >>> sky = np.ones((8, 16))
        >>> EnvironmentLight.from_image(sky, order=2).harmonics.shape
        (9,)
        """
        picture = floats("the environment's image")(image)
        if not isinstance(order, int | np.integer) or isinstance(order, bool) or order < 0:
            raise BadInput(f"order is {order!r}: give a whole number of at least 0")
        if picture.ndim not in (2, 3) or 0 in picture.shape:
            raise BadInput(
                f"the environment's image has shape {picture.shape}: give [H, W] or [H, W, C]"
            )
        height, width = picture.shape[:2]
        if order >= min(height, width // 2):
            raise BadInput(
                f"the environment's image is {width} x {height} pixels, too few for order {order}: give"
                f" a lower order, or an image of at least {2 * order + 2} x {order + 1}"
            )
        return cls(harmonics=_projected(picture, int(order)), intensity=jnp.ones((), picture.dtype))

    @property
    def order(self) -> int:
        """The highest degree l."""
        order = order_of(self.harmonics.shape[0])
        assert order is not None
        return order

    def truncated(self, order: int) -> "EnvironmentLight":
        """The same light up to an order."""
        return replace(self, harmonics=self.harmonics[: (order + 1) ** 2])

    def radiance(self, direction: ArrayLike) -> Float[Array, "... C"]:
        """L(w) [..., C or 1] in unit directions w [..., 3], times the intensity: as a background."""
        w = Vec3.from_array(floats("the direction")(direction))
        planes = reduce(plus, self.seen_in(w))
        return jnp.stack(times(planes, channels(self.intensity)), axis=-1)

    def irradiance(self, n: Vec3) -> Channels:
        """E(n) of an intensity of 1, from the degrees up to 2 that there are (2001, equation 11)."""
        x, y, z = n.x, n.y, n.z
        shapes: list[tuple[Any, ...]] = [(jnp.ones_like(x),)]
        if self.order >= 1:
            shapes.append((y, z, x))
        if self.order >= 2:
            shapes.append((x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y))
        weighed = [
            (a * factor, shape)
            for a, factors, degree in zip(COSINE, LOWEST, shapes, strict=False)
            for factor, shape in zip(factors, degree, strict=True)
        ]
        return tuple(
            reduce(jnp.add, (a * c * y for (a, y), c in zip(weighed, channel, strict=True)))
            for channel in self._rows[: len(weighed)].T
        )

    def seen_in(self, direction: Vec3) -> tuple[Channels, ...]:
        """L in a direction, degree by degree: sum over m of L_lm Y_lm, of an intensity of 1."""
        return bands(direction, self._rows)

    def as_lights(self, samples: int) -> tuple[ParallelLight, ...]:
        """2 samples^2 parallel lights that together are this one, for every lobe and body.

        They stand at the nodes of Gauss's rule in z, evenly around. What they light converges like a
        power of 1 / samples, as every light has a terminator; a lobe needs as many as highlights fit
        around the sphere. Where the harmonics ring below 0, so do their intensities.

        >>> len(EnvironmentLight([1.0]).as_lights(4))
        32
        """
        if not isinstance(samples, int | np.integer) or isinstance(samples, bool) or samples < 1:
            raise BadInput(f"samples is {samples!r}: give a whole number of at least 1")
        z, weight = np.polynomial.legendre.leggauss(samples)
        turns = (np.arange(2 * samples) + 0.5) * pi / samples
        ring = np.sqrt(1 - z * z)[:, None]
        w = np.stack(
            np.broadcast_arrays(ring * np.cos(turns), ring * np.sin(turns), z[:, None]), axis=-1
        ).reshape(-1, 3)
        share = np.repeat(weight * pi / samples, 2 * samples)
        dtype = self.harmonics.dtype
        intensity = self.radiance(w.astype(dtype)) * jnp.asarray(share[:, None], dtype)
        grey = self.harmonics.ndim == 1 and self.intensity.ndim == 0
        return tuple(
            ParallelLight(
                jnp.asarray(direction, dtype), own[0] if grey else own, visible=self.visible
            )
            for direction, own in zip(w, intensity, strict=True)
        )

    @property
    def _rows(self) -> Float[Array, "K C"]:
        return self.harmonics[:, None] if self.harmonics.ndim == 1 else self.harmonics


def _projected(image: Float[Array, "H W *C"], order: int) -> Float[Array, "K *C"]:
    """The integrals of image times Y_lm, one after the other."""
    height, width = image.shape[:2]
    latitude = (pi * (0.5 - (np.arange(height) + 0.5) / height))[:, None]
    longitude = (pi * (2 * (np.arange(width) + 0.5) / width - 1))[None]
    edges = np.sin(pi * (0.5 - np.arange(height + 1) / height))
    angle = ((edges[:-1] - edges[1:]) * 2 * pi / width)[:, None]
    w = (
        np.cos(latitude) * np.sin(longitude),
        np.sin(latitude) + 0 * longitude,
        -np.cos(latitude) * np.cos(longitude),
    )
    arriving = jnp.asarray(angle[..., None], image.dtype) * image.reshape(height, width, -1)
    integrals = {
        number: jnp.tensordot(y, arriving, 2, precision=lax.Precision.HIGHEST)
        for number, y in each_harmonic(Vec3(*(jnp.asarray(x, image.dtype) for x in w)), order)
    }
    rows = jnp.stack([integrals[number] for number in range(len(integrals))])
    return rows.reshape(-1, *image.shape[2:])
