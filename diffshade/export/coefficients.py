"""The coefficients of a material as plain numbers, and the one highlight that is nearest to its lobes."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from diffshade.errors import BadInput
from diffshade.reflectance.blinn_phong import BlinnPhong
from diffshade.reflectance.conversion import exponent_of, to_blinn_phong
from diffshade.reflectance.fresnel import AbstractFresnel
from diffshade.reflectance.lobe import AbstractLobe
from diffshade.reflectance.material import Material
from diffshade.reflectance.microfacet import AbstractMicrofacet
from diffshade.reflectance.phong import Phong

__all__ = [
    "RGB",
    "WEIGHED",
    "Highlight",
    "ambient",
    "diffuse",
    "facet_width",
    "head_on",
    "highlight",
    "lobe_ks",
    "one",
    "plain",
    "rgb",
]

RGB = Float[np.ndarray, "3"]

NARROWEST = 1e-4
"""The least alpha of facets that other tools, too, tell from a mirror."""
WEIGHED = "the weight of the angle of incidence is taken as it is head-on"


class Highlight(NamedTuple):
    """k_s (n.h)^n, the nearest to all lobes of a material together."""

    ks: RGB
    exponent: float
    f0: RGB | None
    """The share that its facets reflect head-on, which grows towards grazing angles; None where it does
    not, as of Phong's and Blinn's lobes."""
    notes: tuple[str, ...]
    """What was lost."""


def rgb(value: Any) -> RGB:
    """Three numbers of one, or of three; raises `BadInput` for maps and for other channels."""
    array = plain(value)
    if array.ndim > 1 or array.size not in (1, 3):
        raise BadInput(
            f"the material has coefficients of shape {array.shape}: other tools take one number, or"
            " three for red, green and blue; export one material at a time"
        )
    return np.broadcast_to(array.reshape(-1), 3).copy()


def plain(value: Any) -> np.ndarray:
    """Numbers as they were written: 0.1 in float32 is 0.1, not 0.10000000149."""
    array = np.asarray(value)
    return np.array([float(str(x)) for x in array.ravel()]).reshape(array.shape)


def one(name: str, value: Any) -> tuple[float, tuple[str, ...]]:
    """One number for all channels, their geometric mean, and what there is to say of that."""
    numbers = rgb(value)
    if (numbers == numbers[0]).all():
        return float(numbers[0]), ()
    mean = float(np.exp(np.log(np.maximum(numbers, 1e-30)).mean()))
    listed = ", ".join(f"{x:.4g}" for x in numbers)
    return mean, (
        f"{name} is {listed} for red, green and blue: one, {mean:.4g}, is written for all",
    )


def ambient(material: Material) -> RGB | None:
    """k_a O_d."""
    return None if material.ka is None else rgb(material.ka) * _colour(material.od)


def diffuse(material: Material) -> RGB | None:
    """k_d O_d, of a body as it is head-on: times T(1)^2."""
    if material.kd is None:
        return None
    kd = rgb(material.kd) * _colour(material.od)
    if material.body is None:
        return kd
    straight = jnp.ones(())
    return kd * rgb(jnp.stack(material.body.passed(straight, straight)))


def lobe_ks(material: Material, lobe: AbstractLobe) -> RGB:
    """k_s O_s."""
    return rgb(lobe.ks) * _colour(material.os)


def head_on(fresnel: AbstractFresnel) -> RGB:
    """F at a cosine of 1."""
    return rgb(jnp.stack(fresnel.reflected(jnp.ones(()))))


def highlight(material: Material) -> Highlight | None:
    """One highlight for all lobes: as high as their sum where n = l = v, and as much light in it.

    (n.h)^n reflects 4 / (n + 2) of its peak in light from straight above, but for what is small for
    narrow lobes. A lobe becomes Blinn's by `conversion`: the exponent 4 n of Phong's, or that of facets
    of its alpha; a weight of the incidence is taken head-on.
    """
    found = [_nearest(lobe, lobe_ks(material, lobe)) for lobe in material.specular]
    if len(found) < 2:
        return found[0] if found else None
    heights = np.array([own.ks.mean() for own in found])
    exponents = np.array([own.exponent for own in found])
    highest = found[int(heights.argmax())]
    mean = highest.exponent
    if heights.any():
        mean = heights.sum() / np.sum(heights / (exponents + 2)) - 2
    f0 = None if any(own.f0 is None for own in found) else highest.f0
    merged = f"{len(found)} lobes are written as one, as high together and with as much light"
    notes = dict.fromkeys((merged, *(note for own in found for note in own.notes)))
    total: RGB = np.sum([own.ks for own in found], axis=0)
    return Highlight(total, float(mean), f0, tuple(notes))


def facet_width(lobe: AbstractMicrofacet) -> tuple[float, tuple[str, ...]]:
    """One alpha for all channels, and what there is to say of that; `BadInput` for that of a mirror."""
    alpha, notes = one("alpha", lobe.alpha)
    if alpha < NARROWEST:
        raise BadInput(f"alpha is {alpha:.3g}, that of a mirror: give {NARROWEST:g} or more")
    return alpha, notes


def _nearest(lobe: AbstractLobe, ks: RGB) -> Highlight:
    """One lobe as Blinn's."""
    if isinstance(lobe, AbstractMicrofacet):
        alpha, notes = facet_width(lobe)
        f0 = None if lobe.fresnel is None else head_on(lobe.fresnel)
        peak = ks / (4 * np.pi * alpha**2)  # D / 4 where n = l = v
        exponent = max(float(exponent_of(alpha)), 0.0)
        return Highlight(peak if f0 is None else peak * f0, exponent, f0, notes)
    if not isinstance(lobe, Phong | BlinnPhong):
        raise BadInput(f"a lobe of kind {lobe.kind!r} has no form in other tools: use another")
    own, notes = one("the exponent", lobe.shininess)
    exponent = own if isinstance(lobe, BlinnPhong) else _times_four(own)
    if lobe.weight is not None:
        ks = ks * head_on(lobe.weight)
        notes += (WEIGHED,)
    return Highlight(ks, exponent, None, notes)


def _times_four(exponent: float) -> float:
    """Blinn's exponent for that of Phong's lobe, about (`conversion`)."""
    return float(to_blinn_phong(Phong(1.0, exponent)).shininess)  # type: ignore[arg-type]


def _colour(value: Any | None) -> RGB:
    return np.ones(3) if value is None else rgb(value)
