"""POV-Ray 3.7 as an independent renderer of the same model.

    I = I_a k_a + sum over lights of I_p f [k_d max(0, n.l) + k_s max(0, r.v)^n]

is what POV-Ray's `ambient`, `diffuse`, `phong` and `phong_size` compute, and it drops both terms
of a light where n.l < 1e-10. `render` writes a scene from plain dictionaries (the same as
`reference.py` takes), runs the program and returns the linear image. What is worth knowing:

- **Colour.** `phong` is one number and its highlight has the colour of the light, so ks in RGB does
  not fit in one scene. Each channel is a grey scene of its own here (channels with equal numbers
  share one), which makes every coefficient a number and needs no quotients of colours.
- **Attenuation.** `fade_distance D fade_power 2` is 2 / (1 + (d/D)^2). Light of intensity I with
  1 / (c0 + c2 d^2) is therefore POV-Ray's light of colour I / (2 c0) with D = sqrt(c0 / c2); with
  `fade_power 1` and D = c0 / c1 it is 1 / (c0 + c1 d). In the normalisation c0 = 1 the
  attenuation of the model is f <= 1 at every distance and its clamp is never active, while
  POV-Ray's own factor lies above 1 nearer than D: the factor 2 belongs to the intensity.
  Constants with c1 and c2 both positive, or c0 < 1 (where the clamp may act), are refused.
  The law 1 / d^2, "inverse_square", is the same with D so small beside d that the 1 is nothing.
- **Mirrors.** A material's `reflection` shows the other objects, and what emits by its `ka`; light
  sources themselves are not seen. A mirror throws no light on the others.
- **Cameras.** POV-Ray is left-handed only by its default vectors and by `look_at`. `direction`,
  `right` and `up` as given are taken as they are, so our right-handed axes go in unchanged. The
  ray of a pixel goes through its centre; `right` and `up` span the image.
- **Normals.** A normal that faces away from the viewer is turned around. On a closed mesh that
  happens next to the outline, where the interpolated normal leans over: compare where n.v > 0.
- **Outline.** A sphere is missed where the squared half chord is under 1e-10, so rays within
  5e-11 / r^2 (relative) of the outline miss. There are shadows where asked for.
- **Numbers.** Geometry is double precision for a sphere and single for a mesh; colours are single.
  The file is linear (`File_Gamma=1.0` with `assumed_gamma 1`), 16 bits, rounded to nearest without
  dithering, so the image is right to 0.5 / 65535 = 7.6e-6 plus single-precision noise.
- **Limits.** Values must stay below 1: `render` refuses a saturated image. With `phong_size` of 60
  and more POV-Ray drops the highlight where r.v < 0.0008, which is below 1e-185.
"""

import functools
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest

Array = np.ndarray
Plain = Mapping[str, Any]

ROUNDING = 0.5 / 65535
"""Largest error of a value by its rounding to 16 bits."""

requires_povray = pytest.mark.skipif(
    shutil.which("povray") is None,
    reason="POV-Ray is not installed (Debian: apt-get install povray)",
)
NEAR = 1e-3
"""A distance that is nothing beside those of the scenes."""


def render(
    objects: Sequence[tuple[Plain, Plain]],
    lights: Sequence[Plain],
    camera: Plain,
    *,
    ambient: Any = 0.0,
    shadows: bool = False,
) -> Array:
    """The image [H, W, 3] of (geometry, material) pairs: linear, background 0."""
    scenes = [
        scene(
            [(geometry, _channel(material, k)) for geometry, material in objects],
            [_channel(light, k) for light in lights],
            camera,
            ambient=_number(ambient, k),
            shadows=shadows,
        )
        for k in range(3)
    ]
    planes = _run(sorted(set(scenes)), camera["width"], camera["height"])
    return np.stack([planes[text] for text in scenes], axis=-1)


def mask(geometries: Sequence[Plain], camera: Plain) -> Array:
    """Which pixels [H, W] see a surface, whatever its shading."""
    glow = {"ka": 0.5, "kd": 0.0, "ks": 0.0}
    text = scene([(geometry, glow) for geometry in geometries], (), camera, ambient=1.0)
    return _outline(text, camera["width"], camera["height"])


@functools.cache
def _outline(text: str, width: int, height: int) -> Array:
    return _run([text], width, height)[text] > 0.0


def scene(
    objects: Sequence[tuple[Plain, Plain]],
    lights: Sequence[Plain],
    camera: Plain,
    *,
    ambient: float,
    shadows: bool = False,
) -> str:
    """The grey scene as POV-Ray reads it. Every coefficient and intensity is one number."""
    depth = 2 if any("reflection" in material for _, material in objects) else 1
    parts = [
        "#version 3.7;",
        "global_settings { assumed_gamma 1 "
        f"ambient_light rgb {ambient!r} adc_bailout 0 max_trace_level {depth} }}",
        _camera(camera),
        *(_light(light) for light in lights),
        *(_object(geometry, material, shadows) for geometry, material in objects),
    ]
    return "\n".join(parts) + "\n"


def _camera(camera: Plain) -> str:
    position = np.asarray(camera.get("position", (0.0, 0.0, 1e3)), np.float64)
    target = np.asarray(camera.get("target", (0.0, 0.0, 0.0)), np.float64)
    forward = target - position
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, np.asarray(camera.get("up", (0.0, 1.0, 0.0)), np.float64))
    right = right / np.linalg.norm(right)
    up = np.cross(right, forward)
    if camera["kind"] == "orthographic":
        across = camera["extent"]
        down = across * camera["height"] / camera["width"]
    else:
        down = 2.0 * np.tan(camera["fov"] / 2.0)
        across = down * camera["width"] / camera["height"]
    return (
        f"camera {{ {camera['kind']} location {_vector(position)} direction {_vector(forward)} "
        f"right {_vector(across * right)} up {_vector(down * up)} }}"
    )


def _light(light: Plain) -> str:
    intensity = light["intensity"]
    if light["kind"] == "parallel":
        # Parallel rays run from the position to `point_at`; neither attenuates them.
        towards = np.asarray(light["direction"], np.float64)
        position = 100.0 * towards / np.linalg.norm(towards)
        return (
            f"light_source {{ {_vector(position)} rgb {intensity!r} parallel point_at <0, 0, 0> }}"
        )
    fade = ""
    constants = light.get("attenuation")
    if constants == "inverse_square":
        fade = f" fade_distance {NEAR!r} fade_power 2"
        intensity = intensity / (2.0 * NEAR**2)
    elif constants is not None:
        c0, c1, c2 = (float(constants.get(name, 0.0)) for name in ("c0", "c1", "c2"))
        if c0 < 1.0 or (c1 > 0.0 and c2 > 0.0):
            raise ValueError(f"POV-Ray cannot attenuate by {c0, c1, c2}: c0 >= 1, c1 or c2 zero")
        if c2 > 0.0:
            fade = f" fade_distance {(c0 / c2) ** 0.5!r} fade_power 2"
        elif c1 > 0.0:
            fade = f" fade_distance {c0 / c1!r} fade_power 1"
        intensity = intensity / (2.0 * c0 if fade else c0)
    return f"light_source {{ {_vector(light['position'])} rgb {intensity!r}{fade} }}"


def _object(geometry: Plain, material: Plain, shadows: bool) -> str:
    finish = (
        f"ambient {material['ka']!r} diffuse {material['kd']!r} "
        f"phong {material['ks']!r} phong_size {float(material.get('shininess', 1.0))!r}"
    )
    if "reflection" in material:
        finish += f" reflection {float(material['reflection'])!r}"
    texture = f"texture {{ pigment {{ rgb 1 }} finish {{ {finish} }} }}"
    texture += "" if shadows else " no_shadow"
    if geometry["kind"] == "sphere":
        center, radius = geometry["center"], float(geometry["radius"])
        return f"sphere {{ {_vector(center)}, {radius!r} {texture} }}"
    lists = (
        ("vertex_vectors", "vertices"),
        ("normal_vectors", "normals"),
        ("face_indices", "faces"),
    )
    body = "\n".join(
        f"  {name} {{ {len(geometry[key])}, {', '.join(_vector(row) for row in geometry[key])} }}"
        for name, key in lists
    )
    return f"mesh2 {{\n{body}\n  {texture}\n}}"


def _channel(fields: Plain, k: int) -> Plain:
    """A light's intensity or a material's coefficients in channel k, absent ones zero."""
    if "kind" in fields:
        return {**fields, "intensity": _number(fields["intensity"], k)}
    return {**fields, **{name: _number(fields.get(name, 0.0), k) for name in ("ka", "kd", "ks")}}


def _number(value: Any, k: int) -> float:
    return float(np.broadcast_to(value, (3,))[k])


def _vector(values: Any) -> str:
    return f"<{', '.join(repr(x) for x in np.asarray(values).tolist())}>"


def _run(scenes: Sequence[str], width: int, height: int) -> dict[str, Array]:
    """Render grey scenes side by side (POV-Ray mostly waits when it starts); planes [H, W]."""
    with tempfile.TemporaryDirectory() as folder:
        runs = []
        for index, text in enumerate(scenes):
            Path(folder, f"{index}.pov").write_text(text)
            # 16-bit PNG, no anti-aliasing, no window, no console output but errors.
            options = (
                f"+I{index}.pov +O{index}.png +FN16 +W{width} +H{height} -A -D -GA +GF -V +WT1"
            )
            command = ["povray", *options.split(), "File_Gamma=1.0", "Dither=off"]
            runs.append(
                subprocess.Popen(
                    command,
                    cwd=folder,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.PIPE,
                    text=True,
                )
            )
        messages = [run.communicate(timeout=120)[1] for run in runs]
        for run, message in zip(runs, messages, strict=True):
            if run.returncode != 0:
                raise RuntimeError(f"POV-Ray failed:\n{message}")
        planes = {}
        for index, text in enumerate(scenes):
            data = imagecodecs.png_decode(Path(folder, f"{index}.png").read_bytes())
            if data.dtype != np.uint16 or data.shape[:2] != (height, width):
                raise RuntimeError(f"POV-Ray wrote {data.dtype} {data.shape}")
            if data.max() == 65535:
                raise ValueError("POV-Ray's image is saturated: lower the intensities")
            planes[text] = data[..., 0] / 65535.0
        return planes
