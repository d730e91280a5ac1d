"""three.js `MeshPhongMaterial`, as the JSON that `THREE.MaterialLoader` parses.

    f = color / pi + F(h.v) (n/2 + 1) (n.h)^n / (4 pi),   F = specular + (1 - specular) s
    s = 2^((-5.55473 h.v - 6.98316) h.v)

(three.js, `bsdfs.glsl.js` and `lights_phong_pars_fragment.glsl.js`): the halfway vector, normalised, with
a quarter for the geometry, and Schlick's boundary in Epic's form, times n.l of the light. Colours are
8-bit integers, coded as sRGB: what rounding loses is told, and is part of the error.
"""

import json
import os
from uuid import NAMESPACE_URL, uuid5

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.channels import Channels, channels, times
from diffshade.colour.srgb import from_srgb, to_srgb
from diffshade.export.angular_error import angular_error
from diffshade.export.coefficients import RGB, diffuse, highlight
from diffshade.export.document import (
    NO_AMBIENT,
    Export,
    check_reflects,
    extras,
    in_gamut,
    lit_by,
    write,
)
from diffshade.export.response import AbstractResponse, Exact, upright
from diffshade.reflectance.blinn_phong import BlinnPhong
from diffshade.reflectance.lambert import lambert
from diffshade.reflectance.material import Material
from diffshade.vector import Vec3, dot, halfway

__all__ = ["as_threejs", "write_threejs"]


def as_threejs(material: Material, name: str = "material", *, irradiance: float = np.pi) -> Export:
    """A material alone. `irradiance` is the `intensity` of a DirectionalLight for I_p = 1.

    Raises `BadInput` for maps, and where a colour would be above 1.

    >>> document = json.loads(as_threejs(Material(kd=(1.0, 0.5, 0.0))).text)
    >>> document["type"], hex(document["color"])
    ('MeshPhongMaterial', '0xffbc00')
    """
    check_reflects(material)
    E, lobe, kd = lit_by(irradiance), highlight(material), diffuse(material)
    albedo = np.zeros(3) if kd is None else np.pi * kd / E
    exponent = 0.0 if lobe is None else lobe.exponent
    f0 = np.zeros(3) if lobe is None else 8 * np.pi * lobe.ks / (E * (exponent + 2))
    enough = E * max(float(albedo.max()), float(f0.max()))
    color, specular = (
        _code(np.array(in_gamut(key, value, enough)))
        for key, value in (("color", albedo), ("specular", f0))
    )
    notes: tuple[str, ...] = () if material.ka is None else (NO_AMBIENT,)
    notes += () if lobe is None else lobe.notes
    if lobe is None:
        notes += ("specular is 0, of which three.js still makes a rim at grazing angles",)
    notes += (_residual("color", albedo, color), _residual("specular", f0, specular))
    error = angular_error(Exact(material), MeshPhong.read(color, specular, exponent, E))
    document = {
        "metadata": {"version": 4.6, "type": "Material", "generator": "diffshade"},
        "uuid": str(uuid5(NAMESPACE_URL, f"{name} {color} {specular} {exponent}")),
        "type": "MeshPhongMaterial",
        "name": name,
        "color": color,
        "emissive": 0,
        "specular": specular,
        "shininess": exponent,
        "userData": {"diffshade": extras(material, error, notes, E)},
    }
    return Export(json.dumps(document, indent=2, allow_nan=False) + "\n", error, notes)


def write_threejs(
    path: str | os.PathLike[str],
    material: Material,
    name: str = "material",
    *,
    irradiance: float = np.pi,
) -> Export:
    """Write what `as_threejs` makes; atomic.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     len(write_threejs(f"{folder}/a.json", Material(kd=0.5)).notes)
    3
    """
    return write(path, as_threejs(material, name, irradiance=irradiance))


class MeshPhong(AbstractResponse):
    """What the shader of three.js makes of its numbers, in light of an irradiance."""

    color: Float[Array, "3"]
    specular: Float[Array, "3"]
    shininess: Float[Array, ""]
    irradiance: Float[Array, ""]

    @classmethod
    def read(cls, color: int, specular: int, shininess: float, irradiance: float) -> "MeshPhong":
        """From the numbers of a file."""
        numbers = _linear(color), _linear(specular), shininess, irradiance
        return cls(*(jnp.asarray(number, float) for number in numbers))

    def __call__(self, l: Vec3, v: Vec3) -> Channels:
        lit = self.irradiance * lambert(l.z) / np.pi
        (power,) = BlinnPhong(jnp.ones(()), self.shininess).shape(upright(l), l, v, l.z)
        highlight = (0.5 * self.shininess + 1) * 0.25 * power
        cosine = guard.positive(dot(halfway(l, v), v))
        grazing = jnp.exp2((-5.55473 * cosine - 6.98316) * cosine)
        both = zip(channels(self.color), channels(self.specular), strict=True)
        found = tuple(color + (f0 + (1 - f0) * grazing) * highlight for color, f0 in both)
        return times((lit,), found)


def _code(linear: RGB) -> int:
    red, green, blue = (int(x) for x in np.rint(255 * to_srgb(linear)))
    return red << 16 | green << 8 | blue


def _linear(code: int) -> RGB:
    return np.asarray(from_srgb(np.array([code >> 16, code >> 8 & 255, code & 255]) / 255))


def _residual(key: str, wanted: RGB, code: int) -> str:
    off = float(np.abs(_linear(code) - wanted).max())
    return (
        f"{key} is three integers of 8 bits, 0x{code:06x}: off by {off:.2g} of {wanted.max():.3g}"
    )
