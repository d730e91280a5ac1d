"""Every formula of the package beside the same in 50 digits, and how far apart they may be.

A formula takes planes of numbers and gives one plane, or a few. It is asked over strata of inputs, which
are drawn anew for each precision, so that they are exact in it. An error is the largest difference of
any output, in units in the last place of the largest output or of `floor`, whichever is more: the
cosine of a right angle cannot be known to a part of itself. That of the derivatives is the same of
all partial derivatives of a point. The bounds hold in float32 and in float64 alike.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from mpmath import mp

import diffshade as ds
from benchmarks import exact
from benchmarks.inputs import (
    Draw,
    constants,
    corners,
    evenly,
    eye,
    grazing,
    highlight,
    light_and_point,
    light_over_surface,
    normal_and_light,
    on_the_clamp,
    pixel,
    ray_to_ball,
    scene_of,
    spread,
    together,
    vectors,
)
from diffshade.geometry.camera import Rays
from diffshade.geometry.surface import Visibility
from diffshade.io.encoding import decode, encode_srgb
from diffshade.reflectance.blinn_phong import blinn_phong
from diffshade.reflectance.lambert import lambert
from diffshade.reflectance.phong import phong
from diffshade.vector import Vec3, dot, unit

__all__ = ["FORMULAS", "Formula", "Stratum"]


class Stratum(NamedTuple):
    """A kind of input, and the bounds on the error there: of values, and of derivatives if asked."""

    name: str
    draw: Draw
    value: float
    derivative: float | None = None


class Formula(NamedTuple):
    """One formula. `floor` is the size below which an output's error is told in absolute terms."""

    name: str
    ours: Callable[..., Any]
    exact: Callable[..., Any]
    strata: tuple[Stratum, ...]
    floor: float = 0.0
    traced: bool = True
    """Whether `ours` is JAX's, to be compiled and differentiated."""


# Ours, of one point, and the same in 50 digits


def ours_light(*x: Any) -> Any:
    return ds.PointLight(jnp.stack(x[:3]), 1.0, ds.InverseSquare()).incidence(Vec3(*x[3:6]))


def exact_light(*x: Any) -> Any:
    s = [a - b for a, b in zip(x[:3], x[3:6], strict=True)]
    return exact.unit(s), mp.sqrt(exact.dot(s, s))


def ours_lobe(f: Callable[..., Any], *x: Any) -> Any:
    n, l, v = (unit(Vec3(*x[k : k + 3])) for k in (0, 3, 6))
    return f(n, l, v, dot(n, l), x[9])


def exact_lobe(f: Callable[..., Any], *x: Any) -> Any:
    return f(*(exact.unit(x[k : k + 3]) for k in (0, 3, 6)), x[9])


def ours_rays(x: Any, y: Any, fov: Any, *position: Any) -> Any:
    return ds.PerspectiveCamera(1, 1, fov, jnp.stack(position)).through(x, y).direction


def ours_origins(x: Any, y: Any, extent: Any, *position: Any) -> Any:
    camera = ds.OrthographicCamera(1, 1, extent, position=jnp.stack(position))
    return camera.through(x, y).origin


def ours_sphere(*x: Any) -> Any:
    seen = Visibility((1, 1), jnp.zeros(1, jnp.int32))
    planes = [component[None] for component in x]
    return ds.Sphere().points(Rays(Vec3(*planes[:3]), unit(Vec3(*planes[3:]))), seen)[1]


def ours_mesh(*x: Any) -> Any:
    """Position and normal at a point of a triangle whose vertices are its normals too."""
    vertices = jnp.stack(x[3:]).reshape(3, 3)
    mesh = ds.Mesh(vertices, np.array([[0, 1, 2]], np.int32), vertices)
    first = jnp.zeros(1, jnp.int32)
    weights = Vec3(*(w[None] for w in x[:3]))
    return mesh.points(
        Rays(Vec3(*x[3:6]), Vec3(*x[3:6])), Visibility((1, 1), first, first, weights)
    )


def exact_position(*x: Any) -> Any:
    corners = [x[k : k + 3] for k in (3, 6, 9)]
    return [exact.dot(x[:3], axis) for axis in zip(*corners, strict=True)]


def exact_normal(*x: Any) -> Any:
    normals = [exact.unit(x[k : k + 3]) for k in (3, 6, 9)]
    return exact.unit([exact.dot(x[:3], axis) for axis in zip(*normals, strict=True)])


def ours_scene(*x: Any) -> Any:
    image_of = [jnp.stack(x[k : k + 3])[None, None] for k in (0, 3)]
    gbuffer = ds.GBuffer.from_arrays(*image_of, np.ones((1, 1), bool), eye=jnp.stack(x[6:9]))
    law = ds.QuadraticAttenuation(*x[9:12])
    lights = [ds.PointLight(jnp.stack(x[k : k + 3]), 1.0, law) for k in range(13, len(x), 3)]
    material = ds.Material(ka=0.125, kd=0.5, specular=ds.Phong(0.5, x[12]))
    return ds.render(gbuffer, ds.Scene(1.0, tuple(lights)), material)


def exact_scene(*x: Any) -> Any:
    lights = [x[k : k + 3] for k in range(13, len(x), 3)]
    return exact.shade(x[:3], x[3:6], x[6:9], lights, x[9:12], (0.125, 0.5, 0.5, x[12]))


COSINES = (
    Stratum("ordinary", normal_and_light(0.1, 1.2), 2, 3.5),
    Stratum("grazing", normal_and_light(1.57, 1.5707), 0.9, 3.5),
)


def lobe_strata(*bounds: float) -> tuple[Stratum, ...]:
    """Those of a lobe, with their bounds in order."""
    to_200, slope_to_200, to_1e5, slope_to_1e5, peak, along, slope_along = bounds
    return (
        Stratum("n to 200", highlight(spread(1, 200), 0.2, 2), to_200, slope_to_200),
        Stratum("n to 1e5", highlight(spread(200, 1e5), 0.2, 2), to_1e5, slope_to_1e5),
        Stratum("at the peak, n to 1e5", highlight(spread(1, 1e5), 0, 1e-6), peak),
        Stratum("grazing", grazing, along, slope_along),
    )


FORMULAS = (
    Formula(
        "unit vector",
        lambda *x: unit(Vec3(*x)),
        lambda *x: exact.unit(x),
        (
            Stratum("ordinary", vectors(0.5, 2), 2.5, 4.5),
            Stratum("1e-6 to 1e6", vectors(1e-6, 1e6), 2.5, 4),
        ),
    ),
    Formula(
        "direction to a light",
        lambda *x: ours_light(*x).l,
        lambda *x: exact_light(*x)[0],
        (
            Stratum("ordinary", light_and_point(0.5, 5), 3, 4),
            Stratum("distance 1e-6 to 1", light_and_point(1e-6, 1), 2.5, 3.5),
            Stratum("distance to 1e6", light_and_point(1, 1e6), 2.5, 4),
        ),
    ),
    Formula(
        "distance to a light",
        lambda *x: ours_light(*x).distance,
        lambda *x: exact_light(*x)[1],
        (
            Stratum("ordinary", light_and_point(0.5, 5), 3, 3.5),
            Stratum("distance 1e-6 to 1", light_and_point(1e-6, 1), 3, 4),
            Stratum("distance to 1e6", light_and_point(1, 1e6), 2.5, 3.5),
        ),
    ),
    Formula(
        "Lambert",
        lambda *x: lambert(dot(unit(Vec3(*x[:3])), unit(Vec3(*x[3:])))),
        lambda *x: exact.dot(exact.unit(x[:3]), exact.unit(x[3:])),
        COSINES,
        floor=1,
    ),
    Formula(
        "Lambert of a point light",
        lambda *x: lambert(dot(unit(Vec3(*x[6:])), ours_light(*x).l)),
        lambda *x: exact.dot(exact.unit(x[6:]), exact_light(*x)[0]),
        (
            Stratum("ordinary", light_over_surface(0.5, 5), 2.5, 3.5),
            Stratum("almost touching", light_over_surface(1e-6, 1e-3), 2.5, 60),
        ),
        floor=1,
    ),
    Formula(
        "Phong",
        partial(ours_lobe, phong),
        partial(exact_lobe, exact.phong),
        lobe_strata(20, 150, 350, 2500, 0.5, 6, 90),
        floor=1,
    ),
    Formula(
        "Blinn-Phong",
        partial(ours_lobe, blinn_phong),
        partial(exact_lobe, exact.blinn_phong),
        lobe_strata(7, 90, 150, 2500, 0.5, 50, 800),
        floor=1,
    ),
    Formula(
        "quadratic attenuation",
        lambda c0, c1, c2, d: ds.QuadraticAttenuation(c0, c1, c2)(d),
        exact.quadratic,
        (
            Stratum("ordinary", constants(0.1, 10), 2, 6),
            Stratum("distance 1e-6 to 1e6", constants(1e-6, 1e6), 2, 6),
            Stratum("on the clamp", on_the_clamp, 0.9),
        ),
    ),
    Formula(
        "linear attenuation",
        lambda c0, c1, d: ds.LinearAttenuation(c0, c1)(d),
        lambda c0, c1, d: 1 / (c0 + c1 * d),
        (Stratum("1e-6 to 1e6", together(*[spread(1e-6, 1e6)] * 3), 2, 4),),
    ),
    Formula(
        "inverse square",
        lambda d: ds.InverseSquare()(d),
        lambda d: 1 / d**2,
        (Stratum("1e-6 to 1e6", spread(1e-6, 1e6), 2, 4.5),),
    ),
    Formula(
        "exponential attenuation",
        lambda a, d: ds.ExponentialAttenuation(a)(d),
        lambda a, d: mp.exp(-a * d),
        (
            Stratum("ordinary", together(spread(0.1, 2), spread(0.01, 1)), 1.5, 2),
            Stratum("to e^-64", together(spread(1, 8), spread(1, 8)), 45, 45),
        ),
    ),
    Formula(
        "window",
        lambda d, reach: ds.Windowed(ds.LinearAttenuation(1.0, 0.0), reach)(d),
        exact.window,
        (
            Stratum("within", together(evenly(0, 2), evenly(2, 3)), 2.5, 5),
            Stratum("where it ends", together(evenly(1.99, 2.01), evenly(1.99, 2.01)), 0.5, 20),
        ),
        floor=1,
    ),
    Formula(
        "perspective ray",
        ours_rays,
        lambda x, y, fov, *p: exact.perspective(x, y, fov, p),
        (Stratum("ordinary", together(pixel(0.5), evenly(0.2, 2), eye(2, 10)), 3, 5),),
    ),
    Formula(
        "orthographic ray",
        ours_origins,
        lambda x, y, extent, *p: exact.orthographic(x, y, extent, p),
        (Stratum("ordinary", together(pixel(0.5), evenly(1, 3), eye(2, 10)), 1.5, 4.5),),
    ),
    Formula(
        "sphere, normal",
        ours_sphere,
        lambda *x: exact.sphere(x[:3], x[3:]),
        (
            Stratum("from 6 away", ray_to_ball(6, 0, 0.9), 10, 15),
            Stratum("from 100 away", ray_to_ball(100, 0, 0.9), 150, 150),
            Stratum("near the outline", ray_to_ball(6, 0.99, 0.999), 25, 150),
        ),
    ),
    Formula(
        "barycentric interpolation",
        lambda *x: ours_mesh(*x)[0],
        exact_position,
        (
            Stratum("ordinary", corners(1.0), 0.9, 0.5),
            Stratum("cancelling", corners(3.1), 0.5, 0.5),
        ),
        floor=1,
    ),
    Formula(
        "interpolated normal",
        lambda *x: ours_mesh(*x)[1],
        exact_normal,
        (Stratum("ordinary", corners(1.0), 2, 4.5), Stratum("cancelling", corners(3.1), 15, 15)),
        floor=1,
    ),
    Formula(
        "LIGHT-13, 1 light",
        ours_scene,
        exact_scene,
        (
            Stratum("n = 32", scene_of(1, 32, (1, 5)), 3, 60),
            Stratum("n = 200", scene_of(1, 200, (1, 5)), 7, 350),
            Stratum("n = 1e5", scene_of(1, 1e5, (1, 5)), 150),
            Stratum("light at 1e-3", scene_of(1, 200, (1e-3, 2e-3)), 15),
            Stratum("light at 1e6", scene_of(1, 200, (1e5, 1e6)), 0.5),
        ),
        floor=1,
    ),
    Formula(
        "LIGHT-13, 16 lights",
        ours_scene,
        exact_scene,
        (
            Stratum("n = 32", scene_of(16, 32, (1, 5)), 3),
            Stratum("n = 200", scene_of(16, 200, (1, 5)), 6),
        ),
        floor=1,
    ),
    Formula(
        "sRGB",
        encode_srgb,
        exact.encode_srgb,
        (
            Stratum("dark", evenly(0, 0.0031), 0.9),
            Stratum("bright", evenly(0.0032, 1), 4),
            Stratum("to 1e4", spread(1, 1e4), 4),
        ),
        traced=False,
    ),
    Formula(
        "sRGB, decoded",
        partial(decode, encoding="srgb"),
        exact.decode_srgb,
        (Stratum("dark", evenly(0, 0.04), 0.9), Stratum("bright", evenly(0.041, 1), 8)),
        traced=False,
    ),
    Formula(
        "gamma 2.2, decoded",
        partial(decode, encoding=2.2),
        lambda v: v ** mp.mpf(2.2),
        (Stratum("ordinary", evenly(0.01, 1), 4.5),),
        traced=False,
    ),
)
