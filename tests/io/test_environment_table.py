"""Environments in a `scene.toml` and a `capture.toml`."""

from pathlib import Path

import numpy as np
import pytest
from capture_files import codes, write_png
from test_scene_toml import read, write

import diffshade as ds
from diffshade.cli import run
from diffshade.errors import BadInput
from diffshade.io.image import write_exr
from diffshade.io.read_capture import read_capture

PARALLEL = """kind      = "parallel"
direction = [-1, 0, 1]
intensity = 0.5"""
FILE = 'kind = "environment"\nfile = "sky.exr"\norder = 2'
HARMONICS = 'kind = "environment"\nharmonics = [[1, 2, 3], [0, 0, 0.5], [0, 0, -0.5], [0.1, 0, 0]]'
NINE = 'kind = "environment"\nharmonics = [1, 0, 0, 0.2, 0, 0, 0, 0, 0]\nintensity = [0.5, 1, 2]'


def sky(folder: Path, channels: int = 3) -> np.ndarray:
    image = np.random.default_rng(0).uniform(size=(8, 16, channels)).astype(np.float32)
    write_exr(folder / "sky.exr", image)
    return image


@pytest.mark.parametrize("channels", [1, 3])
def test_an_image(channels: int, tmp_path: Path) -> None:
    image = sky(tmp_path, channels)
    light = read(tmp_path, (PARALLEL, FILE + "\nintensity = 0.5")).scene.lights[1]
    assert isinstance(light, ds.EnvironmentLight)
    plain = image[..., 0] if channels == 1 else image
    expected = ds.EnvironmentLight.from_image(plain, 2).harmonics
    np.testing.assert_allclose(light.harmonics, expected, rtol=1e-6)
    assert float(light.intensity) == 0.5


def test_harmonics(tmp_path: Path) -> None:
    light = read(tmp_path, (PARALLEL, HARMONICS)).scene.lights[1]
    np.testing.assert_allclose(light.harmonics[1], [0, 0, 0.5])
    assert light.order == 1
    grey = read(tmp_path, (PARALLEL, NINE)).scene.lights[1]
    assert grey.harmonics.shape == (9,)
    np.testing.assert_allclose(grey.intensity, [0.5, 1, 2])


@pytest.mark.parametrize(
    ("new", "complaint"),
    [
        (FILE.replace("sky.exr", "night.exr"), "night.exr"),
        (FILE.replace('"sky.exr"', '"../sky.exr"'), "lies outside"),
        (FILE.replace("order = 2", ""), 'the key "order" is missing'),
        (FILE.replace("= 2", "= 0"), "light 2: order is 0; give a whole number of at least 1"),
        (FILE.replace("= 2", "= 65"), "light 2: order is 65; give at most 64"),
        (FILE.replace("= 2", "= 9"), "light 2: the environment's image is 16 x 8 pixels, too few"),
        (FILE.replace("sky.exr", "a.png"), "light 2: a.png does not say that it is linear; give"),
        (
            FILE + "\nharmonics = [1]",
            'light 2: unknown key "file"; the keys here are kind, harmonics',
        ),
        (NINE.replace("[1, 0,", "[0,"), "light 2: the environment's harmonics have shape (8,)"),
        (
            NINE.replace("[1, 0,", "[nan, 0,"),
            "light 2: harmonics is [nan, 0, 0, 0.2, 0, 0, 0, 0, 0]",
        ),
        (NINE.replace("[1, 0,", "[[1], 0,"), "give a list of numbers, or of lists of one number"),
        (NINE.replace("[1, 0,", f"[{10**400}, 0,"), "give a list of numbers, or of lists"),
        (HARMONICS.replace("[1, 2, 3]", "[1, 2]"), "give a list of numbers, or of lists"),
        (HARMONICS.replace("[[", "[[[1]], ["), "give a list of numbers, or of lists of one number"),
        ('kind = "environment"\nharmonics = 1', "harmonics is 1; give a list of numbers"),
        ('kind = "environment"\nharmonics = []', "harmonics is []; give a list of numbers"),
        (HARMONICS + "\nintensity = [1, 2]", "light 2: 2 channels meet 3"),
        (HARMONICS + "\nsamples = 0", "light 2: samples is 0; give a whole number of at least 1"),
        (HARMONICS + "\nsamples = 33", "light 2: samples is 33; give at most 32"),
        ('kind = "environment"\nharmonics = [[1, 2]]\nsamples = 2', "environment has 2 numbers"),
        (
            'kind = "environment"\nharmonics = [[1, 2]]',
            "light 2: environment has 2 numbers",
        ),
    ],
)
def test_what_is_wrong_is_said(new: str, complaint: str, tmp_path: Path) -> None:
    sky(tmp_path)
    write_png(tmp_path / "a.png", codes(1))
    with pytest.raises(BadInput) as refused:
        read(tmp_path, (PARALLEL, new))
    assert complaint in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("table", [HARMONICS, NINE])
def test_samples_are_parallel_lights(table: str, tmp_path: Path) -> None:
    whole = read(tmp_path, (PARALLEL, table)).scene.lights[1]
    file = read(tmp_path, (PARALLEL, f"{table}\nsamples = 3"))
    sampled = file.scene.lights[1:]
    assert file.lights[1:] == sampled
    for light, expected in zip(sampled, whole.as_lights(3), strict=True):
        assert isinstance(light, ds.ParallelLight)
        np.testing.assert_array_equal(light.direction, expected.direction)
        np.testing.assert_array_equal(light.intensity, expected.intensity)


def test_every_lobe_is_lit_by_samples(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ggx = ('kind      = "phong"', 'kind = "ggx"\nalpha = 0.4'), ("shininess = 20\n", "")
    path = write(tmp_path, *ggx, (PARALLEL, NINE))
    words = ["render", str(path), "--out", str(tmp_path / "image.npy")]
    assert run(words) == 3
    assert "give the environment samples = 16" in capsys.readouterr().err
    write(tmp_path, *ggx, (PARALLEL, f"{NINE}\nsamples = 3"))
    assert run(words) == 0
    image = np.load(tmp_path / "image.npy")
    assert np.isfinite(image).all()
    assert image.max() > 0.1
    assert run(["view", str(path)]) == 3
    assert "light 2 is an environment" in capsys.readouterr().err


def test_shadows_by_samples(tmp_path: Path) -> None:
    shadows = ("ambient  = 0.1\n", "ambient  = 0.1\nshadows = true\n")
    with pytest.raises(BadInput, match=r"light 2: an environment throws .* samples = 16"):
        read(tmp_path, (PARALLEL, NINE), shadows)
    assert read(tmp_path, (PARALLEL, f"{NINE}\nsamples = 1"), shadows).shadows


CAPTURE = """
schema   = "diffshade.capture/1"
encoding = "linear"
geometry = { kind = "sphere", center = [0, 0, 0], radius = 1.0 }
camera   = { kind = "orthographic", width = 16, height = 12, extent = 3.2 }
[[image]]
file   = "a.png"
lights = [{ kind = "environment", file = "sky.exr", order = 2 }]
[[image]]
file   = "b.png"
lights = [{ kind = "parallel", direction = [0, 0, 2], intensity = 2 },
          { kind = "environment", file = "sky.exr", order = 2 }]
"""


def test_photographs_under_one_sky(tmp_path: Path) -> None:
    image = sky(tmp_path)
    for k, name in enumerate(("a.png", "b.png")):
        write_png(tmp_path / name, codes(k))
    path = tmp_path / "capture.toml"
    path.write_text(CAPTURE)
    first, second = read_capture(path).scenes
    assert first.lights[0] is second.lights[1]
    expected = ds.EnvironmentLight.from_image(image, 2).harmonics
    np.testing.assert_allclose(first.lights[0].harmonics, expected, rtol=1e-6)
    for more in ("", ", samples = 2"):
        other = f"harmonics = [[1, 2]]{more}"
        path.write_text(CAPTURE.replace('file = "sky.exr", order = 2', other))
        with pytest.raises(BadInput) as refused:
            read_capture(path)
        said = "light 1: the environment has 2 channels where the images have 3"
        assert said in str(refused.value)
    path.write_text(CAPTURE.replace("order = 2", "order = 2, samples = 2"))
    assert [len(scene.lights) for scene in read_capture(path).scenes] == [8, 9]
