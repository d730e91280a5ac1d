"""Photographs whose truth is known, and what a fit makes of them: what the notebooks on fitting drag.

Everything goes by public functions (`ds.render`, `fitting.fit`); images are linear radiance [H, W, C] in
float32 until `photograph` encodes them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from diffshade.errors import BadInput
from diffshade.gallery import direction
from diffshade.geometry import view
from diffshade.geometry.camera import OrthographicCamera
from diffshade.geometry.gbuffer import GBuffer
from diffshade.geometry.sphere import Sphere
from diffshade.io.atomic import replacing
from diffshade.io.encoding import Encoding
from diffshade.io.image import write_png
from diffshade.light.parallel import ParallelLight
from diffshade.reflectance.material import Material
from diffshade.reflectance.phong import Phong
from diffshade.scene import Scene
from diffshade.shading.render import render
from fitting.estimate import fit
from fitting.found import Fit

__all__ = [
    "Hidden",
    "ambient_or_diffuse",
    "around",
    "hide_and_recover",
    "photograph",
    "sheet",
    "spoilt",
]

Real = float | int

AMBIENT, INTENSITY = 0.5, 0.8
"""I_a and I_p over the sheet."""
LIGHTS, TILT = 6, 0.6
"""How many lights there are around the ball that is photographed, and how far from the viewer."""


def photograph(
    gbuffer: GBuffer,
    scene: Scene,
    material: Material,
    *,
    noise: Real = 0.0,
    white: Real | None = None,
    gamma: Real | None = None,
    seed: int = 0,
) -> Float[np.ndarray, "H W C"]:
    """A render as a camera records it: noise, then what it clips at `white`, then V = L^(1/gamma).

    `noise` is the standard deviation of each value, normal and independent, over the whole image; one
    `seed` gives one noise. With `white` values lie in [0, white]. `gamma` is that of the encoding,
    where negative values, of noise in the dark, become 0; None leaves radiance linear.

    >>> import diffshade as ds
    >>> ball = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(16, 16, 2.2))
    >>> front = ds.Scene(lights=ds.ParallelLight((0, 0, 1)))
    >>> float(photograph(ball, front, ds.Material(kd=0.8), white=0.5).max())
    0.5
    """
    if noise < 0 or (white is not None and white <= 0) or (gamma is not None and gamma <= 0):
        raise BadInput(
            f"noise {noise}, white {white}, gamma {gamma}: give noise >= 0, the others > 0"
        )
    radiance = np.asarray(render(gbuffer, scene, material), np.float32)
    shaken = np.random.default_rng(seed).normal(0, noise, radiance.shape).astype(np.float32)
    image = radiance + shaken
    if white is not None:
        image = np.clip(image, 0, np.float32(white))
    return image if gamma is None else np.maximum(image, 0) ** np.float32(1 / gamma)


@dataclass(frozen=True)
class Hidden:
    """Coefficients by the names of `Fit`, the photographs that show them, and what was found in them."""

    true: dict[str, float]
    images: tuple[Float[np.ndarray, "H W C"], ...]
    scenes: tuple[Scene, ...]
    fit: Fit

    @property
    def found(self) -> dict[str, float]:
        """The coefficients of `true`, as they were found."""
        return {name: float(np.squeeze(self.fit.coefficients[name])) for name in self.true}

    @property
    def errors(self) -> dict[str, float]:
        """Their standard errors, infinite where the photographs do not tell."""
        return {name: float(np.squeeze(self.fit.standard_errors[name])) for name in self.true}

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Their 95 % intervals."""
        ends = {name: self.fit.intervals[name] for name in self.true}
        return {n: (float(np.squeeze(a)), float(np.squeeze(b))) for n, (a, b) in ends.items()}


def hide_and_recover(
    gbuffer: GBuffer,
    *,
    ka: Real,
    kd: Real,
    ks: Real,
    shininess: Real,
    azimuth: Real,
    elevation: Real,
    noise: Real,
    seed: int = 0,
    **options: Any,
) -> Hidden:
    """Photograph a glossy surface, forget its coefficients, and fit them to the photograph.

    One parallel light of strength 0.7 from `gallery.direction(azimuth, elevation)`, in radians, and
    ambient light of 0.25. `options` are those of `fit`. All numbers are arguments of programs that are
    compiled once for a G-buffer: dragging them compiles none again.

    >>> import diffshade as ds
    >>> ball = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(32, 32, 2.2))
    >>> light = dict(azimuth=-0.5, elevation=0.5)
    >>> hidden = hide_and_recover(ball, ka=0.4, kd=0.6, ks=0.4, shininess=20, noise=0.0, **light)
    >>> round(hidden.found["specular.0.shininess"], 1)
    20.0
    """
    material = Material(
        jnp.asarray(ka, float),
        jnp.asarray(kd, float),
        (Phong(jnp.asarray(ks, float), jnp.asarray(shininess, float)),),
    )
    light = ParallelLight(direction(azimuth, elevation), jnp.asarray(0.7, float))
    scene = Scene(jnp.asarray(0.25, float), (light,))
    image = photograph(gbuffer, scene, material, noise=noise, seed=seed)
    lobe = "specular.0."
    true = {"ka": ka, "kd": kd, lobe + "ks": ks, lobe + "shininess": shininess}
    true = {name: float(value) for name, value in true.items()}
    return Hidden(true, (image,), (scene,), fit(image, gbuffer, scene, **options))


def sheet(size: int) -> GBuffer:
    """A flat sheet of size x size pixels that faces the viewer: one normal, (0, 0, 1), everywhere.

    >>> sheet(4).pixel_count
    16
    """
    return GBuffer.from_arrays(None, np.full((size, size, 3), (0, 0, 1), np.float32))


def ambient_or_diffuse(
    flat: GBuffer, angles: Sequence[Real], *, ka: Real, kd: Real, noise: Real
) -> Hidden:
    """Photograph a matte `sheet` once under each light, and fit k_a and k_d to all that it shows.

    Light k, of strength 0.8, comes in at `angles[k]` radians from the normal, beside ambient light of
    0.5. A photograph has one brightness, 0.5 k_a + 0.8 k_d cos(angle): a line in the plane of k_a and
    k_d. Two lines cross.

    >>> hidden = ambient_or_diffuse(sheet(8), [0.0, 1.0], ka=0.3, kd=0.6, noise=0.0)
    >>> round(hidden.found["ka"], 3), round(hidden.found["kd"], 3)
    (0.3, 0.6)
    """
    material = Material(jnp.asarray(ka, float), jnp.asarray(kd, float))
    scenes = tuple(
        Scene(
            jnp.asarray(AMBIENT, float),
            (ParallelLight(direction(angle, 0.0), jnp.asarray(INTENSITY, float)),),
        )
        for angle in angles
    )
    images = tuple(
        photograph(flat, scene, material, noise=noise, seed=k) for k, scene in enumerate(scenes)
    )
    found = fit(images, flat, scenes, material=material)
    return Hidden({"ka": float(ka), "kd": float(kd)}, images, scenes, found)


def spoilt(
    folder: Path,
    camera: OrthographicCamera,
    material: Material,
    *,
    white: Real | None = None,
    gamma: Real | None = None,
    turned: Real = 0.0,
    noise: Real = 0.002,
) -> Path:
    """Photograph a ball in six lights into a folder, and say nothing of what is wrong with it.

    The files are PNG of 16 bits, what is above 1 cut off. `capture.toml` beside them calls them linear,
    whatever `white` and `gamma` have done to them (`photograph`), and names every light at its place
    in a ring, though the third stood `turned` radians farther from the viewer when its picture was
    taken. The ball has radius 1. Returns the path that `read_capture` takes.

    >>> import diffshade as ds
    >>> import tempfile
    >>> camera, chalk = ds.OrthographicCamera(16, 16, 2.2), ds.Material(kd=0.5)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     spoilt(Path(folder), camera, chalk, gamma=2.2).name
    'capture.toml'
    """
    ball = view.gbuffer(Sphere(), camera)
    named = around(LIGHTS, TILT)
    stood = [*named[:2], *around(LIGHTS, TILT + turned)[2:3], *named[3:]]
    lines = [
        'schema = "diffshade.capture/1"',
        'encoding = "linear"',
        'geometry = { kind = "sphere", center = [0, 0, 0], radius = 1.0 }',
        f'camera = {{ kind = "orthographic", width = {camera.width}, height = {camera.height},'
        f" extent = {float(camera.extent)} }}",
    ]
    for k, (light, claimed) in enumerate(zip(stood, named, strict=True)):
        name = f"{k + 1:03}.png"
        lit = ParallelLight(jnp.asarray(light, float), jnp.asarray(1.0, float))
        scene = Scene(lights=(lit,))
        image = photograph(
            ball, scene, material, noise=noise, white=min(white or 1.0, 1.0), gamma=gamma, seed=k
        )
        write_png(folder / name, image, bits=16, encoding=Encoding.UNKNOWN)
        lines += [
            "[[image]]",
            f'file = "{name}"',
            f'lights = [{{ kind = "parallel", direction = {claimed.tolist()}, intensity = 1.0 }}]',
        ]
    path = folder / "capture.toml"
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def around(count: int, tilt: Real) -> Sequence[Float[np.ndarray, "3"]]:
    """Directions to `count` lights in a ring, each `tilt` radians from the viewer's.

    >>> [d.round(3).tolist() for d in around(2, np.pi / 6)]
    [[0.5, 0.0, 0.866], [-0.5, 0.0, 0.866]]
    """
    turns = 2 * np.pi * np.arange(count) / count
    z = np.full(count, np.cos(tilt))
    x, y = np.sin(tilt) * np.cos(turns), np.sin(tilt) * np.sin(turns)
    return list(np.stack([x, y, z], axis=1).round(15) + 0.0)
