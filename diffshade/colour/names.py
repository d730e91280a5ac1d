"""Names of colours in English: the CNS of Berk, Brownston and Kaufman (1982).

A name is a grey, or a lightness, a saturation and a hue: "very light grayish bluish green". Of a colour
in HLS (`device.rgb_to_hls`, of the values that a screen is given), the words stand for

    lightness    black 0, very dark 1/6, dark 1/3, medium 1/2, light 2/3, very light 5/6, white 1
    saturation   gray 0, grayish 1/4, moderate 1/2, strong 3/4, vivid 1

"medium" and "vivid" go without saying: "blue" is a medium vivid blue. Six hues go round the circle, red,
orange, yellow, green, blue and purple; "red-orange" is halfway between two, "reddish orange" a quarter of
the way from the second. Brown is an orange of half the lightness, and has neighbours as orange has: red
and yellow. That makes 31 hues, 20 chromatic colours of each, and 7 greys: 627 names.

Degrees of hues and the even steps are those of Kaufman (1986) as the package `cns` of R has them, which
takes them in HSV; in HLS they leave pure hues pure. Half the lightness for brown is ours, where that
package has the orange itself. On the host, one colour at a time.
"""

from itertools import pairwise, product
from typing import Any

import numpy as np
from jaxtyping import Float

from diffshade.errors import BadInput

__all__ = ["LIGHTNESS", "NAMES", "SATURATION", "colour_name", "colour_of_name"]

LIGHTNESS = {
    "very dark": 1 / 6,
    "dark": 1 / 3,
    "medium": 1 / 2,
    "light": 2 / 3,
    "very light": 5 / 6,
}
SATURATION = {"grayish": 1 / 4, "moderate": 1 / 2, "strong": 3 / 4, "vivid": 1.0}
DEGREES = {
    "red": 0.0,
    "orange": 38.8,
    "yellow": 60.0,
    "green": 120.0,
    "blue": 240.0,
    "purple": 276.9,
}

_ISH = {
    "red": "reddish",
    "orange": "orangish",
    "brown": "brownish",
    "yellow": "yellowish",
    "green": "greenish",
    "blue": "bluish",
    "purple": "purplish",
}


def _between(names: tuple[str, str], ends: tuple[float, float]) -> dict[str, float]:
    """The three hues from one to the next."""
    (a, b), (start, end) = names, ends
    words = (f"{_ISH[b]} {a}", f"{a}-{b}", f"{_ISH[a]} {b}")
    return {word: start + (end - start) * k / 4 for word, k in zip(words, (1, 2, 3), strict=True)}


def _circle(degrees: dict[str, float]) -> dict[str, float]:
    """Names and degrees from the first hue to the last."""
    found = dict(degrees)
    for pair in pairwise(degrees.items()):
        (a, start), (b, end) = pair
        found |= _between((a, b), (start, end))
    return found


ORDINARY = _circle(DEGREES) | _between(("purple", "red"), (DEGREES["purple"], 360.0))
BROWN = {
    name: degrees
    for name, degrees in _circle({"red": 0.0, "brown": DEGREES["orange"], "yellow": 60.0}).items()
    if "brown" in name
}


def _all() -> dict[str, tuple[float, float, float]]:
    found = {"black": (0.0, 0.0, 0.0), "white": (0.0, 1.0, 0.0)}
    found |= {_name(word, "gray"): (0.0, level, 0.0) for word, level in LIGHTNESS.items()}
    for hues, share in ((ORDINARY, 1.0), (BROWN, 0.5)):
        for (hue, degrees), light, pure in product(hues.items(), LIGHTNESS, SATURATION):
            found[_name(light, pure, hue)] = (degrees, share * LIGHTNESS[light], SATURATION[pure])
    return found


def _name(*words: str) -> str:
    return " ".join(word for word in words if word not in ("medium", "vivid"))


NAMES = _all()
"""Every name, in its shortest form, with hue in degrees, lightness and saturation."""


def colour_of_name(name: str) -> Float[np.ndarray, "3"]:
    """(H, L, S) of a name, in small letters or large; "grey" is "gray", "orange-red" "red-orange".

    Raises `BadInput` for what is no name.

    >>> colour_of_name("Medium vivid blue").tolist(), colour_of_name("dark grey").round(2).tolist()
    ([240.0, 0.5, 1.0], [0.0, 0.33, 0.0])
    """
    words = name.lower().replace("grey", "gray").split()
    short = " ".join(word for word in words if word not in ("medium", "vivid"))
    turned = " ".join("-".join(reversed(word.split("-"))) for word in short.split())
    for found in (short, turned):
        if found in NAMES:
            return np.array(NAMES[found])
    raise BadInput(
        f"{name!r} is no name of the CNS: give lightness, saturation and hue, as in 'dark strong blue'"
    )


def colour_name(hls: Any) -> str:
    """The name whose words come nearest to (H, L, S), each by itself.

    H in degrees, any turn; L and S in [0, 1], or else `BadInput` is raised. The orange that is darker
    than halfway between a very light brown and an orange is brown.

    >>> colour_name([240.0, 0.5, 1.0]), colour_name([30.0, 0.25, 0.8])
    ('blue', 'strong reddish brown')
    """
    hue, lightness, saturation = np.asarray(hls, np.float64)
    if not (np.isfinite(hue) and 0 <= lightness <= 1 and 0 <= saturation <= 1):
        raise BadInput(f"(H, L, S) is {(hue, lightness, saturation)}: give L and S in [0, 1]")
    pure = _nearest({"gray": 0.0} | SATURATION, saturation)
    named = _nearest(ORDINARY | {"red ": 360.0}, hue % 360).strip()
    degrees = ORDINARY[named]
    brown = next((name for name, own in BROWN.items() if own == degrees), None)
    if pure != "gray" and brown is not None and lightness < 11 / 24:
        named, lightness = brown, 2 * lightness
    light = _nearest({"black": 0.0, **LIGHTNESS, "white": 1.0}, lightness)
    if light in ("black", "white"):
        return light
    return _name(light, "gray") if pure == "gray" else _name(light, pure, named)


def _nearest(levels: dict[str, float], value: float) -> str:
    return min(levels, key=lambda name: abs(levels[name] - value))
