"""`diffshade export`: a fitted material in the format of another tool."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from diffshade.commands.console import WrongUsage, show
from diffshade.commands.fit_file import fit_file
from diffshade.errors import naming
from diffshade.io.json_document import read_json
from diffshade.progress import bar

if TYPE_CHECKING:
    from diffshade.export.document import Export
    from diffshade.reflectance.material import Material

__all__ = ["export"]

SCHEMA = "diffshade.export/1"


def export(fit_json: Path, *, to: str, out: Path, irradiance: float | None, as_json: bool) -> int:
    """Write a material and print its error over angles; returns the exit status."""
    if to == "mtl" and irradiance is not None:
        raise WrongUsage("--irradiance: an .mtl has k_d and k_s as they are; leave it out")
    from diffshade.export.document import write
    from fitting.report import material_from_json

    fit_json = fit_file(fit_json)
    material, attenuation = material_from_json(read_json(fit_json, "a fit.json"))
    with naming(fit_json), bar("measuring over angles"):
        found = _made(material, to, out.stem, math.pi if irradiance is None else irradiance)
    write(out, found)
    notes = list(found.notes)
    if attenuation is not None:
        notes.append("the attenuation is left out: it belongs to the lights, not to the material")
    document = {
        "schema": SCHEMA,
        "format": to,
        "file": str(out),
        "error": {key: list(value) for key, value in found.error._asdict().items()},
        "notes": notes,
    }
    show(document, "\n".join([f"written: {out}", *notes, *found.error.lines()]), as_json=as_json)
    return 0


def _made(material: Material, to: str, name: str, irradiance: float) -> Export:
    if to == "mtl":
        from diffshade.export.mtl import as_mtl

        return as_mtl(material, name)
    if to == "gltf":
        from diffshade.export.gltf import as_gltf

        return as_gltf(material, name, irradiance=irradiance)
    if to == "threejs":
        from diffshade.export.threejs import as_threejs

        return as_threejs(material, name, irradiance=irradiance)
    from diffshade.export.mitsuba import as_mitsuba

    return as_mitsuba(material, irradiance=irradiance)
