"""Cameras: which ray each pixel looks along.

World axes: x right, y up, z towards an orthographic camera that looks along -z. Image row 0 is the
top; the centre of the pixel in row i, column j is (j + 0.5, i + 0.5) in pixels from the top left.
"""

import dataclasses
import math
from abc import abstractmethod
from typing import NamedTuple, Self, SupportsIndex

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from diffshade.arrays import ArrayLike, optional, vector
from diffshade.errors import BadInput
from diffshade.geometry.fields import count, number
from diffshade.geometry.viewer import AbstractViewer, DistantViewer, Eye
from diffshade.vector import Vec3, cross, direction, unit

__all__ = ["AbstractCamera", "Frame", "OrthographicCamera", "PerspectiveCamera", "Rays"]


class Rays(NamedTuple):
    """Points origin + t direction, with unit directions; constant components may be numbers."""

    origin: Vec3
    direction: Vec3


class Frame(NamedTuple):
    """An image's size in pixels, and that of the side which the field of view is measured along.

    A program that is given it as an argument, beside a camera that is `unframed`, is one for images
    of all sizes.
    """

    width: int | Int[Array, ""]
    height: int | Int[Array, ""]
    side: int | Int[Array, ""]

    def points(
        self, index: Int[Array, "P"], dtype: jnp.dtype
    ) -> tuple[Float[Array, "P"], Float[Array, "P"]]:
        """Pixel centres from the image's centre, in sides: to the right, and upwards."""
        across = jnp.asarray(self.width, index.dtype)
        row = lax.div(index, across)  # numbers are not negative, which jnp.divmod cannot know
        column = index - row * across
        width, height, side = (jnp.asarray(size, dtype) for size in self)
        x = column.astype(dtype) + (0.5 - width / 2)
        y = (height / 2 - 0.5) - row.astype(dtype)
        return x / side, y / side


class AbstractCamera(eqx.Module):
    """An image of `height` rows and `width` columns, and a ray through each pixel's centre."""

    width: eqx.AbstractVar[int]
    height: eqx.AbstractVar[int]
    position: eqx.AbstractVar[Float[Array, "3"] | None]
    target: eqx.AbstractVar[Float[Array, "3"] | None]
    up: eqx.AbstractVar[Float[Array, "3"]]

    @property
    @abstractmethod
    def viewer(self) -> AbstractViewer:
        """The observer that this camera is."""

    @property
    @abstractmethod
    def frame(self) -> Frame:
        """The image's size, and the side that the field of view is measured along."""

    @abstractmethod
    def through(self, x: Float[Array, "P"], y: Float[Array, "P"]) -> Rays:
        """The rays through points of the image, as `Frame.points` gives them."""

    def rays(self, index: Int[Array, "P"]) -> Rays:
        """The rays through the centres of pixels, numbered row by row."""
        return self.through(*self.frame.points(index, self.up.dtype))

    def unframed(self) -> Self:
        """The camera with an image of one pixel, the same for all sizes: `through` is as it was."""
        return dataclasses.replace(self, width=1, height=1)

    @abstractmethod
    def check(self) -> None:
        """Raise `BadInput` where the values, which are concrete here, make no picture."""

    def axes(self) -> tuple[Vec3, Vec3, Vec3]:
        """Unit vectors to the right of the image, to its top, and towards the viewer."""
        return _axes(self.position, self.target, self.up)

    def _check_axes(self) -> None:
        right, _, back = np.asarray(_axis_rows(self.position, self.target, self.up))
        if not back.any():
            raise BadInput("the camera's position and target are the same point: move one of them")
        if not right.any():
            raise BadInput(
                f"the camera looks along its own up direction, {_brief(self.up)}: give another up"
            )


def _axes(
    position: Float[Array, "3"] | None, target: Float[Array, "3"] | None, up: Float[Array, "3"]
) -> tuple[Vec3, Vec3, Vec3]:
    here = jnp.zeros_like(up) if position is None else position
    if target is None:
        towards = jnp.array([0, 0, 1], here.dtype) if position is None else here
    else:
        towards = here - target
    back = direction(Vec3.from_array(towards))
    right = direction(cross(unit(Vec3.from_array(up)), back))
    return right, cross(back, right), back


@jax.jit
def _axis_rows(
    position: Float[Array, "3"] | None, target: Float[Array, "3"] | None, up: Float[Array, "3"]
) -> Float[Array, "3 3"]:
    """The axes as rows, in one program: one after the other each operation would be compiled."""
    return jnp.stack([axis.to_array() for axis in _axes(position, target, up)])


class OrthographicCamera(AbstractCamera):
    """Parallel rays; `extent` is the image's width in world units, and pixels are square.

    Without `position` it looks along -z, centred on the z axis, from in front of everything. With
    one it sees what lies before that point, towards `target` (the origin, where none is given), with
    `up` to the top of the image.

    >>> OrthographicCamera(width=512, height=512, extent=2.4).width
    512
    """

    width: int = eqx.field(static=True, converter=count("width"))
    height: int = eqx.field(static=True, converter=count("height"))
    extent: Float[Array, ""] = eqx.field(converter=number("extent"))
    position: Float[Array, "3"] | None = eqx.field(
        converter=optional(vector("the camera's position"))
    )
    target: Float[Array, "3"] | None = eqx.field(converter=optional(vector("target")))
    up: Float[Array, "3"] = eqx.field(converter=vector("up"))

    def __init__(
        self,
        width: SupportsIndex,
        height: SupportsIndex,
        extent: ArrayLike,
        *,
        position: ArrayLike | None = None,
        target: ArrayLike | None = None,
        up: ArrayLike = (0.0, 1.0, 0.0),
    ) -> None:
        if position is None and target is not None:
            raise BadInput("an orthographic camera has a target and no position: give both")
        self.width, self.height = count("width")(width), count("height")(height)
        self.extent = number("extent")(extent)
        self.position = optional(vector("the camera's position"))(position)
        self.target = optional(vector("target"))(target)
        self.up = vector("up")(up)

    @property
    def viewer(self) -> DistantViewer:
        return DistantViewer(self.axes()[2].to_array())

    @property
    def frame(self) -> Frame:
        return Frame(self.width, self.height, side=self.width)

    def through(self, x: Float[Array, "P"], y: Float[Array, "P"]) -> Rays:
        right, up, back = self.axes()
        centre = jnp.zeros_like(self.up) if self.position is None else self.position
        return Rays(
            Vec3.from_array(centre) + right * (x * self.extent) + up * (y * self.extent),
            -back,
        )

    def check(self) -> None:
        if not float(self.extent) > 0:
            raise BadInput(f"extent is {float(self.extent):g}: the image's width must be above 0")
        self._check_axes()


class PerspectiveCamera(AbstractCamera):
    """Rays through one point; `fov` is the vertical field of view in radians, in (0, pi).

    >>> PerspectiveCamera(640, 480, 0.7, position=(0, 0, 5), target=(0, 0, 0)).height
    480
    """

    width: int = eqx.field(static=True, converter=count("width"))
    height: int = eqx.field(static=True, converter=count("height"))
    # mypy places inherited fields, two of them with defaults, before this one; Equinox does not
    fov: Float[Array, ""] = eqx.field(converter=number("fov"))  # type: ignore[misc]
    position: Float[Array, "3"] = eqx.field(converter=vector("the camera's position"))
    target: Float[Array, "3"] = eqx.field(converter=vector("target"), default=(0.0, 0.0, 0.0))
    up: Float[Array, "3"] = eqx.field(converter=vector("up"), default=(0.0, 1.0, 0.0))

    @property
    def viewer(self) -> Eye:
        return Eye(self.position)

    @property
    def frame(self) -> Frame:
        return Frame(self.width, self.height, side=self.height)

    def through(self, x: Float[Array, "P"], y: Float[Array, "P"]) -> Rays:
        right, up, back = self.axes()
        high = 2 * jnp.tan(self.fov / 2)  # the image at distance 1
        through = direction(right * (x * high) + up * (y * high) - back)
        return Rays(Vec3.from_array(self.position), through)

    def check(self) -> None:
        if not 0 < float(self.fov) < math.pi:
            raise BadInput(
                f"fov is {float(self.fov):g}: a vertical field of view lies between 0 and pi radians"
                " (60 degrees are 1.047)"
            )
        self._check_axes()


def _brief(vector: Float[Array, "3"]) -> str:
    return "(" + ", ".join(f"{float(component):g}" for component in vector) + ")"
