"""A Mitsuba 3 dictionary, for `mitsuba.load_dict`: a sum of plug-ins that Mitsuba has, in a `blendbsdf`.

| ours | theirs |
|---|---|
| Lambert's term | `diffuse`, of the reflectance pi k_d / E |
| `FresnelBody` | `plastic` whose own highlight is black |
| facets, as mirrors or of a metal | `roughconductor`, of the same distribution and alpha |
| facets of a clear boundary | `roughplastic` that is black below |
| Phong's and Blinn's lobes | `roughconductor`, Beckmann's, alpha = sqrt(2 / (n + 2)) of Blinn's n |

Mitsuba's masking is Smith's, separable. Schlick's boundary, which it has for no such plug-in, is that of
the index of refraction that reflects as much head-on.
"""

import json
import os
from typing import Any

import jax.numpy as jnp
import numpy as np

from diffshade.channels import Channels, plus
from diffshade.errors import BadInput
from diffshade.export.angular_error import angular_error
from diffshade.export.coefficients import (
    RGB,
    WEIGHED,
    diffuse,
    facet_width,
    head_on,
    lobe_ks,
    one,
    rgb,
)
from diffshade.export.document import NO_AMBIENT, Export, check_reflects, in_gamut, lit_by, write
from diffshade.export.response import AbstractResponse, Exact
from diffshade.reflectance.blinn_phong import BlinnPhong
from diffshade.reflectance.body import FresnelBody
from diffshade.reflectance.conversion import to_beckmann, to_blinn_phong
from diffshade.reflectance.fresnel import (
    AbstractFresnel,
    Conductor,
    Dielectric,
    Schlick,
    dielectric,
)
from diffshade.reflectance.lobe import AbstractLobe
from diffshade.reflectance.material import Material
from diffshade.reflectance.microfacet import GGX, AbstractMicrofacet, Beckmann
from diffshade.reflectance.phong import Phong
from diffshade.vector import Vec3

__all__ = ["as_mitsuba", "mitsuba_bsdf", "write_mitsuba"]

Plugin = dict[str, Any]


def mitsuba_bsdf(material: Material, *, irradiance: float = np.pi) -> Plugin:
    """The dictionary of a material. `irradiance` is that of a light of I_p = 1 in Mitsuba.

    Raises `BadInput` for maps, and where more light would be reflected than arrives.

    >>> mitsuba_bsdf(Material(kd=0.5))
    {'type': 'diffuse', 'reflectance': {'type': 'rgb', 'value': [0.5, 0.5, 0.5]}}
    """
    return _blended(_parts(material, lit_by(irradiance))[0], irradiance)


def as_mitsuba(material: Material, *, irradiance: float = np.pi) -> Export:
    """The same as JSON, with its error; `mitsuba.load_dict(json.loads(text))` takes it."""
    parts, notes = _parts(material, lit_by(irradiance))
    notes = (() if material.ka is None else (NO_AMBIENT,)) + notes
    bsdf = _blended(parts, irradiance)
    error = angular_error(Exact(material), Blend.read(bsdf, irradiance))
    return Export(json.dumps(bsdf, indent=2, allow_nan=False) + "\n", error, notes)


def write_mitsuba(
    path: str | os.PathLike[str], material: Material, *, irradiance: float = np.pi
) -> Export:
    """Write the JSON that `as_mitsuba` makes; atomic."""
    return write(path, as_mitsuba(material, irradiance=irradiance))


class Blend(AbstractResponse):
    """What Mitsuba makes of a dictionary of these plug-ins, in light of an irradiance."""

    parts: tuple[Material, ...]

    @classmethod
    def read(cls, bsdf: Plugin, irradiance: float) -> "Blend":
        """From the dictionary."""
        return cls(tuple(_material(p, irradiance * share) for p, share in _leaves(bsdf, 1.0)))

    def __call__(self, l: Vec3, v: Vec3) -> Channels:
        found: Channels = (jnp.zeros_like(l.z),)
        for part in self.parts:
            found = plus(found, Exact(part)(l, v))
        return found


def mean_inside(index: float) -> float:
    """The share of diffuse light that a smooth boundary sends back from inside a body.

        integral of F(c) 2 c dc over the cosines c in [0, 1], towards the inverse index

    >>> round(mean_inside(1.5), 3)
    0.596
    """
    x, w = np.polynomial.legendre.leggauss(200)
    # All is reflected beyond the critical angle, of cosine c: the rest is smooth.
    critical = np.sqrt(1 - 1 / index**2) if index > 1 else 0.0
    cosine = critical + 0.5 * (1 - critical) * (x + 1)
    inside = np.asarray(dielectric(jnp.asarray(cosine), jnp.asarray(1 / index)), float)
    return float(critical**2 + (1 - critical) * np.sum(w * cosine * inside))


def _parts(
    material: Material, irradiance: float
) -> tuple[list[tuple[Plugin, str, RGB]], tuple[str, ...]]:
    """Plug-ins without their reflectance, its name, and what it has to be."""
    check_reflects(material)
    found: list[tuple[Plugin, str, RGB]] = []
    notes: tuple[str, ...] = ()
    if material.kd is not None and material.body is None:
        albedo = np.pi * np.asarray(diffuse(material)) / irradiance
        found.append(({"type": "diffuse"}, "reflectance", albedo))
    elif material.kd is not None and material.body is not None:
        plain = Material(kd=material.kd, od=material.od)
        index, notes = one("the body's index", material.body.index)
        out = np.pi * np.asarray(diffuse(plain)) / irradiance * index**2 * (1 - mean_inside(index))
        smooth = {"type": "plastic", "int_ior": index, "ext_ior": 1.0}
        found.append(
            ({**smooth, "specular_reflectance": _rgb(np.zeros(3))}, "diffuse_reflectance", out)
        )
    for lobe in material.specular:
        plugin, ks, said = _facets(lobe, lobe_ks(material, lobe))
        found.append((plugin, "specular_reflectance", ks / irradiance))
        notes += said
    return found, tuple(dict.fromkeys(notes))


def _facets(lobe: AbstractLobe, ks: RGB) -> tuple[Plugin, RGB, tuple[str, ...]]:
    notes: tuple[str, ...] = ()
    if isinstance(lobe, Phong | BlinnPhong):
        notes = ("Mitsuba has no lobe that is a power of a cosine: Beckmann's facets stand for it",)
        if lobe.weight is not None:
            ks, notes = ks * head_on(lobe.weight), (*notes, WEIGHED)
        power = to_blinn_phong(lobe) if isinstance(lobe, Phong) else lobe
        exponent, mixed = one("the exponent", power.shininess)
        peak: Any = 1.0
        width: Any = exponent
        lobe = to_beckmann(BlinnPhong(peak, width))
        ks, notes = ks * rgb(lobe.ks), notes + mixed
    if not isinstance(lobe, AbstractMicrofacet):
        raise BadInput(f"a lobe of kind {lobe.kind!r} has no form in Mitsuba: use another")
    alpha, mixed = facet_width(lobe)
    known = {GGX: "ggx", Beckmann: "beckmann"}
    if type(lobe) not in known:
        mixed += (f"facets of kind {lobe.kind} are written as Beckmann's",)
    rough = {"distribution": known.get(type(lobe), "beckmann"), "alpha": alpha}
    notes += mixed
    match lobe.fresnel:
        case None:
            return {"type": "roughconductor", **rough, "material": "none"}, ks, notes
        case Conductor(index=index, extinction=extinction):
            metal = {"eta": _rgb(rgb(index)), "k": _rgb(rgb(extinction))}
            return {"type": "roughconductor", **rough, **metal}, ks, notes
        case Dielectric(index=index):
            eta, mixed = one("the index", index)
            notes += mixed
        case Schlick(f0=f0):
            shares = np.clip(rgb(f0), 1e-6, 0.98)
            eta = float((1 + np.sqrt(shares.mean())) / (1 - np.sqrt(shares.mean())))
            ks = ks * shares / shares.mean()
            notes += (f"Schlick's boundary is written as that of the index {eta:.4g}",)
        case other:
            raise BadInput(f"a boundary of kind {other.kind!r} has no form in Mitsuba: use another")
    black = {"diffuse_reflectance": _rgb(np.zeros(3)), "int_ior": eta, "ext_ior": 1.0}
    return {"type": "roughplastic", **rough, **black}, ks, notes


def _blended(parts: list[tuple[Plugin, str, RGB]], irradiance: float) -> Plugin:
    """Their sum: each with a share of the whole, and its reflectance over that share."""
    most = np.array([max(float(colour.max()), 1e-9) for _, _, colour in parts])
    whole = float(most.sum())
    plugins = []
    for (plugin, key, colour), share in zip(parts, most / whole, strict=True):
        value = in_gamut(f"the {key} of {plugin['type']}", colour / share, irradiance * whole)
        plugins.append({**plugin, key: _rgb(np.array(value))})
    found = plugins[-1]
    rest = most[-1]
    for plugin, own in zip(reversed(plugins[:-1]), reversed(most[:-1]), strict=True):
        rest += own
        weight = float(1 - own / rest)
        found = {"type": "blendbsdf", "weight": weight, "bsdf_0": plugin, "bsdf_1": found}
    return found


def _leaves(bsdf: Plugin, share: float) -> list[tuple[Plugin, float]]:
    if bsdf["type"] != "blendbsdf":
        return [(bsdf, share)]
    weight = bsdf["weight"]
    return [
        *_leaves(bsdf["bsdf_0"], share * (1 - weight)),
        *_leaves(bsdf["bsdf_1"], share * weight),
    ]


def _material(plugin: Plugin, irradiance: float) -> Material:
    """One plug-in as a material of ours: its BSDF times an irradiance."""

    def value(key: str) -> Any:
        return np.array(plugin[key]["value"])

    if plugin["type"] == "diffuse":
        return Material(kd=value("reflectance") * irradiance / np.pi)
    if plugin["type"] == "plastic":
        index = plugin["int_ior"]
        out = index**2 * (1 - mean_inside(index))
        kd = value("diffuse_reflectance") * irradiance / (np.pi * out)
        return Material(kd=kd, body=FresnelBody(index))
    fresnel: AbstractFresnel | None = None
    if plugin["type"] == "roughplastic":
        fresnel = Dielectric(plugin["int_ior"])
    elif "eta" in plugin:
        fresnel = Conductor(value("eta"), value("k"))
    ks = value("specular_reflectance") * irradiance
    if plugin["distribution"] == "ggx":
        return Material(specular=(GGX(ks, plugin["alpha"], fresnel, "separable"),))
    facets = Beckmann(ks, plugin["alpha"], fresnel, "separable", rational=True)
    return Material(specular=(facets,))


def _rgb(colour: RGB) -> Plugin:
    return {"type": "rgb", "value": colour.tolist()}
