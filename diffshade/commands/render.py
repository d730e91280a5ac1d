"""`diffshade render`: an image of a sphere or a mesh from a `scene.toml`."""

from pathlib import Path

import numpy as np

from diffshade.commands.console import note
from diffshade.errors import naming
from diffshade.progress import bar

__all__ = ["render"]


def render(path: Path, *, out: Path, allow_outside: bool) -> int:
    """Render a scene into a file; returns the exit status."""
    from diffshade.io.image import write_image
    from diffshade.io.scene_toml import read_scene_toml
    from diffshade.shading.transparency import render_layers

    with bar(f"reading {path}"):
        file = read_scene_toml(path, allow_outside=allow_outside)
        layers = file.layers(path)
    for found in file.notes:
        note(found)
    pixels = sum(gbuffer.pixel_count for (gbuffer,) in layers)
    what = f"rendering {pixels} pixels" + f" in {len(layers)} layers" * (len(layers) > 1)
    with naming(path), bar(what):
        scene = file.lit(layers[0][0])
        image = np.asarray(render_layers(layers, scene, [file.material], file.transparency))
    write_image(out, image)
    brighter = np.mean(image[layers[0][0].mask].max(axis=-1) > 1)
    if brighter and out.suffix.lower() == ".png":
        note(
            f"{100 * brighter:.2g} % of the object's pixels are brighter than 1, and white in"
            f" {out}; an .exr or an .npy keeps them"
        )
    return 0
