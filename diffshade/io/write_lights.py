"""Directions to lights, one an image, into a file of a capture, which its ending chooses."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from diffshade.errors import BadInput
from diffshade.io.atomic import replacing
from diffshade.io.lp import write_lp
from diffshade.io.toml_text import value_text

__all__ = ["ENDINGS", "check_ending", "write_lights"]

Directions = Float[np.ndarray, "K 3"]


def write_lights(path: Path, images: Sequence[str], directions: Directions) -> None:
    """Write unit directions [K, 3] and the names of their K images; atomic.

    - `.toml`: `[[image]]` tables with parallel lights of intensity 1, to end a `capture.toml` with;
    - `.lp`: the light positions of an RTI;
    - `.txt`: the `light_directions.txt` of the photometric-stereo layout, whose `filenames.txt` is to
      have the images in the same order.

    Raises `BadInput` for another ending, for a name that does not print, and where the file cannot be
    written.

    >>> write_lights(Path("lights.toml"), ["a.png"], np.array([[0.6, 0.0, 0.8]]))
    >>> print(Path("lights.toml").read_text().splitlines()[-1])
    lights = [{ kind = "parallel", direction = [0.600000, 0.000000, 0.800000], intensity = 1.0 }]
    """
    ending = check_ending(path)
    for name in images:
        if not name.isprintable():
            raise BadInput(f"{path}: an image is named {name!r}; rename it, in letters that print")
    ENDINGS[ending](path, images, directions)


def check_ending(path: Path) -> str:
    """The ending of a file for lights; raises `BadInput` for one that is not known."""
    if (ending := path.suffix.lower()) not in ENDINGS:
        raise BadInput(
            f"{path}: lights are not written into {ending or 'a file without an ending'}; name a"
            f" file in {', '.join(ENDINGS)}"
        )
    return ending


def _toml(path: Path, images: Sequence[str], directions: Directions) -> None:
    tables = [
        f"\n[[image]]\nfile   = {value_text(name)}\n"
        f'lights = [{{ kind = "parallel", direction = [{_row(l, ", ")}], intensity = 1.0 }}]\n'
        for name, l in zip(images, directions, strict=True)
    ]
    heading = (
        "# The end of a capture.toml; schema, geometry and camera go before it. Each file is to be the\n"
        "# photograph of what is measured under the lamp of that mirror ball's.\n"
    )
    _write(path, "".join([heading, *tables]))


def _txt(path: Path, images: Sequence[str], directions: Directions) -> None:
    _write(path, "".join(f"{_row(l, ' ')}\n" for l in directions))


def _row(l: Float[np.ndarray, "3"], between: str) -> str:
    return between.join(f"{x:.6f}" for x in l)


def _write(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


ENDINGS: dict[str, Callable[[Path, Sequence[str], Directions], None]] = {
    ".toml": _toml,
    ".lp": write_lp,
    ".txt": _txt,
}
