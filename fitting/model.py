"""What is fitted: which coefficients are linear, which are searched, which are held.

The image is linear in ka, kd and each ks; these are solved for exactly. What is left to search is the
shape of each lobe and of the attenuation, a short vector u. A material is a fact, a parameterisation
a method: holding and scales live here, never in the material.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from diffshade.channels import Channels, per_channel
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.reflectance.material import Material
from diffshade.reflectance.phong import Phong
from diffshade.scene import Scene
from diffshade.shading.basis import basis
from fitting.gauge import ReferenceAttenuation, with_attenuation

__all__ = [
    "CONSTANTS",
    "Model",
    "coefficient",
    "default_material",
    "full_names",
    "held_names",
    "linear_names",
    "shininess_names",
]


class Model(eqx.Module):
    """A material's terms and lobes, of which some coefficients are unknown.

    `material` has the values of what is held. u holds, in this order, the logarithm of the shininess
    of the lobes `searched`; then, where an attenuation is fitted at the reference distance
    `distance`, its l0, l1, l2. Of these the one that `dependent` marks makes up the sum of 1; none
    does where the scale is known (`scaled`), because k_d, a k_s or one of c0, c1, c2 is held.
    `held_law` has the values of l that are held.
    """

    material: Material
    searched: tuple[int, ...] = eqx.field(static=True)
    channel_count: int = eqx.field(static=True)
    distance: Float[Array, ""] | None = None
    scaled: bool = eqx.field(static=True, default=False)
    held_law: tuple[float | None, ...] = eqx.field(static=True, default=(None, None, None))
    dependent: Bool[Array, "q"] | None = None

    @property
    def size(self) -> int:
        """How many unknowns are searched."""
        return len(self.searched) + (0 if self.distance is None else 3)

    @property
    def held(self) -> Bool[np.ndarray, "q"]:
        """Which of the unknowns are held: constants of the attenuation."""
        held = np.zeros(self.size, bool)
        if self.distance is not None:
            held[len(self.searched) :] = [value is not None for value in self.held_law]
        return held

    @property
    def known(self) -> Bool[np.ndarray, "q"]:
        """Which of the unknowns are held, or depend on the others."""
        return self.held if self.dependent is None else self.held | np.asarray(self.dependent)

    def unpack(self, u: Float[Array, "q"]) -> tuple[Material, ReferenceAttenuation | None]:
        """The material with the shininess of u, its linear coefficients as held, and the attenuation."""
        material = self.material
        for k, j in enumerate(self.searched):
            material = eqx.tree_at(lambda m: m.specular[j].shininess, material, jnp.exp(u[k]))  # noqa: B023
        if self.distance is None:
            return material, None
        l0, l1, l2 = self.whole(u)[len(self.searched) :]
        return material, ReferenceAttenuation(l0, l1, l2, self.distance)

    def whole(self, u: Float[Array, "q"]) -> Float[Array, "q"]:
        """u with its dependent entry made up from the others."""
        if self.dependent is None:
            return u
        others = jnp.sum(jnp.where(self.dependent, 0, u)[len(self.searched) :])
        return jnp.where(self.dependent, 1 - others, u)

    def depending_on(self, u: Float[np.ndarray, "q"]) -> "Model":
        """The model whose dependent entry is the largest l of u, where the scale is free."""
        if self.distance is None or self.scaled:
            return self
        largest = len(self.searched) + int(np.argmax(u[len(self.searched) :]))
        dependent = jnp.asarray(np.arange(self.size) == largest)
        return replace(self, dependent=dependent)

    def columns(
        self, u: Float[Array, "q"], gbuffer: GBuffer, scene: Scene
    ) -> Float[Array, "C p P"]:
        """What each linear coefficient adds to each channel's image: the basis, as a matrix."""
        material, attenuation = self.unpack(u)
        if attenuation is not None:
            scene = with_attenuation(scene, attenuation)
        terms = basis(gbuffer, scene, material)
        present = [
            *((terms.ambient,) if material.ka is not None else ()),
            *((terms.diffuse,) if material.kd is not None else ()),
            *(terms.specular or (None,) * len(material.specular)),
        ]
        dark = jnp.zeros(gbuffer.pixel_count, gbuffer.normal.x.dtype)

        def column(term: Channels | None) -> Float[Array, "C P"]:
            planes = per_channel(term or (dark,), self.channel_count)
            return jnp.stack([plane + dark for plane in planes])

        return jnp.stack([column(term) for term in present], axis=1)

    def with_linear(self, material: Material, k: Float[Array, "C p"]) -> Material:
        """The material with its linear coefficients set, one number a channel."""
        for name, column in zip(linear_names(material), k.T, strict=True):
            material = eqx.tree_at(lambda m: coefficient(m, name), material, column)  # noqa: B023
        return material


def linear_names(material: Material) -> tuple[str, ...]:
    """The linear coefficients of a material, in the order of the columns."""
    return (
        *(("ka",) if material.ka is not None else ()),
        *(("kd",) if material.kd is not None else ()),
        *(f"specular.{j}.ks" for j in range(len(material.specular))),
    )


def shininess_names(material: Material) -> tuple[str, ...]:
    """The shininess of every lobe, by name."""
    return tuple(f"specular.{j}.shininess" for j in range(len(material.specular)))


def default_material(scenes: Iterable[Scene]) -> Material:
    """Diffuse and one Phong lobe, and ambient where any scene has ambient light."""
    ambient = any(scene.ambient is not None for scene in scenes)
    half = jnp.asarray(0.5, float)
    lobe = Phong(ks=half, shininess=jnp.asarray(30.0, float))
    return Material(ka=half if ambient else None, kd=half, specular=(lobe,))


CONSTANTS = ("attenuation.c0", "attenuation.c1", "attenuation.c2")
"""The names of a fitted attenuation's constants."""


def held_names(
    hold: Iterable[str], material: Material, *, attenuated: bool = False
) -> frozenset[str]:
    """Full names of what is held; "specular.ks" stands for that of every lobe."""
    if isinstance(hold, str):
        raise BadInput(f"hold is {hold!r}: give a sequence of names, ({hold!r},)")
    constants = CONSTANTS if attenuated else ()
    known = (*linear_names(material), *shininess_names(material), *constants)
    return frozenset(full for name in hold for full in full_names(name, known, "hold"))


def full_names(name: str, known: tuple[str, ...], where: str) -> tuple[str, ...]:
    """The known names that one stands for: itself, or "specular.ks" for that of every lobe."""
    parts = name.split(".")
    of_lobes = tuple(n for n in known if len(parts) == 2 and n.split(".")[::2] == parts)
    found = (name,) if name in known else of_lobes
    if not found:
        raise BadInput(
            f"{where} names {name!r}, which this material lacks: it has {', '.join(known)}"
        )
    return found


def coefficient(material: Material, name: str) -> Any:
    """A coefficient by its full name: an array, or what stands for one inside `tree_at`."""
    if name.startswith("specular."):
        _, lobe, field = name.split(".")
        return getattr(material.specular[int(lobe)], field)
    return getattr(material, name)
