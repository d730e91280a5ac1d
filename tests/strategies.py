"""Hypothesis strategies for what the public functions take, many cases at a draw.

Hypothesis draws a palette of numbers and a seed; NumPy deals them out over the cases. So one program
computes all cases of a draw, and a failure shrinks to a small palette. A strategy gives a dictionary of
arrays [count, ...]: what a case consists of. Numbers are of every size that the documentation allows
(`diffshade.guard` says which), with both zeros, what is below the smallest normal number, and exact
ties: a light at the surface, in its tangent plane, behind it or mirrored into the eye, and others.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import strategies as st

__all__ = [
    "Cases",
    "Deck",
    "attenuations",
    "cameras",
    "captures",
    "colours",
    "decks",
    "lights",
    "materials",
    "meshes",
    "normals",
    "points",
    "scenes",
    "spheres",
    "vectors",
]

Cases = dict[str, np.ndarray]

LONGEST = {"float32": 1e6, "float64": 1e40}
"""The largest coordinate, attenuation constant and reach; its reciprocal is the least radius."""
BRIGHTEST = {"float32": 1e3, "float64": 1e20}
"""The largest intensity."""
LARGEST = {"float32": 10.0, "float64": 1e20}
"""The largest coefficient and colour."""
SHARPEST = 1e5
"""The largest shininess."""
ROUGHNESS = (1e-3, 2.0)
"""The least and the largest alpha of microfacets."""


class Deck:
    """Numbers of one type for `count` cases."""

    def __init__(self, palette: list[float], seed: int, count: int, dtype: Any) -> None:
        self.rng, self.count, self.dtype = np.random.default_rng(seed), count, np.dtype(dtype)
        self.info = np.finfo(self.dtype)
        self.longest, self.brightest = LONGEST[self.dtype.name], BRIGHTEST[self.dtype.name]
        self.palette = np.array(palette, self.dtype)

    def numbers(self, *shape: int, most: float | None = None) -> np.ndarray:
        """[count, *shape] numbers of any size up to `most`, the longest length, of either sign."""
        most = self.longest if most is None else most
        size = (self.count, *shape)
        ordinary = self.rng.uniform(-2, 2, size)
        lowest, highest = float(np.log10(self.info.tiny)), float(np.log10(most))
        scaled = self.signs(size) * 10.0 ** self.rng.uniform(lowest, highest, size)
        near_one = self.signs(size) * (1 + self.rng.integers(-4, 5, size) * self.info.eps)
        of_palette = np.clip(self.rng.choice(self.palette, size), -most, most)
        ties = (0.0, -0.0, 1.0, -1.0, 0.5, most, -most, float(self.info.smallest_subnormal))
        exact = self.rng.choice(np.array(ties, self.dtype), size)
        kinds = self.rng.integers(0, 5, size)
        chosen = np.choose(kinds, [ordinary, scaled, near_one, of_palette, exact])
        return np.clip(chosen, -most, most).astype(self.dtype)

    def positive(self, *shape: int, most: float | None = None) -> np.ndarray:
        """The same, none below zero."""
        return np.abs(self.numbers(*shape, most=most))

    def lengths(self, *shape: int) -> np.ndarray:
        """Positive numbers, neither huge nor tiny."""
        return self.between(1 / self.longest, self.longest, *shape)

    def between(self, low: float, high: float, *shape: int) -> np.ndarray:
        """Positive numbers of a range, of all orders of magnitude, its ends included."""
        size = (self.count, *shape)
        spread = 10.0 ** self.rng.uniform(np.log10(low), np.log10(high), size)
        ends = self.rng.choice([low, high, np.clip(1.0, low, high)], size)
        return np.clip(self.either(0.6, spread, ends), low, high).astype(self.dtype)

    def vectors(self, *shape: int) -> np.ndarray:
        """[count, *shape, 3]: some along an axis, some of length 1, some zero."""
        v = self.numbers(*shape, 3)
        axis = np.eye(3, dtype=self.dtype)[self.rng.integers(0, 3, v.shape[:-1])]
        round_about = self.rng.normal(size=v.shape)
        round_about /= np.linalg.norm(round_about, axis=-1, keepdims=True)
        lowest, highest = float(np.log10(self.info.tiny)), float(np.log10(self.longest))
        scaled = round_about * 10.0 ** self.rng.uniform(lowest, highest, (*v.shape[:-1], 1))
        kinds = self.rng.integers(0, 8, v.shape[:-1])[..., None]
        options = [v, v, scaled, scaled, round_about, axis, -axis, np.zeros_like(v)]
        return np.choose(kinds, options).astype(self.dtype)

    def directions(self, *shape: int) -> np.ndarray:
        """The same: those that are not zero neither huge nor tiny."""
        return self.long_enough(self.vectors(*shape))

    def long_enough(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors, those too short lengthened, or zero."""
        size = np.abs(vectors).max(axis=-1, keepdims=True).astype(np.float64)
        some = np.maximum(size, float(self.info.tiny))
        longer = np.where(size * self.longest < 1, 1 / some / self.longest, 1)
        return np.where(size < some, 0, vectors * longer).astype(self.dtype)

    def signs(self, size: tuple[int, ...]) -> np.ndarray:
        """Plus or minus one."""
        return self.rng.choice([-1.0, 1.0], size)

    def either(self, share: float, a: Any, b: Any) -> np.ndarray:
        """a in about that share of places, b elsewhere."""
        return np.where(self.rng.random(np.shape(a)) < share, a, b)

    def tied(self, share: float, ties: list[np.ndarray], otherwise: np.ndarray) -> np.ndarray:
        """In about that share of the cases one of `ties`, [count, 3] each."""
        chosen = np.choose(self.rng.integers(0, len(ties), self.count)[:, None], ties)
        return np.where(self.rng.random((self.count, 1)) < share, chosen, otherwise).astype(
            self.dtype
        )

    def limited(self, vectors: list[np.ndarray]) -> list[np.ndarray]:
        """Back into the range."""
        return [np.clip(np.nan_to_num(v), -self.longest, self.longest) for v in vectors]


@st.composite
def decks(draw: Callable[..., Any], count: int, dtype: Any) -> Deck:
    """What all other strategies deal from."""
    width = 8 * np.dtype(dtype).itemsize
    most = LONGEST[np.dtype(dtype).name]
    number = st.floats(
        float(np.dtype(dtype).type(-most)), float(np.dtype(dtype).type(most)), width=width
    )  # type: ignore[arg-type]
    palette = draw(st.lists(number, min_size=1, max_size=8))
    return Deck(palette, draw(st.integers(0, 2**32 - 1)), count, dtype)


def vectors(deck: Deck) -> Cases:
    """Two vectors of any size: independent, the same, opposite or at a right angle."""
    a = deck.vectors()
    turned = np.stack([-a[:, 1], a[:, 0], np.zeros_like(a[:, 2])], axis=1)
    return {"a": a, "b": deck.tied(0.3, [a, -a, turned, 2 * a], deck.vectors())}


def normals(deck: Deck) -> Cases:
    """A point with a normal of any length."""
    return {"position": deck.vectors(), "normal": deck.directions()}


def points(deck: Deck) -> Cases:
    """`normals`, and an eye: somewhere, at the point, above it, or grazing it; or a view like that."""
    case = normals(deck)
    p, n = case["position"], case["normal"]
    along = np.cross(n, np.roll(n, 1, axis=1))
    eye = deck.tied(0.4, deck.limited([p, p + n, p + along, p - n]), deck.vectors())
    return case | {"eye": eye, "view": deck.long_enough(eye - p)}


def lights(deck: Deck, seen: Cases) -> Cases:
    """A light for `points`: somewhere, or in an exact relation to point, normal and eye."""
    p, n, v = seen["position"], seen["normal"], seen["eye"] - seen["position"]
    mirrored = 2 * np.sum(v * n, axis=1, keepdims=True) * n - v
    ties = [
        np.zeros_like(p),  # at the surface
        np.cross(n, np.roll(n, 1, axis=1)),  # in the tangent plane
        np.stack([-n[:, 1], n[:, 0], np.zeros_like(n[:, 2])], axis=1),
        n,  # straight above
        -n,
        v,  # at the eye
        -v,  # opposite it: no halfway vector
        mirrored,  # r = v
        np.cross(mirrored, v),  # r.v = 0
        deck.numbers(3, most=1e-6),  # almost touching
    ]
    with np.errstate(over="ignore", invalid="ignore"):
        towards = deck.tied(0.6, [np.nan_to_num(x) for x in ties], deck.vectors())
    return {
        "direction": deck.long_enough(deck.limited([towards])[0]),
        "place": deck.limited([p + towards])[0],
        "intensity": deck.numbers(1, most=deck.brightest),
    }


def attenuations(deck: Deck) -> Cases:
    """Distances and constants: zero, huge, on the edge of the clamp, at the end of the reach."""
    c = deck.positive(3)
    edge = np.array([1, 0, 0], deck.dtype)
    apart = deck.lengths()
    d = deck.either(0.9, apart, np.zeros_like(apart)).astype(deck.dtype)
    reach = deck.lengths()
    return {
        "d": d,
        "c": deck.tied(0.3, [edge + 0 * c, 0 * c], c),
        "linear": np.where(deck.rng.random((deck.count, 1)) < 0.2, 0, deck.lengths(2)),
        "a": deck.positive(),
        "reach": np.select(
            [deck.rng.random(deck.count) < share for share in (0.1, 0.3)], [0 * d, d], reach
        ).astype(deck.dtype),
    }


def materials(deck: Deck) -> Cases:
    """Coefficients, colours, the shininess, 0, below 1, 1, and up to 1e5, and what microfacets have."""
    usual = deck.rng.choice([0.0, 1e-3, 0.5, 1.0, 2.0, 32.0, SHARPEST], deck.count)
    largest = LARGEST[deck.dtype.name]
    k = {name: deck.numbers(1, most=largest) for name in ("ka", "kd", "ks", "od", "os")}
    shininess = deck.either(0.5, usual, deck.positive(most=SHARPEST)).astype(deck.dtype)
    index = deck.between(0.1, 10.0)  # 1, where nothing is reflected, is one of them
    return k | {
        "shininess": shininess,
        "ambient": deck.numbers(1, most=deck.brightest),
        "alpha": deck.between(*ROUGHNESS),
        "index": index,
        "extinction": deck.positive(most=10.0),
        "f0": deck.positive(most=1.0),
        "cosine": deck.positive(most=1.0),
        "other cosine": deck.positive(most=1.0),
    }


def scenes(deck: Deck) -> Cases:
    """A point that an eye sees, under a light, of a material."""
    seen = points(deck)
    return seen | lights(deck, seen) | attenuations(deck) | materials(deck)


def captures(deck: Deck) -> Cases:
    """A scene, and what was observed of it."""
    return scenes(deck) | {"observed": deck.numbers(1, most=deck.brightest)}


def colours(deck: Deck) -> Cases:
    """Two colours in [0, 1] and a share: greys, all but greys, equal components, black, white."""
    free = deck.positive(3, most=1.0)
    grey = np.repeat(free[:, :1], 3, axis=1)
    pair = np.stack([free[:, 0], free[:, 0], free[:, 2]], axis=1)
    almost = grey * (1 - deck.rng.integers(0, 4, (deck.count, 3)) * deck.info.eps)
    ties = [grey, pair, almost, pair[:, ::-1], 0 * free, 0 * free + 1]
    other = deck.tied(0.3, [free, 1 - free, free[:, ::-1]], deck.positive(3, most=1.0))
    return {
        "colour": deck.tied(0.6, [x.astype(deck.dtype) for x in ties], free),
        "other": other,
        "share": deck.positive(most=1.0),
    }


def cameras(deck: Deck) -> Cases:
    """A camera: somewhere, at its target, or looking along its own up direction."""
    place, target = deck.vectors(), deck.vectors()
    ties = [target, -target, np.zeros_like(target)]
    place = deck.tied(0.2, ties, place)
    return {
        "camera": place,
        "target": target,
        "up": deck.long_enough(deck.tied(0.2, deck.limited([place - target]), deck.vectors())),
        "extent": deck.lengths(),
        "fov": deck.between(1 / deck.longest, 3.1),
    }


def spheres(deck: Deck) -> Cases:
    """A camera and a sphere, which may be anywhere and of any size."""
    case = cameras(deck)
    center = deck.tied(0.5, [case["target"], case["camera"]], deck.vectors())
    return case | {"center": center, "radius": deck.lengths()}


def meshes(deck: Deck) -> Cases:
    """Four vertices: on a lattice of 2^-19, so that edges are zero or at least 2e-6; and weights."""
    corners = deck.vectors(4)
    step = 2.0**-19
    corners = np.round(corners / step) * step
    shifted = np.roll(corners, 1, axis=1)
    same = deck.rng.random((deck.count, 4, 1)) < 0.2
    corners = np.where(same, shifted, corners).astype(deck.dtype)
    weights = deck.rng.dirichlet((1, 1, 1), deck.count)
    exact = np.eye(3)[deck.rng.integers(0, 3, deck.count)]
    return cameras(deck) | {
        "vertices": corners,
        "weights": deck.tied(0.3, [exact], weights),
        "normals": deck.directions(4),
    }
