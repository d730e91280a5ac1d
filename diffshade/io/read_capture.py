"""Any capture on disk, by what its path is."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from diffshade.errors import BadInput
from diffshade.io.capture import Capture
from diffshade.io.contents import within
from diffshade.progress import Progress

__all__ = ["read_capture"]


def read_capture(
    path: str | os.PathLike[str],
    *,
    white: float | None = None,
    circle: tuple[float, float, float] | None = None,
    encoding: str | float | None = None,
    allow_outside: bool = False,
    progress: Progress | None = None,
) -> Capture:
    """Read a folder in the photometric-stereo layout, an RTI `.lp` file, Relight's `.dome`,
    AliceVision's `lights.json`, a `capture.toml`, or the folder that holds one (which goes before the
    layout).

    `white` is the encoded level at which the sensor clips, as a part of full scale (in the units of
    a floating-point file). `circle` is the outline (cx, cy, radius) of a ball in pixels from the
    top left corner, where the first pixel's centre is (0.5, 0.5). `encoding` is "linear", "srgb"
    or a gamma, and goes before what the files say. The files of a capture lie in its folder; with
    `allow_outside` they may lie anywhere, by `..`, an absolute path or symbolic links.
    `progress` is called after each image, with how many are read and how many there are.

    Raises `BadInput`, in one line, for whatever cannot be used.

    >>> capture = read_capture("diligent_ball")
    >>> fit = fitting.fit(
    ...     capture.images, capture.gbuffer, capture.scenes, valid=capture.valid,
    ...     attenuation=capture.fit_attenuation,
    ... )
    """
    path = Path(path)
    options: Any = {
        "white": white,
        "encoding": encoding,
        "allow_outside": allow_outside,
        "progress": progress,
    }
    if os.path.isfile(path / "capture.toml"):
        path = within(path, "capture.toml", allow_outside=allow_outside)
    if os.path.isdir(path):
        from diffshade.io.photometric_stereo import FILES, read_photometric_stereo

        if not any(os.path.isfile(path / name) for name in FILES):
            raise BadInput(_no_capture_in(path, FILES))
        return read_photometric_stereo(path, **options, circle=circle)
    if not os.path.exists(path):
        raise BadInput(f"{path}: there is no such file or folder; check the path")
    match path.suffix.lower():
        case ".lp":
            from diffshade.io.lp import read_lp

            return read_lp(path, **options, circle=circle)
        case ".dome":
            from diffshade.io.dome import read_dome

            return read_dome(path, **options, circle=circle)
        case ".json":
            from diffshade.io.alicevision_capture import read_alicevision

            return read_alicevision(path, **options, circle=circle)
        case ".toml":
            from diffshade.io.capture_toml import read_capture_toml

            if circle is not None:
                raise BadInput(
                    f"{path}: a circle was given, but this file states its own geometry; leave out"
                    " --circle, or change geometry and camera there"
                )
            return read_capture_toml(path, **options)
    raise BadInput(
        f"{path}: is not a capture; give a folder in the photometric-stereo layout, an .lp file, a .dome"
        " file, AliceVision's lights.json or a capture.toml"
    )


def _no_capture_in(folder: Path, files: Sequence[str]) -> str:
    others = sorted(
        file.name
        for file in folder.iterdir()
        if file.suffix.lower() in (".lp", ".dome") or file.name.lower() == "lights.json"
    )
    instead = f"; it holds {others[0]}: give that file" if others else ""
    return (
        f"{folder}: holds neither capture.toml nor {' and '.join(files)}{instead or '; add them'}"
    )
