"""A material: which terms of the illumination equation it has, and their coefficients."""

from collections.abc import Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from diffshade.arrays import coefficients, is_concrete, optional
from diffshade.buckets import pad
from diffshade.errors import BadInput
from diffshade.reflectance.body import FresnelBody
from diffshade.reflectance.lobe import AbstractLobe

__all__ = ["Material", "by_slot", "check_slots", "with_padded_maps"]

Coefficient = Float[Array, "..."] | None
Materials = TypeVar("Materials")


def _lobes(specular: Any) -> tuple[AbstractLobe, ...]:
    if specular is None:
        return ()
    return (specular,) if isinstance(specular, AbstractLobe) else tuple(specular)


class Material(eqx.Module):
    """The coefficients of I = I_a k_a O_d + sum over lights I_p f [k_d O_d n.l + k_s O_s s(n, l, v)].

    `ka`, `kd` and each lobe's `ks` are one number, one a channel [C], or maps over a G-buffer's
    pixels [C or 1, P]; they usually lie in [0, 1]. `specular` is a lobe or a tuple of lobes.
    `body` is the boundary that the diffuse light enters and leaves through; None is none, as in the
    texts. `od` and `os` are the object colours O_d and O_s (text C): O_d multiplies the ambient and the
    diffuse term, O_s every lobe; None means 1. A term that is left out is None, and is not in the
    program that XLA compiles; a coefficient of zero is.

    >>> from diffshade.reflectance.phong import Phong
    >>> len(Material(kd=(0.6, 0.3, 0.2), specular=Phong(ks=0.5, shininess=32)).specular)
    1
    """

    ka: Coefficient = eqx.field(converter=optional(coefficients("ka")), default=None)
    kd: Coefficient = eqx.field(converter=optional(coefficients("kd")), default=None)
    specular: tuple[AbstractLobe, ...] = eqx.field(converter=_lobes, default=())
    od: Coefficient = eqx.field(converter=optional(coefficients("od")), default=None)
    os: Coefficient = eqx.field(converter=optional(coefficients("os")), default=None)
    body: FresnelBody | None = None

    def __check_init__(self) -> None:
        if self.body is not None and self.kd is None:
            raise BadInput("a body is given without kd: give kd, or leave the body out")

    @property
    def is_seen_from(self) -> bool:
        """Whether where it is seen from matters: with a lobe or a body."""
        return bool(self.specular) or self.body is not None


def by_slot(materials: Sequence[Material], slot: Int[Array, "P"]) -> Material:
    """One material whose coefficients are maps: pixel p has those of `materials[slot[p]]`.

    The materials of one object have one form (the same terms, the same kinds of lobes), as those of
    one `.mtl` file have; coefficients may be numbers in one and per channel in another.

    >>> by_slot([Material(kd=0.2), Material(kd=0.8)], jnp.array([0, 1, 1])).kd.shape
    (1, 3)
    """
    forms = {jax.tree.structure(material) for material in materials}
    if len(forms) > 1:
        raise BadInput(
            "the materials of one object have different terms or lobes: give each the same ones"
            " (a coefficient may be 0)"
        )
    if any(leaf.ndim > 1 for leaf in jax.tree.leaves(list(materials))):
        raise BadInput(
            "a material of a slot has maps: give its coefficients one number, or one a channel"
        )

    def gather(*coefficients: Float[Array, "..."]) -> Float[Array, "C P"]:
        rows = jnp.broadcast_arrays(*(jnp.atleast_1d(c) for c in coefficients))
        return jnp.stack(rows, axis=-1)[:, slot]

    return jax.tree.map(gather, *materials)


def check_slots(materials: Sequence[Material], slot: Int[Array, "P"]) -> None:
    """Raise `BadInput` where a pixel has a material that there is not."""
    if is_concrete(slot) and slot.size:
        largest = int(np.max(np.asarray(slot)))
        if largest >= len(materials):
            raise BadInput(
                f"slot {largest} of {len(materials)} materials: slots count from 0; give a material each"
            )


def with_padded_maps(material: Materials) -> Materials:
    """A material, or one a slot, with its maps padded to their bucket."""
    if all(x.ndim != 2 for x in jax.tree.leaves(material)):
        return material
    return jax.tree.map(lambda x: pad(x) if x.ndim == 2 else x, material)
