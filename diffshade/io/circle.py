"""A ball known by the circle of its outline, seen from afar along -z."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Bool

from diffshade.errors import BadInput
from diffshade.io.foreground import masked_gbuffer
from diffshade.io.json_document import read_json

if TYPE_CHECKING:
    from diffshade.geometry.gbuffer import GBuffer

__all__ = ["Circle", "ball_gbuffer", "read_circle"]

Mask = Bool[np.ndarray, "H W"]


class Circle(NamedTuple):
    """A circle in pixels from the image's top left corner: pixel (row i, column j) is centred at
    (x, y) = (j + 0.5, i + 0.5), y down."""

    cx: float
    cy: float
    radius: float

    def checked(self, where: str) -> Circle:
        """The circle itself; raises `BadInput`, starting with `where`, for what is none."""
        if not np.isfinite(self).all() or self.radius <= 0:
            raise BadInput(f"{where}: {tuple(self)} is no circle; give cx, cy and a radius above 0")
        return self


def read_circle(path: Path) -> Circle:
    """The circle of a `sphere.json`: keys cx, cy and R; there the first pixel's centre is 0."""
    table = read_json(path, "cx, cy and R as JSON")
    for key in ("cx", "cy", "R"):
        if key not in table:
            table.fail(f'the key "{key}" is missing; give cx, cy and R')
    cx, cy = table.number("cx"), table.number("cy")
    return Circle(cx + 0.5, cy + 0.5, table.number("R", above=0.0)).checked(str(path))


def ball_gbuffer(circle: Circle, shape: tuple[int, int], mask: Mask | None = None) -> GBuffer:
    """The G-buffer of a ball behind a circle, orthographic, inside the mask if there is one.

    Positions are in units of the radius from the image's centre, x right, y up, z to the camera.
    """
    from diffshade.geometry.camera import OrthographicCamera
    from diffshade.geometry.sphere import Sphere

    height, width = shape
    right = (circle.cx - width / 2) / circle.radius
    up = (height / 2 - circle.cy) / circle.radius
    center: Any = (right, up, 0.0)
    camera = OrthographicCamera(width, height, width / circle.radius)
    return masked_gbuffer(Sphere(center), camera, mask)
