"""Wavefront material libraries (`.mtl`), of the illumination equation with `illum 2`:

    Ka I_a + sum over lights [Kd n.l + Ks (n.h)^Ns]

(Alias/Wavefront, "MTL material format"). h is the halfway vector: Blinn's lobes are written as they are,
and of Phong's, Ns is 4 times the exponent, which is nearest; the file says so. Other lobes become the
nearest such highlight. A term that a material lacks is written as 0: without it other tools take a value
of their own.
"""

import os
from collections.abc import Mapping
from typing import Any

from diffshade.errors import BadInput
from diffshade.export.angular_error import angular_error
from diffshade.export.coefficients import RGB, Highlight, ambient, diffuse, highlight, one
from diffshade.export.document import Export
from diffshade.export.response import Exact
from diffshade.io.atomic import replacing
from diffshade.reflectance.blinn_phong import BlinnPhong
from diffshade.reflectance.material import Material
from diffshade.reflectance.microfacet import AbstractMicrofacet
from diffshade.reflectance.phong import Phong

__all__ = ["as_mtl", "write_mtl"]

HEAD = "# Materials of the illumination equation, written by diffshade\n"


def as_mtl(material: Material, name: str = "material") -> Export:
    """One material as a library. Raises `BadInput` for maps, and for a name of no or several lines.

    >>> from diffshade.reflectance.phong import Phong
    >>> [l for l in as_mtl(Material(kd=0.5, specular=Phong(0.25, 10))).text.splitlines() if "N" in l]
    ["# The lobe is Phong's, Ks (r.v)^10; illum 2 has (N.H)^Ns: Ns is 4 times the exponent", 'Ns 40']
    """
    if not name.strip() or not name.isprintable():
        raise BadInput(f"the material's name is {name!r}: give one of letters in one line")
    ka, kd, lobe = ambient(material), diffuse(material), highlight(material)
    numbers: Any = kd
    peak: Any = None if lobe is None else lobe.ks
    exponent: Any = None if lobe is None else lobe.exponent
    nearest: Any = () if lobe is None else BlinnPhong(peak, exponent)
    error = angular_error(Exact(material), Exact(Material(kd=numbers, specular=nearest)))
    notes = _notes(material, lobe)
    absent = [key for key, value in (("Ka", ka), ("Kd", kd), ("Ks", lobe)) if value is None]
    comments = [*notes, *error.lines()]
    if absent:
        comments.append(f"no {' and no '.join(absent)}: 0 stands for what there is not")
    lines = [
        *(f"# {comment}" for comment in comments),
        f"newmtl {name.strip()}",
        _colour("Ka", ka),
        _colour("Kd", kd),
        _colour("Ks", None if lobe is None else lobe.ks),
        *([] if lobe is None else [f"Ns {lobe.exponent:.7g}"]),
        f"illum {1 if lobe is None else 2}",
    ]
    return Export(HEAD + "\n".join(lines) + "\n", error, notes)


def write_mtl(
    path: str | os.PathLike[str], materials: Material | Mapping[str, Material]
) -> dict[str, Export]:
    """Write one material, or several by name, as a library; atomic. Returns what became of each.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     list(write_mtl(f"{folder}/a.mtl", {"red": Material(kd=(0.5, 0.1, 0.1))}))
    ['red']
    """
    named = {"material": materials} if isinstance(materials, Material) else dict(materials)
    if not named:
        raise BadInput(f"{path}: there is no material to write; give at least one")
    found = {name: as_mtl(material, name) for name, material in named.items()}
    with replacing(path) as temporary:
        own = "\n".join(export.text.removeprefix(HEAD) for export in found.values())
        temporary.write_text(HEAD + own, encoding="utf-8")
    return found


def _notes(material: Material, lobe: Highlight | None) -> tuple[str, ...]:
    if lobe is None:
        return ()
    notes = lobe.notes
    if len(material.specular) > 1 and any(isinstance(own, Phong) for own in material.specular):
        notes += ("an exponent n of (r.v)^n became 4 n of (N.H)^Ns before lobes were put together",)
    for own in material.specular:
        if isinstance(own, Phong) and len(material.specular) == 1:
            exponent, _ = one("the exponent", own.shininess)
            notes += (
                f"The lobe is Phong's, Ks (r.v)^{exponent:.6g}; illum 2 has (N.H)^Ns: Ns is 4 times the"
                " exponent",
            )
        elif isinstance(own, AbstractMicrofacet):
            notes += (f"the lobe has facets, {own.kind}, of which this is the nearest (N.H)^Ns",)
    if material.body is not None:
        notes += ("Kd is that of the body seen head-on, which is darker at the rim",)
    return tuple(dict.fromkeys(notes))


def _colour(key: str, value: RGB | None) -> str:
    numbers = (0.0, 0.0, 0.0) if value is None else value
    return " ".join([key, *(f"{x:.7g}" for x in numbers)])
