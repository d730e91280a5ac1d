"""From one model of a highlight to another, and how far apart they are then.

No conversion is exact: each agrees with the other model about the peak of the highlight of light that
comes from straight above, and `difference` tells what is left, for light from any angle. As parts of the
peak, the largest difference over all directions to the viewer:

| | n | 0 degrees | 30 | 60 | 80 |
|---|---|---|---|---|---|
| Phong to Blinn-Phong | 10 | 0.014 | 0.1 | 0.48 | 0.88 |
| Phong to Blinn-Phong | 100 | 0.0014 | 0.1 | 0.47 | 0.87 |
| Blinn-Phong to Beckmann | 40 | 0.05 | 0.32 | 3.9 | 13 |
| Blinn-Phong to Beckmann | 400 | 0.0047 | 0.17 | 1.1 | 11 |
| Blinn-Phong to GGX | 40 | 0.14 | 0.25 | 1.4 | 6 |
| Blinn-Phong to GGX | 400 | 0.16 | 0.16 | 1 | 4.9 |

As light comes in low the highlight of Blinn's and of microfacets is drawn out, while Phong's stays round,
and that of microfacets alone gets brighter.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diffshade.arrays import ArrayLike, floats
from diffshade.errors import BadInput
from diffshade.reflectance.blinn_phong import BlinnPhong
from diffshade.reflectance.lobe import AbstractLobe
from diffshade.reflectance.microfacet import GGX, Beckmann
from diffshade.reflectance.phong import Phong
from diffshade.vector import Vec3

__all__ = [
    "alpha_of",
    "difference",
    "exponent_of",
    "normalised",
    "plain",
    "to_beckmann",
    "to_blinn_phong",
    "to_ggx",
    "to_phong",
]


def to_blinn_phong(lobe: Phong) -> BlinnPhong:
    """The same highlight with the exponent 4 n: h turns by half the angle of r, and
    cos(x/2)^(4n) = cos(x)^n + O(x^4).

    >>> float(to_blinn_phong(Phong(ks=0.5, shininess=32)).shininess)
    128.0
    """
    return BlinnPhong(lobe.ks, 4 * lobe.shininess, lobe.weight)


def to_phong(lobe: BlinnPhong) -> Phong:
    """The reverse: n / 4.

    >>> float(to_phong(BlinnPhong(ks=0.5, shininess=128)).shininess)
    32.0
    """
    return Phong(lobe.ks, lobe.shininess / 4, lobe.weight)


def alpha_of(exponent: ArrayLike) -> Float[Array, "..."]:
    """alpha = sqrt(2 / (m + 2)) of Beckmann's and of GGX's facets, m the exponent of n.h.

    So that their density is as high at its peak as (m + 2) / (2 pi) (n.h)^m (Walter et al. 2007, 6.2).

    >>> round(float(alpha_of(198.0)), 6)
    0.1
    """
    m = floats("the exponent")(exponent)
    return jnp.sqrt(2 / (m + 2))


def exponent_of(alpha: ArrayLike) -> Float[Array, "..."]:
    """The reverse: m = 2 / alpha^2 - 2.

    >>> round(float(exponent_of(0.1)), 3)
    198.0
    """
    a = floats("alpha")(alpha)
    return 2 / (a * a) - 2


def to_beckmann(lobe: BlinnPhong) -> Beckmann:
    """Facets of `alpha_of` the exponent, and k_s times 4 pi alpha^2: as high a peak where n = l = v.

    >>> round(float(to_beckmann(BlinnPhong(ks=0.5, shininess=198)).alpha), 6)
    0.1
    """
    return Beckmann(*_facets(lobe))


def to_ggx(lobe: BlinnPhong) -> GGX:
    """The same for GGX, whose tails are wider.

    >>> round(float(to_ggx(BlinnPhong(ks=0.5, shininess=198)).alpha), 6)
    0.1
    """
    return GGX(*_facets(lobe))


def plain(normalised_ks: ArrayLike, exponent: ArrayLike) -> Float[Array, "..."]:
    """The k_s of I_p k_s (r.v)^n from that of a normalised Phong lobe: times (n + 2) / (2 pi).

    With the latter, k_s (n + 2) / (2 pi) (r.v)^n n.l, no more than k_s of the light is reflected
    (Lewis 1993, Lafortune and Willems 1994). The texts' lobe lacks the factor n.l: both agree where
    light comes from straight above.

    >>> round(float(plain(0.1, 30)), 4)
    0.5093
    """
    ks, n = floats("ks")(normalised_ks), floats("the exponent")(exponent)
    return ks * (n + 2) / (2 * np.pi)


def normalised(plain_ks: ArrayLike, exponent: ArrayLike) -> Float[Array, "..."]:
    """The reverse.

    >>> round(float(normalised(0.5093, 30)), 4)
    0.1
    """
    ks, n = floats("ks")(plain_ks), floats("the exponent")(exponent)
    return ks * (2 * np.pi) / (n + 2)


def difference(
    a: AbstractLobe, b: AbstractLobe, incidence: ArrayLike, *, steps: int = 181
) -> Float[Array, "N"]:
    """How far two lobes are apart, k_s included, in light from each angle of `incidence` [N], in radians.

    The largest |k_s s| of one less that of the other over a grid of directions to the viewer, with
    `steps` from the normal to the surface and twice as many around it, the directions about the
    mirrored light among them; in parts of the largest of `a` at that incidence.

    >>> far = difference(Phong(0.5, 100), to_blinn_phong(Phong(0.5, 100)), [0.0, 1.0])
    >>> [round(float(x), 3) for x in far]
    [0.001, 0.427]
    """
    if a.ks.ndim or b.ks.ndim:
        raise BadInput("a lobe has ks per channel, or maps: give lobes with one number each")
    angles = np.atleast_1d(np.asarray(incidence, float))
    theta, phi = np.meshgrid(np.linspace(0, np.pi / 2, steps), np.linspace(0, 2 * np.pi, 2 * steps))
    width = np.geomspace(1e-3, 1, steps)
    near_theta, near_phi = np.meshgrid(width, np.linspace(0, 2 * np.pi, 2 * steps))
    found = []
    for angle in angles:
        grid = _around(theta, phi, 0.0)
        near = _around(near_theta, near_phi, angle)  # about the mirrored light
        views = np.concatenate([grid, near])
        v = Vec3.from_array(jnp.asarray(views[views[:, 2] > 0]))
        ones = jnp.ones_like(v.x)
        n, l = (
            Vec3(0 * ones, 0 * ones, ones),
            Vec3(-np.sin(angle) * ones, 0 * ones, np.cos(angle) * ones),
        )
        first, second = (lobe.ks * lobe.shape(n, l, v, l.z)[0] for lobe in (a, b))
        found.append(jnp.abs(first - second).max() / first.max())
    return jnp.stack(found)


def _around(theta: np.ndarray, phi: np.ndarray, tilt: float) -> np.ndarray:
    """Unit vectors [M, 3] at angles about an axis that leans towards x."""
    x, y, z = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
    x, z = x * np.cos(tilt) + z * np.sin(tilt), z * np.cos(tilt) - x * np.sin(tilt)
    return np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1).astype(jnp.zeros(()).dtype)


def _facets(lobe: BlinnPhong) -> tuple[Array, Array]:
    if lobe.weight is not None:
        raise BadInput("the lobe has a weight of n.l, which no facet has: convert it without")
    alpha = alpha_of(lobe.shininess)
    return lobe.ks * 4 * np.pi * alpha * alpha, alpha
