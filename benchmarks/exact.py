"""The formulas of the package in plain numbers of 50 digits, written from the texts, with `mpmath`."""

from collections.abc import Sequence
from typing import Any, TypeAlias

from mpmath import mp, mpf

__all__ = [
    "blinn_phong",
    "decode_srgb",
    "dot",
    "encode_srgb",
    "halfway",
    "orthographic",
    "perspective",
    "phong",
    "quadratic",
    "reflect",
    "shade",
    "sphere",
    "unit",
    "window",
]

mp.dps = 50
Number: TypeAlias = Any
Vector: TypeAlias = Sequence[Any]
"""Three of them."""


def dot(a: Vector, b: Vector) -> Number:
    """a.b"""
    return sum(x * y for x, y in zip(a, b, strict=True))


def unit(a: Vector) -> Vector:
    """a / |a|"""
    length = mp.sqrt(dot(a, a))
    return [x / length for x in a]


def reflect(l: Vector, n: Vector) -> Vector:
    """r = 2 (n.l) n - l"""
    twice = 2 * dot(n, l)
    return [twice * x - y for x, y in zip(n, l, strict=True)]


def halfway(l: Vector, v: Vector) -> Vector:
    """h = (l + v) / |l + v|"""
    return unit([x + y for x, y in zip(l, v, strict=True)])


def _power(cosine: Number, n_dot_l: Number, shininess: Number) -> Number:
    return cosine**shininess if cosine > 0 and n_dot_l > 0 else mpf(0)


def phong(n: Vector, l: Vector, v: Vector, shininess: Number) -> Number:
    """max(0, r.v)^n of unit vectors; 0 where n.l <= 0."""
    return _power(dot(reflect(l, n), v), dot(n, l), shininess)


def blinn_phong(n: Vector, l: Vector, v: Vector, shininess: Number) -> Number:
    """max(0, n.h)^n of unit vectors; 0 where n.l <= 0."""
    return _power(dot(n, halfway(l, v)), dot(n, l), shininess)


def quadratic(c0: Number, c1: Number, c2: Number, d: Number) -> Number:
    """min(1 / (c0 + c1 d + c2 d^2), 1)"""
    q = c0 + c1 * d + c2 * d * d
    return 1 / q if q > 1 else mpf(1)


def window(d: Number, reach: Number) -> Number:
    """max(0, 1 - (d/R)^4)^2"""
    return max(mpf(0), 1 - (d / reach) ** 4) ** 2


def _axes(position: Vector, target: Vector, up: Vector) -> tuple[Vector, Vector, Vector]:
    back = unit([x - y for x, y in zip(position, target, strict=True)])
    right = unit(_cross(up, back))
    return right, _cross(back, right), back


def _cross(a: Vector, b: Vector) -> Vector:
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


UP = (mpf(0), mpf(1), mpf(0))
ORIGIN = (mpf(0), mpf(0), mpf(0))


def perspective(x: Number, y: Number, fov: Number, position: Vector) -> Vector:
    """The direction of a ray: x to the right and y upwards, in heights of an image of the origin."""
    right, up, back = _axes(position, ORIGIN, UP)
    high = 2 * mp.tan(fov / 2)
    axes = zip(right, up, back, strict=True)
    return unit([r * x * high + u * y * high - b for r, u, b in axes])


def orthographic(x: Number, y: Number, extent: Number, position: Vector) -> Vector:
    """The origin of a ray: the same in widths."""
    right, up, _ = _axes(position, ORIGIN, UP)
    axes = zip(position, right, up, strict=True)
    return [p + (r * x + u * y) * extent for p, r, u in axes]


def sphere(origin: Vector, direction: Vector) -> Vector:
    """The normal where a ray, whose direction need not be a unit vector, meets the unit sphere."""
    d = unit(direction)
    along = dot(origin, d)
    depth = mp.sqrt(max(mpf(0), along**2 - dot(origin, origin) + 1))
    return [o - (along + depth) * x for o, x in zip(origin, d, strict=True)]


def encode_srgb(light: Number) -> Number:
    """IEC 61966-2-1."""
    if light <= mpf("0.0031308"):
        return mpf("12.92") * light
    return mpf("1.055") * light ** (mpf(5) / 12) - mpf("0.055")


def decode_srgb(value: Number) -> Number:
    """The way back."""
    if value <= mpf("0.04045"):
        return value / mpf("12.92")
    return ((value + mpf("0.055")) / mpf("1.055")) ** (mpf(12) / 5)


def shade(
    point: Vector,
    normal: Vector,
    eye: Vector,
    lights: Sequence[Vector],
    constants: Vector,
    coefficients: Vector,
) -> Number:
    """LIGHT-13 of lights of intensity 1, with (ka, kd, ks, n) and I_a = 1; the normal of any length."""
    ka, kd, ks, shininess = coefficients
    n = unit(normal)
    v = unit([e - p for e, p in zip(eye, point, strict=True)])
    total = ka
    for light in lights:
        s = [x - p for x, p in zip(light, point, strict=True)]
        l, d = unit(s), mp.sqrt(dot(s, s))
        diffuse = max(mpf(0), dot(n, l))
        total += quadratic(*constants, d) * (kd * diffuse + ks * phong(n, l, v, shininess))
    return total
