"""Make this capture with POV-Ray 3.7: `python diffshade/captures/glossy_ball/make.py`.

A glossy ball under near point lights, rendered by a program that shares nothing with this package.
POV-Ray's `ambient`, `diffuse`, `phong` and `phong_size` are k_a, k_d, k_s and n of

    I = I_a k_a + sum over lights of I_p f(d) [k_d max(0, n.l) + k_s max(0, r.v)^n]

and its `fade_distance D fade_power 2` is 2 / (1 + (d/D)^2). That is f(d) = 1 / (c0 + c1 d + c2 d^2)
with c0 = 1, c1 = 0, c2 = 1/D^2 under a light of twice POV-Ray's colour: `capture.toml` holds the
doubled intensity, `scene.pov` POV-Ray's. f is at most 1 at every distance, so no clamp acts.

The images get Gaussian noise like a sensor's. Without any, all pixels that see only the ambient
term round the same way: k_a then comes back 1e-4 off, at a hundred of its standard errors. For the
same reason POV-Ray dithers its 16 bits before the noise is added, so that means are kept.

Everything else in this folder is written by this file. Nothing else in the package needs POV-Ray.
"""

import json
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import imagecodecs
import numpy as np

HERE = Path(__file__).resolve().parent

KA = (0.040, 0.012, 0.008)
KD = (0.700, 0.150, 0.050)
KS = (0.400, 0.400, 0.400)
SHININESS = 60.0
FADE_DISTANCE = 1.6

SIZE = 160
"""Width and height of an image in pixels."""
EXTENT = 2.25
"""World units across an image; the ball has radius 1."""
NOISE = 2e-4
"""Standard deviation of the noise, in units of full scale."""


class Light(NamedTuple):
    """A near point light, with the intensity that the model takes."""

    position: tuple[float, float, float]
    intensity: tuple[float, float, float]


SHOTS: tuple[tuple[Light, ...], ...] = (
    (Light((-1.1, 1.2, 1.9), (1.66, 1.66, 1.66)),),
    (Light((1.2, 0.3, 1.5), (1.20, 1.20, 1.20)),),
    (Light((0.2, 1.9, 1.7), (1.80, 1.60, 1.30)),),
    (
        Light((-1.9, 0.6, 2.3), (2.30, 1.90, 1.50)),
        Light((1.9, -0.2, -0.5), (1.60, 2.30, 3.00)),
    ),
    (Light((0.9, 0.8, 4.4), (4.80, 4.80, 4.80)),),
    (
        Light((-0.7, -1.3, 1.6), (1.40, 1.20, 1.00)),
        Light((2.3, 2.4, 2.9), (4.20, 4.80, 5.40)),
    ),
)
"""The lights of each image."""


def scene() -> str:
    """The scene file for all images; `Declare=Shot=k` on POV-Ray's command line chooses one."""
    cases = []
    for number, lights in enumerate(SHOTS, 1):
        lines = "\n".join(
            f"    Near({_vector(x.position)}, {_vector(c / 2 for c in x.intensity)})"
            for x in lights
        )
        cases.append(f"  #case ({number})\n{lines}\n  #break")
    newline = "\n"
    return f"""// A glossy ball under near point lights, for POV-Ray 3.7, written by make.py.
//   povray +Iscene.pov +O001.png Declare=Shot=1 +W{SIZE} +H{SIZE} +FN16 File_Gamma=1.0 -A -D
#version 3.7;
#ifndef (Shot) #declare Shot = 1; #end

#declare Ka = {_vector(KA)};
#declare Kd = {_vector(KD)};
#declare Ks = {KS[0]};
#declare N  = {SHININESS};

global_settings {{ assumed_gamma 1 ambient_light rgb 1 }}

// World axes: x right, y up, z towards the viewer. Explicit vectors keep them right-handed.
camera {{
  orthographic
  location <0, 0, 10> direction <0, 0, -1>
  right <{EXTENT}, 0, 0> up <0, {EXTENT}, 0>
}}

// Colour * 2 / (1 + (d / D)^2)
#macro Near (Position, Colour)
  light_source {{ Position rgb Colour fade_distance {FADE_DISTANCE} fade_power 2 }}
#end

#switch (Shot)
{newline.join(cases)}
#end

sphere {{
  <0, 0, 0>, 1
  // The pigment multiplies `diffuse` and `ambient`; the highlight has the colour of the light.
  pigment {{ rgb Kd }}
  finish {{ ambient rgb Ka / Kd diffuse 1 phong Ks phong_size N }}
  no_shadow
}}
"""


def capture() -> str:
    """`capture.toml`: what a fit is told. The attenuation has no numbers, so it is fitted."""
    head = f"""# A glossy ball by POV-Ray (make.py). The true coefficients are in truth.json.
schema   = "diffshade.capture/1"
encoding = "linear"
ambient  = [1.0, 1.0, 1.0]
geometry = {{ kind = "sphere", center = [0.0, 0.0, 0.0], radius = 1.0 }}
camera   = {{ kind = "orthographic", width = {SIZE}, height = {SIZE}, extent = {EXTENT} }}
"""
    images = []
    for number, lights in enumerate(SHOTS, 1):
        entries = "".join(
            f'    {{ kind = "point", position = {list(x.position)}, '
            f'intensity = {list(x.intensity)}, attenuation = {{ kind = "quadratic" }} }},\n'
            for x in lights
        )
        images.append(f'\n[[image]]\nfile   = "{_name(number)}"\nlights = [\n{entries}]\n')
    return head + "".join(images)


def truth() -> str:
    """`truth.json`: the coefficients that went in, attenuation in the normalisation c0 = 1."""
    values = {
        "ka": KA,
        "kd": KD,
        "ks": KS,
        "shininess": SHININESS,
        "attenuation": {"c0": 1.0, "c1": 0.0, "c2": round(FADE_DISTANCE**-2, 12)},
    }
    return json.dumps(values, indent=2) + "\n"


def add_noise(image: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Noise on what the ball covers; the background stays 0."""
    noisy = np.rint(image + random.normal(0.0, NOISE * 65535, image.shape)).astype(np.uint16)
    return np.where(image.any(axis=-1, keepdims=True), noisy, 0)


def main() -> None:
    """Write the scene, the capture and the truth, and render the images."""
    (HERE / "scene.pov").write_text(scene(), encoding="utf-8")
    (HERE / "capture.toml").write_text(capture(), encoding="utf-8")
    (HERE / "truth.json").write_text(truth(), encoding="utf-8")
    options = f"+W{SIZE} +H{SIZE} +FN16 File_Gamma=1.0 Dither=on Dither_Method=FS -A -D -GA -V"
    random = np.random.default_rng(1)
    for number in range(1, len(SHOTS) + 1):
        file = HERE / _name(number)
        files = ["+Iscene.pov", f"+O{file.name}", f"Declare=Shot={number}"]
        command = ["povray", *files, *options.split()]
        run = subprocess.run(command, cwd=HERE, capture_output=True, text=True, check=False)
        if run.returncode != 0:
            raise SystemExit(run.stderr)
        image = add_noise(imagecodecs.png_decode(file.read_bytes()), random)
        file.write_bytes(imagecodecs.png_encode(image, level=9))


def _name(number: int) -> str:
    return f"{number:03}.png"


def _vector(values: Iterable[float]) -> str:
    return f"<{', '.join(f'{x:g}' for x in values)}>"


if __name__ == "__main__":
    main()
