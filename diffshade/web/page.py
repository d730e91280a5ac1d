"""The page: one HTML file that holds all it needs, and may load nothing."""

from __future__ import annotations

import base64
import hashlib
import json
import os
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from diffshade.errors import BadInput
from diffshade.geometry.mesh import Mesh
from diffshade.io.atomic import replacing
from diffshade.web.parameters import lights, parameters
from diffshade.web.program import program
from diffshade.web.scene_text import scene_text
from diffshade.web.shown import Shown, check
from diffshade.web.surface import surface

__all__ = ["page_text", "write_page"]

SCRIPTS = ("state", "vector", "picture", "toml", "link", "controls", "drag", "main")
"""In the order in which they stand in the page, as one module."""

LEGIBLE = 480
"""The width to which a small picture is enlarged, as far as whole factors go."""


def write_page(path: str | os.PathLike[str], shown: Shown) -> None:
    """Write the page into an `.html` file, whole or not at all; raises `BadInput` as `page_text` does."""
    if Path(path).suffix.lower() not in (".html", ".htm"):
        raise BadInput(f"{path}: a page is HTML; give a name that ends in .html")
    text = page_text(shown)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def page_text(shown: Shown) -> str:
    """An HTML page that shows a sphere or a mesh, with a slider for every coefficient.

    The picture is that of `ds.render`, as `write_image` makes a .png of it, to one of 255 levels in every
    pixel: which pixel sees what is the library's decision, and WebGL 2 shades it in float32. Where the
    model jumps, at the edge of a spot's cone or of a lobe at n.l = 0, a pixel may fall to either side.
    Nothing is loaded, nor may be. Raises `BadInput` for what there is no slider or formula for: maps,
    shadows, several materials, lights with extent, two channels or more than three.
    """
    check(shown)
    shader, kinds = program(shown)
    data = {
        "parameters": parameters(shown, kinds),
        "lights": lights(shown, kinds),
        "surface": surface(shown),
        "shader": shader,
        "toml": scene_text(shown, kinds),
    }
    script = "\n".join(_resource(f"js/{name}.js") for name in SCRIPTS)
    height, width = shown.camera.height, shown.camera.width
    factor = max(1, LEGIBLE // width)
    size = f"--width: {width * factor}px; --aspect: {width / height:.6g}"
    scaling = "pixelated" if factor > 1 else "auto"
    style = f":root {{ {size}; --scaling: {scaling}; }}\n{_resource('view.css')}"
    return Template(_resource("view.html")).substitute(
        title=escape(shown.title.encode("utf-8", "replace").decode()),  # a file name may be none
        policy=f"default-src 'none'; script-src {_hash(script)}; style-src {_hash(style)}",
        width=width,
        height=height,
        shape="mesh" if isinstance(shown.geometry, Mesh) else "sphere",
        style=style,
        data=_inside_script(data),
        script=script,
    )


def _resource(name: str) -> str:
    return files("diffshade.web").joinpath(name).read_text(encoding="utf-8")


def _inside_script(data: Any) -> str:
    """JSON in which nothing ends an element: `<` is written by its number."""
    return json.dumps(data, allow_nan=False, ensure_ascii=False).replace("<", "\\u003c")


def _hash(text: str) -> str:
    """What the browser compares an element with before it believes it (CSP, level 2)."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
