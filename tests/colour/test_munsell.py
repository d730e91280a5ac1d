"""Munsell's notation against a chart whose notations and chromaticities are published."""

import numpy as np
import pytest

from diffshade.colour.munsell import WHITE, munsell_to_xyy, xyy_to_munsell
from diffshade.errors import BadInput

# McCamy, Marcus and Davidson 1976: notation, and x, y, Y (of 100) under illuminant C.
CHART = {
    "dark skin": ("3YR 3.7/3.2", 0.400, 0.350, 10.1),
    "blue sky": ("4.3PB 4.95/5.5", 0.247, 0.251, 19.3),
    "foliage": ("6.7GY 4.2/4.1", 0.337, 0.422, 13.3),
    "orange": ("5YR 6/11", 0.506, 0.407, 30.1),
    "purple": ("5P 3/7", 0.285, 0.202, 6.6),
    "red": ("5R 4/12", 0.539, 0.313, 12.0),
    "yellow": ("5Y 8/11.1", 0.448, 0.470, 59.1),
    "cyan": ("5B 5/8", 0.196, 0.252, 19.8),
}


@pytest.mark.parametrize("patch", CHART)
def test_a_published_chart(patch: str) -> None:
    """Y of 1976 is relative to smoked magnesium oxide, which reflects 97.5 %."""
    notation, *xy, brightness = CHART[patch]
    found = munsell_to_xyy(notation)
    np.testing.assert_allclose(found[:2], xy, atol=2e-3)
    np.testing.assert_allclose(100 * found[2] / 0.975, brightness, atol=0.1)


def test_and_back() -> None:
    notation, x, y, brightness = CHART["orange"]
    assert notation == "5YR 6/11"
    assert xyy_to_munsell([x, y, 0.00975 * brightness]) == "5.0YR 6.0/11.0"


def test_greys_have_value_only() -> None:
    np.testing.assert_allclose(munsell_to_xyy("N5")[:2], WHITE, atol=6e-5)
    assert xyy_to_munsell([0.31006, 0.31616, munsell_to_xyy("N5")[2]]) == "N5.0"


def test_what_has_no_place_is_refused() -> None:
    for notation in ("mauve", "5YR 6/90", "5R 11/2", ""):
        with pytest.raises(BadInput, match="no place in Munsell's renotation"):
            munsell_to_xyy(notation)
    with pytest.raises(BadInput, match="does not converge"):
        xyy_to_munsell([0.1, 0.8, 0.9])
    with pytest.raises(BadInput, match="no place"):
        xyy_to_munsell([0.15, 0.05, 0.5])
    with pytest.raises(BadInput, match=r"give a chromaticity, and Y in \[0, 1\]"):
        xyy_to_munsell([0.3, 0.3, 30.0])
