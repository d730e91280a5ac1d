"""From the `.mtl` libraries of an OBJ file to materials."""

import os
from pathlib import Path, PureWindowsPath
from typing import Any

from diffshade.arrays import floats
from diffshade.errors import naming
from diffshade.io.contents import within
from diffshade.io.mtl import Colour, Mtl, read_mtl
from diffshade.io.obj import Obj
from diffshade.reflectance.blinn_phong import BlinnPhong
from diffshade.reflectance.material import Material

__all__ = ["read_materials"]


def read_materials(
    path: Path, file: Obj, *, allow_outside: bool
) -> tuple[tuple[Material, ...], tuple[str, ...]]:
    """The materials that an OBJ file's faces name, in order, all of them or none; and notes on what
    is not there.

    `Ka`, `Kd` and `Ks` are ka, kd and ks, `Ns` is the exponent of a halfway-vector lobe (Blinn),
    the form of `illum 2`. `illum 1` has no lobe, `illum 0` no ambient term either, and one that the
    file leaves out has what is given. The effects of higher numbers (mirrors, glass) are not
    modelled: they count as 2. All materials have one form: where one lacks a term that another
    has, its coefficient is 0. `Ns` is 1 where it is missing.

    Raises `BadInput` for a library that cannot be read as one, or lies outside the file's folder.
    """
    known: dict[str | None, Mtl] = {}
    absent = []
    for names in file.libraries:
        found = _beside(path.parent, names, allow_outside)
        for library in found:
            known.update(read_mtl(library))
        if not found:
            absent.append(names)
    for name in file.materials:
        if name not in known:
            what = "faces before the first usemtl have no material"
            if name is not None:
                where = (
                    f"{', '.join(absent)}, which is absent" if absent else "the file's libraries"
                )
                what = f"material {name!r} was not found in {where}"
            return (), (f"{what}; the mesh has no materials of its own",)
    used = [known[name] for name in file.materials]
    notes: tuple[str, ...] = ()
    if textures := sorted({key for material in used for key in material.maps}):
        notes = (f"textures are not read ({', '.join(textures)}): every material has one colour",)
    with naming(path):
        return _of_one_form(used), notes


def _beside(folder: Path, names: str, allow_outside: bool) -> list[Path]:
    """The files of one `mtllib` line, which names one, perhaps with spaces, or several; or none."""
    for split in ([names], names.split()):
        found = []
        for name in split:
            # beside the OBJ file too where the name has a folder of the machine that wrote it
            candidates = (name, PureWindowsPath(name).name)
            # unlike Path's, this test does not raise where a name is too long
            found += [c for c in candidates if os.path.isfile(folder / c)][:1]
        if split and len(found) == len(split):
            return [within(folder, name, allow_outside=allow_outside) for name in found]
    return []


def _of_one_form(used: list[Mtl]) -> tuple[Material, ...]:
    ambient = [None if material.illum == 0 else material.ka for material in used]
    diffuse = [material.kd for material in used]
    specular = [
        material.ks if material.illum is None or material.illum >= 2 else None for material in used
    ]
    exponents = [1.0 if material.ns is None else material.ns for material in used]
    rows = zip(_or_black(ambient), _or_black(diffuse), _or_black(specular), exponents, strict=True)
    return tuple(Material(ka=ka, kd=kd, specular=_lobe(ks, ns)) for ka, kd, ks, ns in rows)


def _or_black(colours: list[Colour | None]) -> list[Any]:
    """The colours, black for those that are missing; None for all where all are."""
    absent = (0.0, 0.0, 0.0) if any(colours) else None
    return [absent if colour is None else colour for colour in colours]


def _lobe(ks: Any, ns: float) -> Any:
    return None if ks is None else BlinnPhong(ks, floats("Ns")(ns))
