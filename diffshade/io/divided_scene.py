"""The light of an image that was divided by the intensity of its one distant light."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from diffshade.scene import Scene

__all__ = ["divided_scene"]


def divided_scene(direction: Any) -> Scene:
    """I_a = 1, and a parallel light of intensity 1; x right, y up, z to the camera."""
    from diffshade.light.parallel import ParallelLight
    from diffshade.scene import Scene

    unit: Any = 1.0
    return Scene(ambient=unit, lights=(ParallelLight(direction, unit),))
