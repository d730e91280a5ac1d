"""Inputs of formulas, drawn at random: ordinary ones, grazing ones, and those where numbers cancel."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

__all__ = [
    "Draw",
    "Planes",
    "beside",
    "constants",
    "corners",
    "evenly",
    "eye",
    "grazing",
    "highlight",
    "light_and_point",
    "light_over_surface",
    "normal_and_light",
    "on_the_clamp",
    "pixel",
    "ray_to_ball",
    "scene_of",
    "spread",
    "together",
    "vectors",
]

Planes = Sequence[Any]
Draw = Callable[[np.random.Generator, int], Planes]


def directions(rng: np.random.Generator, count: int) -> np.ndarray:
    """Unit vectors [3, N]."""
    v = rng.normal(size=(3, count))
    return v / np.linalg.norm(v, axis=0)


def beside(rng: np.random.Generator, axis: np.ndarray, angle: Any) -> np.ndarray:
    """Unit vectors at an angle from others."""
    v = directions(rng, axis.shape[1])
    v -= axis * (axis * v).sum(0)
    return axis * np.cos(angle) + v / np.linalg.norm(v, axis=0) * np.sin(angle)


def any_length(rng: np.random.Generator, v: np.ndarray) -> np.ndarray:
    return v * rng.uniform(0.5, 2, v.shape[1])


def spread(low: float, high: float) -> Draw:
    """Numbers that are even in their logarithm."""
    return lambda rng, count: [np.exp(rng.uniform(np.log(low), np.log(high), count))]


def vectors(low: float, high: float) -> Draw:
    return lambda rng, count: [*(directions(rng, count) * spread(low, high)(rng, count)[0])]


def light_and_point(low: float, high: float) -> Draw:
    """A point of size 1, and a light at a distance from it."""

    def draw(rng: np.random.Generator, count: int) -> Planes:
        point = directions(rng, count)
        return [*(point + directions(rng, count) * spread(low, high)(rng, count)[0]), *point]

    return draw


def light_over_surface(low: float, high: float) -> Draw:
    """The same with the point's normal, on the light's side."""

    def draw(rng: np.random.Generator, count: int) -> Planes:
        planes = light_and_point(low, high)(rng, count)
        to_light = np.stack(planes[:3]) - np.stack(planes[3:])
        to_light /= np.linalg.norm(to_light, axis=0)
        return [*planes, *any_length(rng, beside(rng, to_light, rng.uniform(0.1, 1.4, count)))]

    return draw


def normal_and_light(low: float, high: float) -> Draw:
    """Two directions at angles from `low` to `high`."""

    def draw(rng: np.random.Generator, count: int) -> Planes:
        n = directions(rng, count)
        l = beside(rng, n, rng.uniform(low, high, count))
        return [*any_length(rng, n), *any_length(rng, l)]

    return draw


def highlight(exponents: Draw, low: float, high: float, incidence: float = 1.2) -> Draw:
    """n, l, v and an exponent: r from `low` to `high` widths 1 / sqrt(exponent) of the lobe from v."""

    def draw(rng: np.random.Generator, count: int) -> Planes:
        (shininess,) = exponents(rng, count)
        n = directions(rng, count)
        l = beside(rng, n, rng.uniform(0, incidence, count))
        r = n * 2 * (n * l).sum(0) - l
        angle = rng.uniform(low, high, count) / np.sqrt(shininess)
        return [*(x for v in (n, l, beside(rng, r, angle)) for x in any_length(rng, v)), shininess]

    return draw


def grazing(rng: np.random.Generator, count: int) -> Planes:
    """Light and view along the surface."""
    n = directions(rng, count)
    l = beside(rng, n, np.pi / 2 - rng.uniform(0.001, 0.02, count))
    v = beside(rng, n * 2 * (n * l).sum(0) - l, rng.uniform(0.05, 0.2, count))
    return [*(x for w in (n, l, v) for x in any_length(rng, w)), *spread(1, 200)(rng, count)]


def constants(low: float, high: float) -> Draw:
    """c0, c1, c2 and a distance, all of which matter; beyond the clamp."""

    def draw(rng: np.random.Generator, count: int) -> Planes:
        (d,) = spread(low, high)(rng, count)
        c0, c1, c2 = rng.uniform(1.1, 3, (3, count))
        return [c0, c1 / np.maximum(d, 1), c2 / np.maximum(d, 1) ** 2, d]

    return draw


def on_the_clamp(rng: np.random.Generator, count: int) -> Planes:
    """Denominators that are 1 to rounding."""
    d, c1, c2 = rng.uniform(0, 1, (3, count)) / 2
    return [1 - d * (c1 + d * c2), c1, c2, d]


def together(*draws: Draw) -> Draw:
    return lambda rng, count: [plane for draw in draws for plane in draw(rng, count)]


def evenly(low: float, high: float) -> Draw:
    return lambda rng, count: [rng.uniform(low, high, count)]


def pixel(size: float) -> Draw:
    return together(evenly(-size, size), evenly(-size, size))


def eye(low: float, high: float) -> Draw:
    """A place of a camera that does not look straight up or down."""

    def draw(rng: np.random.Generator, count: int) -> Planes:
        v = np.stack([*rng.uniform(-1, 1, (2, count)), np.ones(count)])
        return [*(v * spread(low, high)(rng, count)[0])]

    return draw


def ray_to_ball(distance: float, low: float, high: float) -> Draw:
    """A ray that passes the centre of the unit sphere at `low` to `high`."""

    def draw(rng: np.random.Generator, count: int) -> Planes:
        towards = directions(rng, count)
        origin = towards * -distance
        aside = beside(rng, towards, np.full(count, np.pi / 2)) * rng.uniform(low, high, count)
        return [*origin, *any_length(rng, aside - origin)]

    return draw


def corners(opening: float) -> Draw:
    """Weights of three, and three vectors within an angle of one; of 3.1, almost opposite."""

    def draw(rng: np.random.Generator, count: int) -> Planes:
        axis = directions(rng, count)
        angle = rng.uniform(0.9, 1, count) * opening / 2
        side = beside(rng, axis, angle)
        other = axis * 2 * (axis * side).sum(0) - side
        weights = np.stack([np.full(count, 0.5), rng.uniform(0.3, 0.5, count)])
        weights = np.concatenate([weights, 1 - weights.sum(0, keepdims=True)])
        return [*weights, *side, *other, *axis]

    return draw


def scene_of(lights: int, exponent: float, distance: tuple[float, float]) -> Draw:
    """A point of the unit sphere, its normal, the eye, constants, n, and lights in its highlight."""

    def draw(rng: np.random.Generator, count: int) -> Planes:
        n = directions(rng, count)
        v = beside(rng, n, rng.uniform(0, 1, count))
        r = n * 2 * (n * v).sum(0) - v
        planes = [*n, *any_length(rng, n), *(n + 6 * v)]
        planes += [np.full(count, c) for c in (1.0, 0.05, 0.02, exponent)]
        for _ in range(lights):
            l = beside(rng, r, np.abs(rng.normal(size=count)) / np.sqrt(exponent))
            planes += [*(n + l * spread(*distance)(rng, count)[0])]
        return planes

    return draw
