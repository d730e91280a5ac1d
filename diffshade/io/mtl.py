"""Wavefront material libraries (`.mtl`), for what the illumination equation has of them.

Not by `trimesh`, which passes over a colour that it cannot read, and rounds colours to 8 bits on
their way into its materials.
"""

from pathlib import Path
from typing import Any, NamedTuple

from diffshade.errors import BadInput
from diffshade.io.contents import read_bytes

__all__ = ["Colour", "Mtl", "read_mtl"]

Colour = tuple[float, float, float]


class Mtl(NamedTuple):
    """One material as its file has it; None is what the file does not say."""

    ka: Colour | None = None
    kd: Colour | None = None
    ks: Colour | None = None
    ns: float | None = None
    illum: int | None = None
    maps: tuple[str, ...] = ()
    """The statements that name textures."""


def read_mtl(path: Path) -> dict[str, Mtl]:
    """The materials of a library, by name.

    Statements other than `Ka`, `Kd`, `Ks`, `Ns` and `illum` are passed over; those that name
    textures are listed. Raises `BadInput`, with the line, for one of the five that is no number.
    """
    text = read_bytes(path).decode("utf-8-sig", errors="replace")
    materials: dict[str, Mtl] = {}
    name = None
    for number, line in enumerate(text.splitlines(), 1):
        key, _, rest = line.strip().replace("\t", " ").partition(" ")
        key, rest = key.lower(), rest.strip()
        if key == "newmtl":
            name = rest
            materials[name] = Mtl()
        elif name is not None:
            said = _statement(key, rest, materials[name], f"{path}, line {number}")
            materials[name] = materials[name]._replace(**said)
    return materials


def _statement(key: str, rest: str, material: Mtl, where: str) -> dict[str, Any]:
    if key in ("ka", "kd", "ks"):
        return {key: _colour(rest.split(), where)}
    if key == "ns":
        return {key: _number(rest, where)}
    if key == "illum":
        return {key: int(_number(rest, where))}
    if key.startswith("map_") or key in ("bump", "disp", "decal", "refl", "norm"):
        return {"maps": (*material.maps, key)}
    return {}


def _colour(words: list[str], where: str) -> Colour:
    if words and words[0].lower() in ("spectral", "xyz"):
        raise BadInput(f"{where}: a colour given as {words[0]!r}; give red, green and blue")
    if len(words) not in (1, 3):
        raise BadInput(f"{where}: {len(words)} numbers for a colour; give red, green and blue")
    values = [_number(word, where) for word in words]
    return (values[0], values[0], values[0]) if len(values) == 1 else tuple(values)  # type: ignore[return-value]


def _number(word: str, where: str) -> float:
    try:
        value = float(word)
    except ValueError:
        raise BadInput(f"{where}: {word!r} is no number; correct the line") from None
    if not 0 <= value < float("inf"):
        raise BadInput(f"{where}: {word!r}; give a finite number that is not negative")
    return value
