"""What tests of the command line need: the program, a small capture, and strict JSON."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from diffshade.cli import run
from diffshade.io.image import write_png

SIZE = 40
KA, KD, KS, SHININESS = (0.1, 0.05, 0.02), (0.5, 0.3, 0.1), 0.3, 20.0
LIGHTS = ((0.4, 0.5, 1.0), (-0.6, 0.1, 1.0))
HEAD = f"""schema = "diffshade.capture/1"
encoding = "linear"
ambient = 1.0
geometry = {{ kind = "sphere", center = [0, 0, 0], radius = 1.0 }}
camera = {{ kind = "orthographic", width = {SIZE}, height = {SIZE}, extent = 2.2 }}
"""


def light(direction: tuple[float, ...]) -> str:
    return f'{{ kind = "parallel", direction = {list(direction)}, intensity = 1.0 }}'


def image_entry(file: str, *lights: str) -> str:
    return f'[[image]]\nfile = "{file}"\nlights = [{", ".join(lights)}]\n'


def scene(direction: tuple[float, ...], **parts: str) -> str:
    """A scene.toml under one light; `parts` replaces whole lines."""
    lines = dict(line.split(" = ", 1) for line in HEAD.splitlines()[2:])
    lines |= {"lights": f"[{light(direction)}]"}
    material = f"ka = {list(KA)}, kd = {list(KD)}, specular = [{{ kind = 'phong', ks = {KS}"
    lines["material"] = f"{{ {material}, shininess = {SHININESS} }}] }}"
    return "".join(f"{key} = {value}\n" for key, value in (lines | parts).items())


def interrupted(*_: object) -> None:
    """In the place of a function during which Ctrl-C is pressed."""
    raise KeyboardInterrupt


def program(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    """`python -m diffshade` in a process of its own."""
    command = [sys.executable, "-m", "diffshade", *map(str, arguments)]
    root = Path(__file__).parents[1]
    path = os.pathsep.join(filter(None, [str(root), os.environ.get("PYTHONPATH")]))
    # JAX leaves its log level in this process's environment; a user's has none.
    own = {k: v for k, v in os.environ.items() if k != "TF_CPP_MIN_LOG_LEVEL"}
    return subprocess.run(
        command,
        env={**own, "PYTHONPATH": path, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def strict_json(text: str) -> dict:
    """JSON as the standard has it: no NaN, no Infinity."""

    def refuse(constant: str) -> float:
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


def shape(value: object) -> object:
    """What stays of a document when its numbers, and the nulls in their place, are taken out."""
    if isinstance(value, dict):
        return {key: shape(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [shape(entry) for entry in value]
    return value if isinstance(value, str) else None


def flat(value: Any) -> list[float]:
    """The numbers of a JSON value, one after the other; of names nothing."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        return [number for item in value for number in flat(item)]
    return [] if isinstance(value, str) else [value]


def make_capture(folder: Path) -> Path:
    """A small ball under two lights, rendered by the command line itself, in 16 bits."""
    for k, direction in enumerate(LIGHTS):
        (folder / "scene.toml").write_text(scene(direction))
        assert run(["render", str(folder / "scene.toml"), "--out", str(folder / "image.npy")]) == 0
        write_png(folder / f"{k}.png", np.clip(np.load(folder / "image.npy"), 0, 1), bits=16)
    entries = (image_entry(f"{k}.png", light(direction)) for k, direction in enumerate(LIGHTS))
    (folder / "capture.toml").write_text(HEAD + "".join(entries))
    return folder
