"""The planes that lights carry: what share of a light each point of a G-buffer sees."""

from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax

from diffshade.errors import BadInput
from diffshade.light.base import AbstractLight

__all__ = ["are_planes", "check_visible", "map_visible", "visible_of"]

Lights = TypeVar("Lights")


def map_visible(f: Callable[[Any], Any], lights: Lights) -> Lights:
    """Lights, in whatever tree, with `f` of their planes of visibility; others as they are."""

    def of_light(x: Any) -> Any:
        if not _is_light(x) or x.visible is None:
            return x
        return eqx.tree_at(lambda light: light.visible, x, f(x.visible))

    return jax.tree.map(of_light, lights, is_leaf=_is_light)


def visible_of(lights: Any) -> list[Any]:
    """The planes that lights in a tree have."""
    leaves = jax.tree.leaves(lights, is_leaf=_is_light)
    return [x.visible for x in leaves if _is_light(x) and x.visible is not None]


def are_planes(lights: Lights) -> Lights:
    """Which of the lights' arrays are planes over the points."""
    return map_visible(lambda _: True, jax.tree.map(lambda _: False, lights))


def check_visible(lights: tuple[AbstractLight, ...], count: int) -> None:
    """Raise `BadInput` where a light's plane is not over `count` points."""
    for k, light in enumerate(lights):
        if light.visible is not None and light.visible.shape != (count,):
            raise BadInput(
                f"what is visible of light {k} has shape {light.visible.shape}, and the G-buffer"
                f" {count} points: compute ds.shadowed for this G-buffer"
            )


def _is_light(x: Any) -> bool:
    return isinstance(x, AbstractLight)
