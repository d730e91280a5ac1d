"""Hard scenes to render: the image against the plain model in double precision, and its gradient.

The exact image is that of the points and normals of our own G-buffer, which others test; where the plain
model divides by zero, the image that the equations mean is written out.
"""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from reference import shade, unit
from stress.hard_scene import HardScene, Verdict, precision, timed

import diffshade as ds

__all__ = [
    "PLAIN",
    "SCENES",
    "but",
    "exact",
    "from_afar",
    "light",
    "masked",
    "scene_of",
    "with_one_lit",
]

ABOVE = (0.8, 0.5, 2.5)
PLAIN = {"ka": 0.1, "kd": 0.6, "ks": 0.3, "shininess": 20.0}
ROUNDING = {np.float32: 5e-6, np.float64: 1e-12}
"""Of the image's maximum."""


def light(place: Any, law: Any = None, intensity: float = 1.0) -> dict[str, Any]:
    """A point light of the plain model; `law` are c0, c1, c2."""
    constants = None if law is None else dict(zip(("c0", "c1", "c2"), law, strict=True))
    return {"kind": "point", "position": place, "intensity": intensity, "attenuation": constants}


def from_afar(direction: Any) -> dict[str, Any]:
    """A parallel light of the plain model."""
    return {"kind": "parallel", "direction": direction, "intensity": 1.0}


def scene_of(lights: Any, ambient: float | None = 0.5) -> ds.Scene:
    """The lights of the plain model as ours."""
    ours: list[Any] = []
    for given in lights:
        if given["kind"] == "parallel":
            ours.append(ds.ParallelLight(given["direction"], given["intensity"]))
        else:
            law = given["attenuation"]
            law = None if law is None else ds.QuadraticAttenuation(**law)
            ours.append(ds.PointLight(given["position"], given["intensity"], law))
    return ds.Scene(ambient, ours)


def material_of(plain: Any) -> ds.Material:
    """A material of the plain model as ours."""
    return ds.Material(plain["ka"], plain["kd"], ds.Phong(plain["ks"], plain["shininess"]))


def as_given(values: Any) -> Any:
    """Numbers as our precision holds them."""
    return np.asarray(values, precision()).astype(np.float64)


def exact(gbuffer: ds.GBuffer, lights: Any, plain: Any, ambient: float | None = 0.5) -> np.ndarray:
    """The image [H, W, 3] by the plain model."""
    image = np.zeros((*gbuffer.shape, 3))
    position, normal = (
        np.asarray(p.to_array(), np.float64) for p in (gbuffer.position, gbuffer.normal)
    )
    view = np.asarray(gbuffer.viewer.direction(gbuffer.position).to_array(), np.float64)
    given = [
        {
            name: as_given(value) if name in ("position", "direction", "intensity") else value
            for name, value in each.items()
        }
        for each in lights
    ]
    numbers = {name: as_given(value) for name, value in plain.items()}
    image[np.asarray(gbuffer.mask)] = shade(
        position,
        unit(normal),
        np.broadcast_to(unit(view), position.shape),
        given,
        numbers,
        ambient=0.0 if ambient is None else ambient,
    )
    return image


@jax.jit
def slopes_of(gbuffer: ds.GBuffer, scene: ds.Scene, material: ds.Material) -> Any:
    """The gradient of the image's sum, by all that a scene and a material hold."""

    def total(scene: ds.Scene, material: ds.Material) -> jax.Array:
        return ds.render(gbuffer, scene, material).sum()

    return jax.grad(total, argnums=(0, 1))(scene, material)


def compared(
    gbuffer: ds.GBuffer, scene: ds.Scene, material: ds.Material, known: np.ndarray
) -> Verdict:
    """The image and its gradient."""
    image, seconds = timed(lambda: np.asarray(ds.render(gbuffer, scene, material), np.float64))
    slopes, more = timed(lambda: slopes_of(gbuffer, scene, material))
    for name, numbers in (("the image", image), ("a gradient", slopes)):
        if not all(np.isfinite(x).all() for x in jax.tree.leaves(numbers)):
            return Verdict("not finite", name)
    brightest = float(np.abs(known).max(initial=0))
    error = float(np.abs(image - known).max(initial=0)) / (brightest or 1.0)
    kind = "right" if error <= ROUNDING[precision()] else "wrong"
    return Verdict(kind, f"within {error:.1e} of the maximum {brightest:.3g}", seconds + more)


def rendered(
    lights: Any,
    plain: Any = PLAIN,
    *,
    ambient: float | None = 0.5,
    center: Any = (0.0, 0.0, 0.0),
    pixels: tuple[int, int] = (64, 64),
    change: Callable[[ds.GBuffer], ds.GBuffer] = lambda g: g,
    known: Callable[[ds.GBuffer], np.ndarray] | None = None,
) -> Callable[[], Verdict]:
    """A scene, against the plain model or an image that is known."""

    def attempt() -> Verdict:
        gbuffer = change(ds.gbuffer(ds.Sphere(center), ds.OrthographicCamera(*pixels, 2.2)))
        image = exact(gbuffer, lights, plain, ambient) if known is None else known(gbuffer)
        return compared(gbuffer, scene_of(lights, ambient), material_of(plain), image)

    return attempt


def ground(points: Any) -> Callable[[ds.GBuffer], ds.GBuffer]:
    """A row of points of the plane z = 0, in place of what the camera sees."""

    def change(_: ds.GBuffer) -> ds.GBuffer:
        position = np.zeros((1, len(points), 3), precision())
        position[0, :, 0] = points
        normal = position * 0 + np.eye(3, dtype=precision())[2]
        mask = np.ones(position.shape[:2], bool)
        return ds.GBuffer.from_arrays(position, normal, mask, view=(0, 0, 1))

    return change


def everywhere(value: float) -> Callable[[ds.GBuffer], np.ndarray]:
    """One value in every pixel."""
    return lambda gbuffer: np.full((*gbuffer.shape, 3), value)


def with_one_lit(gbuffer: ds.GBuffer) -> ds.GBuffer:
    """All normals away from the light but the one in the middle."""
    shape = gbuffer.shape
    normal = np.zeros((*shape, 3), precision())
    normal[..., 2] = -1
    normal[shape[0] // 2, shape[1] // 2, 2] = 1
    return ds.GBuffer.from_arrays(normal * 0, normal, np.ones(shape, bool), view=(0, 0, 1))


def masked(*pixels: tuple[int, int]) -> Callable[[ds.GBuffer], ds.GBuffer]:
    """Of the ball only these pixels."""

    def change(gbuffer: ds.GBuffer) -> ds.GBuffer:
        mask = np.zeros(gbuffer.shape, bool)
        for pixel in pixels:
            mask[pixel] = True
        planes = np.zeros((2, *gbuffer.shape, 3), precision())
        for plane, values in zip(planes, (gbuffer.position, gbuffer.normal), strict=True):
            plane[np.asarray(gbuffer.mask)] = values.to_array()
        return ds.GBuffer.from_arrays(*planes, mask, view=(0, 0, 1))

    return change


def but(**values: Any) -> dict[str, Any]:
    """The plain material with other values."""
    return PLAIN | values


def huge(size: int) -> Callable[[], Verdict]:
    """An image of so many pixels a side, against the plain model at some of them."""

    def attempt() -> Verdict:
        lights = [light(ABOVE, (1.0, 0.1, 0.05))]

        def ours() -> jax.Array:
            gbuffer = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(size, size, 2.2))
            return ds.render(gbuffer, scene_of(lights), material_of(PLAIN))

        image, seconds = timed(ours)
        if not bool(jax.numpy.isfinite(image).all()):
            return Verdict("not finite", "the image")
        rows = np.arange(0, size, max(size // 16, 1))
        pixel = 2.2 / size
        x = (np.arange(size) + 0.5 - size / 2) * pixel
        y = (size / 2 - rows - 0.5) * pixel
        square = 1 - x[None] ** 2 - y[:, None] ** 2
        inside = square > 1e-3
        points = np.stack(
            [
                np.broadcast_to(x[None], square.shape)[inside],
                np.broadcast_to(y[:, None], square.shape)[inside],
                np.sqrt(square[inside]),
            ],
            axis=-1,
        )
        view = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
        known = shade(points, points, view, lights, PLAIN, ambient=0.5)
        error = float(np.abs(np.asarray(image[rows])[inside] - known).max() / known.max())
        # The points are those of exact pixels: rounding of the G-buffer's is in it.
        kind = "right" if error <= 20 * ROUNDING[precision()] else "wrong"
        return Verdict(kind, f"within {error:.1e} of the maximum", seconds)

    return attempt


LAMP = [light(ABOVE)]
HEAD = [from_afar((0.004, -0.002, 1.0))]

RIGHT = {
    "grazing light": rendered([from_afar((1.0, 0.0, 1e-4))]),
    "light along the surface": rendered(
        [from_afar((1.0, 0.0, 0.0))], change=ground([0.0, 1.0]), known=everywhere(0.05)
    ),
    "all in shadow": rendered([from_afar((0.0, 0.0, -1.0))], ambient=None),
    "highlight of one pixel, n = 1e5": rendered(
        HEAD, but(kd=0.0, shininess=1e5), ambient=None, pixels=(65, 65)
    ),
    "n = 1": rendered(LAMP, but(shininess=1.0)),
    "n = 0": rendered(LAMP, but(shininess=0.0)),
    "no highlight": rendered(LAMP, but(ks=0.0)),
    "light at a point of the surface": rendered(
        [light((1.0, 0.0, 0.0))], change=ground([0.0, 1.0, 2.0]), known=everywhere(0.05)
    ),
    "light 1e-5 above the surface": rendered(
        [light((1.0, 0.0, 1e-5), (0.5, 0.0, 1.0))], change=ground([0.0, 1.0 - 1e-5, 1.0, 2.0])
    ),
    "light at 1e6": rendered([light((6e5, 0.0, 8e5))]),
    "constants of attenuation zero": rendered(
        [light(ABOVE, (0.0, 0.0, 0.0))], known=lambda g: exact(g, LAMP, PLAIN)
    ),
    "constants of attenuation huge": rendered([light(ABOVE, (1e6, 1e6, 1e6))], ambient=None),
    "coefficients of 0": rendered(LAMP, but(ka=0.0, kd=0.0, ks=0.0)),
    "coefficients of 1": rendered(LAMP, but(ka=1.0, kd=1.0, ks=1.0)),
    "one lit pixel": rendered(HEAD, change=with_one_lit),
    "mask of one pixel": rendered(LAMP, change=masked((30, 33))),
    "a surface out of sight": rendered(LAMP, center=(9.0, 0.0, 0.0)),
    "1 x 1": rendered(LAMP, pixels=(1, 1)),
    "1 x 4096": rendered(LAMP, pixels=(4096, 1)),
    "ten identical lights": rendered(10 * LAMP),
}

SCENES = (
    *(HardScene(name, "right", attempt) for name, attempt in RIGHT.items()),
    HardScene("empty mask", "refused", rendered(LAMP, change=masked())),
    HardScene("8192 x 8192", "right", huge(8192), large=True),
)
