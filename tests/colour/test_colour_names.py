"""The names of the CNS, against its syntax, its count of 627, and colours of the web."""

import re

import jax.numpy as jnp
import numpy as np
import pytest

from diffshade.colour.device import hls_to_rgb, rgb_to_hls
from diffshade.colour.names import NAMES, colour_name, colour_of_name
from diffshade.errors import BadInput

BASE = "(red|orange|brown|yellow|green|blue|purple)"
ISH = "(reddish|orangish|brownish|yellowish|greenish|bluish|purplish)"
LIGHTNESS = "(((very )?(dark|light)) )?"
SYNTAX = (
    f"black|white|{LIGHTNESS}gray|"
    f"{LIGHTNESS}((grayish|moderate|strong) )?({ISH} {BASE}|{BASE}|{BASE}-{BASE})"
)


def test_there_are_as_many_as_the_paper_says() -> None:
    """627: 20 of each of 31 hues, and 7 greys; all by its syntax."""
    assert len(NAMES) == 627
    assert [name for name in NAMES if not re.fullmatch(SYNTAX, name)] == []
    hues = {re.sub(f"^{LIGHTNESS}((grayish|moderate|strong) )?", "", name) for name in NAMES}
    assert len(hues - {"black", "white", "gray"}) == 31


@pytest.mark.parametrize(
    ("rgb", "name"),
    [
        ((1, 0, 0), "red"),
        ((1, 1, 0), "yellow"),
        ((0, 1, 0), "green"),
        ((0, 0, 1), "blue"),
        ((0, 1, 1), "green-blue"),
        ((0, 0, 0), "black"),
        ((1, 1, 1), "white"),
        ((0.5, 0.5, 0.5), "gray"),
        ((0.35, 0.35, 0.35), "dark gray"),
        ((0, 0, 0.66), "dark blue"),
        ((1, 0.65, 0), "orange"),
        ((0.545, 0.271, 0.075), "light strong reddish brown"),  # saddlebrown of the web
        ((0.678, 0.847, 0.902), "very light moderate green-blue"),  # lightblue
        ((0.44, 0.50, 0.565), "grayish greenish blue"),  # slategray
        ((1, 0, 0.02), "red"),
    ],
)
def test_of_well_known_colours(rgb: tuple[float, ...], name: str) -> None:
    assert colour_name(rgb_to_hls(jnp.asarray(rgb, float))) == name


def test_words_are_where_the_paper_puts_them() -> None:
    """Halfway, and a quarter of the way: greenish blue is nearer to blue."""
    blue, green = colour_of_name("blue"), colour_of_name("green")
    np.testing.assert_allclose(colour_of_name("blue-green"), (blue + green) / 2)
    np.testing.assert_allclose(colour_of_name("greenish blue"), blue + (green - blue) / 4)
    assert colour_of_name("purplish red")[0] > colour_of_name("red-purple")[0] > 300
    assert colour_of_name("brown")[1] == colour_of_name("orange")[1] / 2


def test_there_and_back() -> None:
    """But for oranges in the dark, which are browns."""
    other = {name for name in NAMES if colour_name(colour_of_name(name)) != name}
    assert len(other) == 2 * 4 * 7
    assert all("dark" in name and "orang" in name for name in other)
    assert all("brown" in colour_name(colour_of_name(name)) for name in other)
    rgb = hls_to_rgb(jnp.asarray(list(NAMES.values()), float))
    assert np.all((rgb >= 0) & (rgb <= 1)), "a screen has them all"


def test_spellings() -> None:
    for name, other in (
        ("Very Dark Greyish Blue", "very dark grayish blue"),
        ("medium vivid orange-red", "red-orange"),
        ("medium grey", "gray"),
    ):
        np.testing.assert_array_equal(colour_of_name(name), NAMES[other])


def test_what_is_no_name_or_no_colour_is_refused() -> None:
    for name in ("cyan", "", "blue-red", "dark dark blue", "yellowish blue", "vivid"):
        with pytest.raises(BadInput, match="is no name of the CNS"):
            colour_of_name(name)
    for hls in ((0, 1.1, 0.5), (0, 0.5, -0.1), (np.nan, 0.5, 0.5)):
        with pytest.raises(BadInput, match=r"give L and S in \[0, 1\]"):
            colour_name(hls)
