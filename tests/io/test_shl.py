"""AliceVision's `.shl`, as Eigen prints the 9 x 3 matrix of `lightingEstimation`: columns aligned."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from test_scene_toml import read

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.io.shl import read_shl
from diffshade.vector import Vec3

SHL = """  0.120031  0.0904521  0.0801175
 -0.310442  -0.297113  -0.330049
 -0.530918  -0.510037  -0.480114
  0.710244   0.700118   0.740963
 0.0510113  0.0404827   0.030671
-0.0220517 -0.0310042 -0.0120093
 0.0810334  0.0700219   0.060442
 0.0140023  0.0210071 -0.0305114
 0.0330812  0.0250034  0.0190027"""

PARALLEL = """kind      = "parallel"
direction = [-1, 0, 1]
intensity = 0.5"""


def augmented(n: np.ndarray) -> np.ndarray:
    """`AugmentedNormal(nx, ny, nz)` of `augmentedNormals.hpp`."""
    x, y, z = n
    return np.array([x, y, z, 1 + 0 * x, x * y, x * z, y * z, x * x - y * y, 3 * z * z - 1])


def written(folder: Path, text: str) -> Path:
    path = folder / "global.shl"
    path.write_text(text)
    return path


def test_what_a_surface_shows_is_what_alicevision_says(tmp_path: Path) -> None:
    """Albedo times c . augmented(n), in axes with y down and z forward, of normals all around."""
    light = read_shl(written(tmp_path, SHL))
    matrix = np.array([row.split() for row in SHL.splitlines()], float)
    n = np.random.default_rng(3).normal(size=(3, 40))
    n /= np.linalg.norm(n, axis=0)
    theirs = 0.5 * matrix.T @ augmented(n * np.array([[1.0], [-1.0], [-1.0]]))
    gbuffer = ds.GBuffer.from_arrays(None, n.T[None])
    scene = ds.Scene(lights=light)
    ours = np.asarray(ds.render(gbuffer, scene, ds.Material(kd=0.5)))[0].T
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


def test_of_luminance_it_is_one_for_all_channels(tmp_path: Path) -> None:
    """`lightingColor` luminance: three columns alike."""
    grey = "\n".join(" ".join(3 * [row.split()[0]]) for row in SHL.splitlines())
    light = read_shl(written(tmp_path, grey))
    assert light.harmonics.shape == (9,)
    up = Vec3(*map(jnp.asarray, (0.0, 1.0, 0.0)))
    # What points up there has n_y = -1
    expected = 0.310442 + 0.710244 - 0.0140023 - 0.0330812
    np.testing.assert_allclose(light.irradiance(up)[0], expected, rtol=1e-6)


def test_it_lights_a_scene(tmp_path: Path) -> None:
    written(tmp_path, SHL)
    lamp = 'kind = "environment"\nfile = "global.shl"\nintensity = 2.0'
    light = read(tmp_path, (PARALLEL, lamp)).scene.lights[1]
    np.testing.assert_array_equal(
        light.harmonics, read_shl(tmp_path / "global.shl").harmonics.astype(light.harmonics.dtype)
    )
    assert float(light.intensity) == 2


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("\n 0.0330812  0.0250034  0.0190027", "", "8 rows where 9 belong"),
        ("0.0250034", "", "line 9: 2 numbers where 3 belong"),
        ("0.0250034", "nan", "line 9: .* holds NaN"),
        ("0.0250034", "1e20", "line 9: holds what is as good as infinity"),
    ],
)
def test_what_is_no_such_file_is_refused(old: str, new: str, told: str, tmp_path: Path) -> None:
    assert old in SHL
    path = written(tmp_path, SHL.replace(old, new))
    with pytest.raises(BadInput, match=told) as refused:
        read_shl(path)
    assert str(refused.value).startswith(str(path))
