"""A scene: the light that is there, whatever it falls on."""

from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from diffshade.arrays import floats, optional
from diffshade.buckets import pad
from diffshade.errors import BadInput
from diffshade.light.base import AbstractLight
from diffshade.light.distributed import AbstractEmitter
from diffshade.light.visible import map_visible

__all__ = ["Scene"]


def _lights(lights: Any) -> tuple[AbstractLight, ...]:
    given = (lights,) if isinstance(lights, AbstractLight | AbstractEmitter) else tuple(lights)
    found: list[AbstractLight] = []
    for light in given:
        if isinstance(light, AbstractEmitter):
            found.extend(light.elements())
        elif isinstance(light, AbstractLight):
            found.append(light)
        else:
            raise BadInput(f"a light is {light!r}: give lights, such as ds.PointLight")
    return tuple(found)


class Scene(eqx.Module):
    """Ambient light of intensity I_a (LIGHT-1), and any number of lights.

    `ambient` is one number, one a channel, or None for no ambient light at all. It is counted once,
    whatever the number of lights. A light with extent is held as the elements that it is the sum of.

    >>> from diffshade.light.parallel import ParallelLight
    >>> len(Scene(ambient=0.1, lights=ParallelLight(direction=(0, 0, 1))).lights)
    1
    """

    ambient: Float[Array, "..."] | None = eqx.field(
        converter=optional(floats("the ambient intensity")), default=None
    )
    lights: tuple[AbstractLight, ...] = eqx.field(converter=_lights, default=())

    def in_bucket(self) -> "Scene":
        """The same, the planes of its lights padded as `GBuffer.in_bucket` pads those of points."""
        if all(light.visible is None for light in self.lights):
            return self
        return map_visible(pad, self)
