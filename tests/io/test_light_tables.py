"""Spot lights and lights with extent in a `scene.toml`."""

from pathlib import Path

import numpy as np
import pytest
from test_scene_toml import read

import diffshade as ds
from diffshade.errors import BadInput

PARALLEL = """kind      = "parallel"
direction = [-1, 0, 1]
intensity = 0.5"""
SPOT = """kind = "spot"
position = [0, 1, 3]
direction = [0, -1, -3]
intensity = [0.5, 0.4, 0.3]
"""
DISC = """kind = "disc"
center = [0, 0, 3]
normal = [0, 0, -1]
radius = 0.5
radiance = 2
"""


def test_a_spot(tmp_path: Path) -> None:
    more = SPOT + 'exponent = 4\ncutoff = 0.5\nattenuation = { kind = "inverse_square" }'
    spot = read(tmp_path, (PARALLEL, more)).scene.lights[1]
    assert isinstance(spot, ds.SpotLight)
    assert isinstance(spot.attenuation, ds.InverseSquare)
    assert float(spot.exponent) == 4
    assert float(spot.cutoff) == 0.5
    plain = read(tmp_path, (PARALLEL, SPOT)).scene.lights[1]
    assert plain.cutoff is None
    assert plain.attenuation is None
    np.testing.assert_allclose(plain.direction, (0, -1, -3))


@pytest.mark.parametrize(
    ("table", "count"),
    [
        (DISC + "samples = 3", 18),
        ('kind = "sphere"\ncenter = [0, 0, 3]\nradius = 0.5\nradiance = 2\nsamples = 2', 8),
        ('kind = "line"\nstart = [0, 0, 3]\nend = [1, 0, 3]\nradiance = 2\nsamples = 7', 7),
        ('kind = "rectangle"\ncenter = [0, 0, 3]\nu = [1, 0, 0]\nv = [0, -1, 0]\nradiance = 2', 16),
    ],
)
def test_lights_with_extent(table: str, count: int, tmp_path: Path) -> None:
    assert len(read(tmp_path, (PARALLEL, table)).scene.lights) == 1 + count


@pytest.mark.parametrize(
    ("new", "complaint"),
    [
        (
            SPOT.replace("[0, -1, -3]", "[0, 0, 0]"),
            "light 2: direction is zero; give the direction",
        ),
        (SPOT + "exponent = -1", "light 2: exponent is -1; give a number of at least 0"),
        (SPOT + "angle = 1", 'light 2: unknown key "angle"; the keys here are kind, position'),
        (DISC.replace("0.5", "0"), "light 2: radius is 0; give a number above 0"),
        (DISC.replace("[0, 0, -1]", "[0, 0, 0]"), "a disc's normal is zero"),
        (SPOT + "cutoff = 30", "light 2: the light's cutoff is 30: give an angle in radians"),
        (DISC + "samples = 65", "light 2: samples is 65; give at most 64 along a side"),
        (DISC + "samples = 2.5", "light 2: samples is 2.5; give a whole number of at least 1"),
        (DISC.replace("radiance", "intensity"), 'light 2: unknown key "intensity"'),
        (DISC.replace("= 2", "= [2, 3]"), "light 2: radiance has 2 numbers"),
        ('kind = "torch"', 'light 2: kind is \'torch\'; give one of "point", "spot"'),
    ],
)
def test_what_is_wrong_is_said(new: str, complaint: str, tmp_path: Path) -> None:
    with pytest.raises(BadInput) as refused:
        read(tmp_path, (PARALLEL, new))
    assert complaint in str(refused.value)
    assert "\n" not in str(refused.value)
