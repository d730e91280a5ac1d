"""What is fitted: which coefficients are linear, which are searched, which are held.

The image is linear in ka, kd and each ks; these are solved for exactly. What is left to search is the
shape of each lobe and of the attenuation, a short vector u. A material is a fact, a parameterisation
a method: holding and scales live here, never in the material.
"""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from diffshade.channels import Channels, per_channel, times
from diffshade.errors import BadInput
from diffshade.light.attenuation import AbstractAttenuation
from diffshade.reflectance.material import Material
from diffshade.reflectance.phong import Phong
from diffshade.scene import Scene
from diffshade.shading.basis import basis
from fitting.gauge import AbstractGauge, with_attenuation
from fitting.stream import Block

__all__ = [
    "Model",
    "coefficient",
    "default_material",
    "full_names",
    "held_names",
    "linear_names",
    "model_of",
    "shininess_names",
]


class Model(eqx.Module):
    """A material's terms and lobes, of which some coefficients are unknown.

    `material` has the values of what is held. u holds, in this order, the logarithm of the shininess
    of the lobes `searched`; then, where an attenuation is fitted, the constants v of its `gauge`. Of
    these the one that `dependent` marks makes up the sum of 1; none does where the scale is known.
    """

    material: Material
    searched: tuple[int, ...] = eqx.field(static=True)
    channel_count: int = eqx.field(static=True)
    gauge: AbstractGauge | None = None
    dependent: Bool[Array, "q"] | None = None

    @property
    def size(self) -> int:
        """How many unknowns are searched."""
        return len(self.searched) + (0 if self.gauge is None else self.gauge.size)

    @property
    def held(self) -> Bool[np.ndarray, "q"]:
        """Which of the unknowns are held: constants of the attenuation."""
        held = np.zeros(self.size, bool)
        if self.gauge is not None:
            held[len(self.searched) :] = [value is not None for value in self.gauge.held]
        return held

    @property
    def known(self) -> Bool[np.ndarray, "q"]:
        """Which of the unknowns are held, or depend on the others; of a model that is not traced."""
        return self.held if self.dependent is None else self.held | np.asarray(self.dependent)

    @property
    def moves(self) -> tuple[tuple[int, int], ...]:
        """Pairs (direction, column): what each of the `directions` changes of the columns."""
        lobes, count = len(self.material.specular), len(self.searched)
        plain = self.column_count - lobes
        lit = [c for c, of_lights in enumerate(self.lit) if of_lights]
        return (
            *((i, plain + j) for i, j in enumerate(self.searched)),
            *((i, c) for i in range(count, self.direction_count) for c in lit),
        )

    @property
    def lit(self) -> tuple[bool, ...]:
        """Which columns are of the lights, and not of the ambient light."""
        return tuple(name != "ka" for name in linear_names(self.material))

    @property
    def column_count(self) -> int:
        """How many linear coefficients there are."""
        return len(linear_names(self.material))

    @property
    def direction_count(self) -> int:
        """How many of the unknowns move freely."""
        return self.size - int(self.held.sum()) - int(self.dependent is not None)

    @property
    def slots(self) -> Float[Array, "m q"]:
        """Which unknown each direction is of: rows of the identity."""
        unknown = np.flatnonzero(~self.held)
        rows = jnp.eye(self.size)[unknown]
        if self.dependent is None:
            return rows
        # Of the free l's, those that follow the dependent one, round about.
        first, laws = len(self.searched), unknown[unknown >= len(self.searched)]
        at = jnp.argmax(self.dependent[laws])
        order = (at + 1 + jnp.arange(len(laws) - 1)) % len(laws)
        return jnp.concatenate([rows[:first], rows[first:][order]])

    @property
    def directions(self) -> Float[Array, "m q"]:
        """The directions in which u moves: an unknown each, and what depends on it."""
        slots = self.slots
        if self.dependent is None:
            return slots
        of_law = jnp.arange(self.direction_count) >= len(self.searched)
        return slots - jnp.outer(of_law, self.dependent).astype(slots.dtype)

    def unpack(self, u: Float[Array, "q"]) -> tuple[Material, AbstractAttenuation | None]:
        """The material with the shininess of u, its linear coefficients as held, and the attenuation."""
        material = self.material
        for k, j in enumerate(self.searched):
            material = eqx.tree_at(lambda m: m.specular[j].shininess, material, jnp.exp(u[k]))  # noqa: B023
        return material, None if self.gauge is None else self.gauge.law(self.of_law(u))

    def of_law(self, u: Float[Array, "q"]) -> Float[Array, "s"]:
        """The constants v of the attenuation."""
        return self.whole(u)[len(self.searched) :]

    def whole(self, u: Float[Array, "q"]) -> Float[Array, "q"]:
        """u with its dependent entry made up from the others."""
        if self.dependent is None:
            return u
        others = jnp.sum(jnp.where(self.dependent, 0, u)[len(self.searched) :])
        return jnp.where(self.dependent, 1 - others, u)

    def depending_on(self, u: Float[Array, "q"]) -> "Model":
        """The model whose dependent entry is the largest l of u, where the scale is free."""
        if self.gauge is None or not self.gauge.floating:
            return self
        laws = jnp.where(self.held[len(self.searched) :], -1, u[len(self.searched) :])
        largest = len(self.searched) + jnp.argmax(laws)
        return replace(self, dependent=jnp.arange(self.size) == largest)

    def columns(
        self, u: Float[Array, "q"], block: Block, gain: Float[Array, ""] | None = None
    ) -> tuple[Channels, ...]:
        """What each linear coefficient adds to the image: the basis, p columns of planes [P].

        Each has one plane a channel, or all have one for all channels. `gain` is that of all lights.
        """
        gbuffer, scene = block.gbuffer, block.scene
        material, attenuation = self.unpack(u)
        if attenuation is not None:
            scene = with_attenuation(scene, attenuation)
        terms = basis(gbuffer, scene, material)
        lit = [
            *((terms.diffuse,) if material.kd is not None else ()),
            *(terms.specular or (None,) * len(material.specular)),
        ]
        if gain is not None:
            lit = [None if term is None else times(term, (gain,)) for term in lit]
        present = [*((terms.ambient,) if material.ka is not None else ()), *lit]
        dark = jnp.zeros(gbuffer.pixel_count, gbuffer.normal.x.dtype)
        grey = all(term is None or len(term) == 1 for term in present)
        return tuple(
            tuple(
                plane + dark
                for plane in per_channel(term or (dark,), 1 if grey else self.channel_count)
            )
            for term in present
        )

    def named(self, u: Float[np.ndarray, "q"]) -> dict[str, float]:
        """What is searched, by name."""
        count = len(self.searched)
        lobes = {
            f"specular.{j}.shininess": float(np.exp(u[k])) for k, j in enumerate(self.searched)
        }
        return lobes | ({} if self.gauge is None else self.gauge.named(u[count:]))

    def with_linear(self, material: Material, k: Float[Array, "C p"]) -> Material:
        """The material with its linear coefficients set, one number a channel."""
        for name, column in zip(linear_names(material), k.T, strict=True):
            material = eqx.tree_at(lambda m: coefficient(m, name), material, column)  # noqa: B023
        return material


def model_of(start: Material, held: frozenset[str], channel_count: int) -> Model:
    """The model of a material: all that is not held is unknown; one shininess for all channels."""
    if any(leaf.ndim > 1 for leaf in jax.tree.leaves(start)):
        raise BadInput("the material holds maps: give fit one number, or one a channel")
    names = shininess_names(start)
    searched = tuple(j for j, name in enumerate(names) if name not in held)
    if any(coefficient(start, names[j]).ndim for j in searched):
        raise BadInput(
            "the shininess has one number a channel: fit searches one for all, or hold it"
        )
    return Model(material=start, searched=searched, channel_count=channel_count)


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
    return _default_material(ambient, jnp.asarray(0.0).dtype)


@cache
def _default_material(ambient: bool, dtype: jnp.dtype) -> Material:
    with jax.ensure_compile_time_eval():  # kept for later calls: no tracer may be
        half, shininess = jnp.asarray(0.5, dtype), jnp.asarray(30.0, dtype)
    return Material(ka=half if ambient else None, kd=half, specular=(Phong(half, shininess),))


def held_names(
    hold: Iterable[str], material: Material, constants: tuple[str, ...] = ()
) -> frozenset[str]:
    """Full names of what is held; "specular.ks" stands for that of every lobe.

    `constants` are the names of a fitted attenuation's.
    """
    if isinstance(hold, str):
        raise BadInput(f"hold is {hold!r}: give a sequence of names, ({hold!r},)")
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
