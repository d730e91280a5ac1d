"""`diffshade render`: an image of a sphere or a mesh from a `scene.toml`."""

from pathlib import Path

import numpy as np

from diffshade.commands.console import note, progress
from diffshade.errors import naming

__all__ = ["render"]


def render(path: Path, *, out: Path, allow_outside: bool) -> int:
    """Render a scene into a file; returns the exit status."""
    progress(f"reading {path}")
    from diffshade.io.image import write_image
    from diffshade.io.scene_toml import read_scene_toml
    from diffshade.shading.render import render as render_image

    file = read_scene_toml(path, allow_outside=allow_outside)
    for found in file.notes:
        note(found)
    gbuffer = file.gbuffer(path)
    progress(f"rendering {gbuffer.pixel_count} pixels")
    with naming(path):
        image = np.asarray(render_image(gbuffer, file.lit(gbuffer), file.material))
    write_image(out, image)
    brighter = np.mean(image[gbuffer.mask].max(axis=-1) > 1)
    if brighter and out.suffix.lower() == ".png":
        note(
            f"{100 * brighter:.2g} % of the object's pixels are brighter than 1, and white in"
            f" {out}; an .exr or an .npy keeps them"
        )
    return 0
