"""A phone's photographs of a sample ball and a mirror ball, of which nothing is known but sizes and lens.

The radii of the balls and the field of view are known, the lamp's place and the exposure are not. All k
are found times the exposure, which is a factor that the images cannot tell: it is the test that knows
it. k, the ratios of k, in which it cancels, and n are to lie in the intervals that are stated for them,
of which 1 in 20 may miss; and these have to say something: no ratio and no n more than 5 % to each side.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import phone_capture as phone
import pytest
from povray import requires_povray
from scipy import ndimage

import diffshade as ds
from diffshade.cli import run
from diffshade.errors import BadInput
from diffshade.io.circle_from_mask import circle_from_mask
from diffshade.io.encoding import Encoding, decode
from diffshade.io.image import read_image, write_png
from fitting.calibrate import (
    NearLights,
    find_highlight,
    mirrored,
    refine_near_lights,
    sphere_of_circle,
)

LAMPS = len(phone.LAMPS)
OPEN: Any = {"ka": (0, None), "kd": (0, None), "specular.ks": (0, None)}
BLUR = 2
"""Pixels beside a clipped one that JPEG smears it over."""
GUESS = 50.0
"""Centimetres from the mirror ball to the lamp, where the search starts; they are 42 to 52."""

CAPTURE = """\
schema = "diffshade.capture/1"
encoding = "srgb"
mask = "mask.png"
ambient = 1.0
geometry = {{ kind = "sphere", center = {center}, radius = {radius} }}
camera = {{ kind = "perspective", width = {width}, height = {height}, fov = {fov}, \
position = [0, 0, 0], target = [0, 0, -1] }}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The photographs, as they come from the phone."""
    folder = tmp_path_factory.mktemp("phone")
    rng = np.random.default_rng(1)
    for k, image in enumerate(phone.radiance()):
        (folder / f"{k}.jpg").write_bytes(phone.jpeg(image, rng))
    return folder


def ball(mask: np.ndarray, radius: float) -> tuple[ds.Sphere, ds.PerspectiveCamera]:
    """Where a ball of this radius is whose outline is a mask's."""
    unit, camera = sphere_of_circle(circle_from_mask(mask), phone.SHAPE, phone.FOV)
    return ds.Sphere(radius * np.asarray(unit.center), radius), camera


def calibrated(folder: Path) -> NearLights:
    """All that a user does: masks, rays of the highlights, and the refinement."""
    sample, mirror = phone.masks()
    sphere, camera = ball(sample, phone.RADIUS)
    other, _ = ball(mirror, phone.MIRROR_RADIUS)
    images, valid = [], []
    for k in range(LAMPS + 1):
        encoded = read_image(folder / f"{k}.jpg").values
        clipped = (encoded >= 0.98).any(axis=-1)
        valid.append(~ndimage.binary_dilation(clipped, iterations=BLUR))
        images.append(decode(encoded, "srgb"))
    circle = circle_from_mask(mirror)
    seen = [find_highlight(image, circle, mirror) for image in images[:LAMPS]]
    x, y = (np.array([getattr(h, axis) for h in seen]) for axis in "xy")
    points, directions = (np.asarray(v, float) for v in mirrored(other, camera, x, y))
    law = ds.InverseSquare()
    lamps = points + GUESS * directions
    scenes = [ds.Scene(ambient=1.0, lights=ds.PointLight(p, phone.AT**2, law)) for p in lamps]
    off = np.full((1, 3), np.nan)
    return refine_near_lights(
        images,
        sphere,
        camera,
        [*scenes, ds.Scene(ambient=1.0)],
        points=np.append(points, off, axis=0),
        directions=np.append(directions, off, axis=0),
        outline=0.1,
        bounds=OPEN,
        valid=valid,
        encoding="srgb",
    )


@pytest.fixture(scope="module")
def found(folder: Path) -> NearLights:
    return calibrated(folder)


@pytest.mark.slow
@requires_povray
def test_the_coefficients_lie_in_their_intervals(found: NearLights) -> None:
    true = {
        name: np.broadcast_to(phone.MATERIAL[key], 3)
        for name, key in (("ka", "ka"), ("kd", "kd"), ("specular.0.ks", "ks"))
    }
    stated = [(phone.EXPOSURE * true[name], *found.intervals[name]) for name in true]
    n = phone.MATERIAL["shininess"]
    ratios = [("specular.0.ks", "kd"), ("ka", "kd")]
    exact = [(true[a] / true[b], *found.ratio(a, b)[1]) for a, b in ratios]
    exact.append((np.array([n]), *np.reshape(found.intervals["specular.0.shininess"], (2, 1))))
    missed = [int(np.sum((t < low) | (t > high))) for t, low, high in (*stated, *exact)]
    assert found.converged
    assert sum(missed) <= 1, (missed, found.coefficients, found.intervals)
    for t, low, high in exact:
        assert (high - low < 2 * 0.05 * t).all(), (low, high)


@pytest.mark.slow
@requires_povray
def test_the_lamps_lie_within_their_errors(found: NearLights) -> None:
    """To half a centimetre in 45."""
    error, own = found.positions[:LAMPS] - phone.LAMPS, found.standard_errors[:LAMPS]
    assert (np.abs(error) < 3 * own).all(), error / own
    assert np.linalg.norm(error, axis=-1).max() < 0.5, error
    assert np.isnan(found.positions[LAMPS]).all()
    np.testing.assert_allclose(found.sphere.center, phone.CENTER, atol=0.05)


@pytest.mark.slow
@requires_povray
def test_the_command_line_fits_what_was_calibrated(
    folder: Path, found: NearLights, capsys: pytest.CaptureFixture[str]
) -> None:
    """To 2 %: its intervals take the lamps for known, so that the truth need not be in them."""
    write_png(folder / "mask.png", phone.masks()[0], encoding=Encoding.UNKNOWN)
    text = CAPTURE.format(
        center=np.asarray(found.sphere.center).tolist(),
        radius=phone.RADIUS,
        height=phone.SHAPE[0],
        width=phone.SHAPE[1],
        fov=phone.FOV,
    )
    for k, position in enumerate(found.positions):
        text += f'[[image]]\nfile = "{k}.jpg"\nlights = ['
        if k < LAMPS:
            text += f'{{ kind = "point", position = {position.tolist()}, '
            text += f'intensity = {phone.AT**2}, attenuation = {{ kind = "inverse_square" }} }}'
        text += "]\n"
    (folder / "capture.toml").write_text(text)
    assert run(["fit", str(folder), "--json"]) == 0
    fitted = json.loads(capsys.readouterr().out)["coefficients"]
    lobe = fitted["lobes"][0]
    for key, value in (("ka", fitted["ka"]), ("kd", fitted["kd"]), ("ks", lobe["ks"])):
        true = phone.EXPOSURE * np.broadcast_to(phone.MATERIAL[key], 3)
        np.testing.assert_allclose(value, true, rtol=0.02, err_msg=key)
    assert lobe["shininess"] == pytest.approx(phone.MATERIAL["shininess"], rel=0.02)


def small(**parts: Any) -> NearLights:
    camera = ds.PerspectiveCamera(24, 24, 0.4, (0, 0, 0), (0, 0, -1))
    scene = ds.Scene(lights=ds.PointLight((2, 1, -3), 9.0))
    given = {"scenes": [scene], "camera": camera, "sphere": ds.Sphere((0, 0, -6)), **parts}
    return refine_near_lights([np.ones((24, 24, 1))], **given)


def test_other_lights_are_refused() -> None:
    with pytest.raises(BadInput, match="no scene has a lamp"):
        small(scenes=[ds.Scene(ambient=1.0)])
    with pytest.raises(BadInput, match="point light"):
        small(scenes=[ds.Scene(lights=ds.ParallelLight((0, 0, 1)))])
    with pytest.raises(BadInput, match="both, or neither"):
        small(points=np.zeros((1, 3)))
