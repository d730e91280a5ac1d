"""What is fitted: which coefficients are linear, which are searched, which are held.

The image is linear in ka, kd and each ks; these are solved for exactly. What is left to search is the
shape of each lobe and of the attenuation, a short vector u. A material is a fact, a parameterisation
a method: holding and scales live here, never in the material.
"""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from diffshade.channels import Channels
from diffshade.errors import BadInput
from diffshade.light.attenuation import AbstractAttenuation
from diffshade.reflectance.material import Material
from diffshade.reflectance.names import coefficient, of_every_lobe
from diffshade.reflectance.phong import Phong
from diffshade.scene import Scene
from fitting.arrays import Array
from fitting.columns import Scenery, columns, predict
from fitting.gauge import AbstractGauge
from fitting.shapes import boundaries, shape_names

__all__ = [
    "Model",
    "default_material",
    "full_names",
    "held_names",
    "linear_names",
    "model_of",
    "sets_scale",
]


class Model(eqx.Module):
    """A material's terms and lobes, of which some coefficients are unknown.

    `material` has the values of what is held. u holds, in this order, the logarithms of the shapes
    `searched`, each of which has one name or several that share a value; then, where an attenuation
    is fitted, the constants v of its `gauge`. Of
    these the unknown `dependent` makes up the sum of 1; none does where the scale is known. What
    is left of u, without what depends on others or is held, are the m coordinates y of a search.
    """

    material: Material
    searched: tuple[tuple[str, ...], ...] = eqx.field(static=True)
    channel_count: int = eqx.field(static=True)
    gauge: AbstractGauge | None = None
    dependent: Int[Array, ""] | None = None

    @property
    def size(self) -> int:
        """How many unknowns u has."""
        return len(self.searched) + (0 if self.gauge is None else self.gauge.size)

    @property
    def direction_count(self) -> int:
        """How many coordinates y has."""
        return len(self.free) - int(self.gauge is not None and self.gauge.floating)

    @property
    def lit(self) -> tuple[bool, ...]:
        """Which columns are of the lights, and not of the ambient light."""
        return tuple(name != "ka" for name in linear_names(self.material))

    @property
    def reads(self) -> dict[int, tuple[int, ...]]:
        """Which unknowns each column depends on, beside an attenuation: those columns that do."""
        read: dict[int, tuple[int, ...]] = {}
        for column, name in enumerate(linear_names(self.material)):
            part = "body." if name == "kd" else name.removesuffix("ks")
            own = tuple(
                k for k, names in enumerate(self.searched) if any(n.startswith(part) for n in names)
            )
            if own:
                read[column] = own
        return read

    @property
    def column_count(self) -> int:
        """How many linear coefficients there are."""
        return len(linear_names(self.material))

    @property
    def free(self) -> Int[np.ndarray, "f"]:
        """Which of the unknowns are not held."""
        laws = () if self.gauge is None else self.gauge.held
        held = np.array([False] * len(self.searched) + [value is not None for value in laws], bool)
        return np.flatnonzero(~held)

    @property
    def moving(self) -> Int[Array, "m"]:
        """Which of the unknowns the coordinates are."""
        free, count = self.free, len(self.searched)
        if self.dependent is None:
            return free
        # Of the free constants, those that follow the dependent one, round about
        laws = free[count:]
        xp = self.dependent.__array_namespace__()
        place = (xp.asarray(laws) == self.dependent).argmax()
        others = xp.asarray(laws)[(place + np.arange(1, len(laws))) % len(laws)]
        return xp.concatenate([xp.asarray(free[:count]), others])

    @property
    def along(self) -> Bool[Array, "q m"]:
        """Which unknown each coordinate is: the derivative of u, but for what depends on others."""
        return np.arange(self.size)[:, None] == self.moving[None]

    def coordinates(self, u: Float[Array, "q"]) -> Float[Array, "m"]:
        """y of u."""
        return u[self.moving]

    def whole(self, y: Float[Array, "*n m"]) -> Float[Array, "*n q"]:
        """u of y: what is held at its value, and what depends on others made up from them."""
        xp, count = y.__array_namespace__(), len(self.searched)
        spread = xp.sum(xp.where(self.along, y[..., None, :], 0), axis=-1)
        if self.dependent is None:
            laws = () if self.gauge is None else self.gauge.held
            held = np.array([0.0] * count + [value or 0.0 for value in laws])
            return spread + xp.asarray(held, dtype=y.dtype)
        dependent = np.arange(self.size) == self.dependent
        return spread + xp.where(dependent, 1 - xp.sum(y[..., count:], axis=-1, keepdims=True), 0)

    def pushed(self, rows: Float[Array, "*n q"]) -> Float[Array, "*n m"]:
        """From derivatives in u, as if no unknown depended on others, to those in y."""
        xp, count = rows.__array_namespace__(), len(self.searched)
        own = rows[..., self.moving]
        if self.dependent is None:
            return own
        law = np.arange(self.direction_count) >= count
        return own - xp.where(law, rows[..., self.dependent, None], 0)

    def unpack(self, u: Float[Array, "q"]) -> tuple[Material, AbstractAttenuation | None]:
        """The material with the shapes of u, its linear coefficients as held, and the attenuation."""
        material = self.material
        for k, names in enumerate(self.searched):
            shape = jnp.exp(u[k])
            material = eqx.tree_at(partial(_all_of, names), material, [shape] * len(names))
        return material, None if self.gauge is None else self.gauge.law(self.of_law(u))

    def of_law(self, u: Float[Array, "q"]) -> Float[Array, "s"]:
        """The constants v of the attenuation."""
        return u[len(self.searched) :]

    def depends(self, u: Float[Array, "q"]) -> Int[Array, ""]:
        """The largest free l of u, which makes up the sum of 1 where the scale is free; 0 elsewhere."""
        xp = u.__array_namespace__()
        if self.gauge is None or not self.gauge.floating:
            return xp.zeros((), int)
        laws = self.free[len(self.searched) :]
        return xp.asarray(laws)[u[laws].argmax()]

    def depending_on(self, u: Float[Array, "q"]) -> "Model":
        """The model whose dependent constant is the largest l of u, where the scale is free."""
        if self.gauge is None or not self.gauge.floating:
            return self
        return replace(self, dependent=self.depends(u))

    def columns(self, u: Float[Array, "q"], at: Scenery) -> tuple[Channels, ...]:
        """What each linear coefficient adds to an image: the basis, p columns."""
        return columns(*self.unpack(u), at, self.channel_count)

    def slopes(
        self, u: Float[Array, "q"], k: Float[Array, "C p"], at: Scenery
    ) -> list[tuple[Array, ...]]:
        """The derivative of the image A(u) k in each unknown, as if it depended on no other.

        Each is a plane a channel.
        """
        count = len(self.searched)

        def image(lobes: Array, law: Array) -> tuple[Array, ...]:
            return predict(self.columns(jnp.concatenate([lobes, law]), at), k)

        lobes, law = u[:count], u[count:]
        units = jnp.asarray(np.eye(count), u.dtype)
        found = [jax.jvp(lambda x: image(x, law), (lobes,), (one,))[1] for one in units]
        if law.size:
            push = jax.linearize(lambda x: image(lobes, x), law)[1]
            found += [push(jnp.asarray(unit, u.dtype)) for unit in np.eye(law.size)]
        return found

    def named(self, u: Float[np.ndarray, "q"]) -> dict[str, float]:
        """What is searched, by name."""
        count = len(self.searched)
        shapes = {
            name: float(np.exp(u[k])) for k, names in enumerate(self.searched) for name in names
        }
        return shapes | ({} if self.gauge is None else self.gauge.named(u[count:]))


def model_of(start: Material, held: frozenset[str], channel_count: int) -> Model:
    """The model of a material: all that is not held is unknown; one shape for all channels."""
    if any(leaf.ndim > 1 for leaf in jax.tree.leaves(start)):
        raise BadInput("the material holds maps: give fit one number, or one a channel")
    free = [name for name in shape_names(start) if name not in held]
    for name in free:
        if coefficient(start, name).ndim:
            raise BadInput(
                f"the {name.rpartition('.')[2]} has one number a channel: fit searches one for all,"
                " or hold it"
            )
    one = boundaries(start)
    if (
        one
        and one[0] in held
        and len({repr(np.asarray(coefficient(start, name)).tolist()) for name in one}) > 1
    ):
        raise BadInput(
            f"hold names {' and '.join(one)}, which are one number and have several values in the"
            " material: give them the same"
        )
    one = () if held & set(one) else one
    alone = [(name,) for name in free if name not in one]
    searched = (*alone, one) if one else tuple(alone)
    return Model(material=start, searched=searched, channel_count=channel_count)


def linear_names(material: Material) -> tuple[str, ...]:
    """The linear coefficients of a material, in the order of the columns."""
    return (
        *(("ka",) if material.ka is not None else ()),
        *(("kd",) if material.kd is not None else ()),
        *(f"specular.{j}.ks" for j in range(len(material.specular))),
    )


def sets_scale(material: Material, held: frozenset[str]) -> bool:
    """Whether a coefficient that is held says how much of the light a surface reflects."""
    lit = held & set(linear_names(material)) - {"ka"}
    return any(np.any(np.asarray(coefficient(material, name)) != 0) for name in lit)


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

    `constants` are the names of a fitted attenuation's. A surface has one boundary: who holds the
    index of a lobe holds that of its body, and the reverse.
    """
    if isinstance(hold, str):
        raise BadInput(f"hold is {hold!r}: give a sequence of names, ({hold!r},)")
    known = (*linear_names(material), *shape_names(material), *constants)
    found = {full for name in hold for full in full_names(name, known, "hold")}
    one = boundaries(material)
    return frozenset(found | set(one)) if found & set(one) else frozenset(found)


def full_names(name: str, known: tuple[str, ...], where: str) -> tuple[str, ...]:
    """The known names that one stands for: itself, or "specular.ks" for that of every lobe."""
    of_lobes = tuple(n for n in known if of_every_lobe(n) == name)
    found = (name,) if name in known else of_lobes
    if not found:
        raise BadInput(
            f"{where} names {name!r}, which this material lacks: it has {', '.join(known)}"
        )
    return found


def _all_of(names: tuple[str, ...], material: Material) -> list[Any]:
    return [coefficient(material, name) for name in names]
