"""The tables of a material, as `scene.toml` and a fit's JSON have them: lobes, boundaries, a body.

    { kind = "phong", ks = 0.5, shininess = 32 }                 # or "blinn_phong"
    { kind = "ggx", ks = 1.0, alpha = 0.1, masking = "separable",
      fresnel = { kind = "dielectric", index = 1.5 } }
    { kind = "fresnel", index = 1.5 }                            # a body
    { kind = "filtered", kt = 0.8, colour = [1, 0.6, 0.3] }      # a transparency

Beside "ggx" are "beckmann", with an optional `rational`, and "torrance_sparrow"; beside "dielectric" are
"conductor", of `index` and `extinction`, and "schlick", of `f0`. `masking` and `fresnel` are optional,
as is the `weight` of the others, a table like `fresnel`. Beside "filtered", with an optional `colour`, is
"interpolated", of `kt`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from diffshade.io.toml_document import Table

if TYPE_CHECKING:
    from diffshade.reflectance.body import FresnelBody
    from diffshade.reflectance.fresnel import AbstractFresnel
    from diffshade.reflectance.lobe import AbstractLobe
    from diffshade.reflectance.transparency import AbstractTransparency

__all__ = ["per_channel_keys", "read_body", "read_lobe", "read_transparency"]


def read_lobe(table: Table) -> AbstractLobe:
    """A lobe, by its `kind`."""
    from diffshade.reflectance.blinn_phong import BlinnPhong
    from diffshade.reflectance.microfacet import GGX, MASKINGS, Beckmann, TorranceSparrow
    from diffshade.reflectance.phong import Phong

    powers = {kind.kind: kind for kind in (Phong, BlinnPhong)}
    facets = {kind.kind: kind for kind in (GGX, Beckmann, TorranceSparrow)}
    kind = table.choice("kind", (*powers, *facets))
    if kind in powers:
        table.expect(("kind", "ks", "shininess"), ("weight",))
        weight = _fresnel(table.table("weight")) if "weight" in table else None
        with table.naming():
            return powers[kind](table.per_channel("ks"), table.per_channel("shininess"), weight)
    more = ("rational",) if kind == Beckmann.kind else ()
    table.expect(("kind", "ks", "alpha"), ("fresnel", "masking", *more))
    given: dict[str, Any] = {}
    if "masking" in table:
        given["masking"] = table.choice("masking", MASKINGS)
    if "rational" in table:
        given["rational"] = table.truth("rational")
    fresnel = _fresnel(table.table("fresnel")) if "fresnel" in table else None
    ks, alpha = table.per_channel("ks"), table.per_channel("alpha", above=0.0)
    with table.naming():
        return facets[kind](ks, alpha, fresnel, **given)


def read_body(table: Table) -> FresnelBody:
    """A body, of which there is one kind."""
    from diffshade.reflectance.body import FresnelBody

    table.choice("kind", (FresnelBody.kind,))
    table.expect(("kind", "index"))
    with table.naming():
        return FresnelBody(table.per_channel("index", above=0.0))


def read_transparency(table: Table) -> AbstractTransparency:
    """A transparency, by its `kind`."""
    from diffshade.reflectance.transparency import FilteredTransparency, InterpolatedTransparency

    kind = table.choice("kind", ("interpolated", "filtered"))
    colour = ("colour",) if kind == "filtered" else ()
    table.expect(("kind", "kt"), colour)
    given = {key: table.per_channel(key) for key in ("kt", *colour) if key in table}
    with table.naming():
        if kind == "interpolated":
            return InterpolatedTransparency(**given)
        return FilteredTransparency(**given)


def per_channel_keys(part: Table) -> list[tuple[Table, str]]:
    """What of a lobe, a body or a transparency may have one number a channel, and where it stands."""
    keys = ("ks", "shininess", "alpha", "index", "extinction", "f0", "kt", "colour")
    found = [(part, key) for key in keys if key in part]
    for key in ("fresnel", "weight"):
        if key in part:
            found += per_channel_keys(part.table(key))
    return found


def _fresnel(table: Table) -> AbstractFresnel:
    from diffshade.reflectance.fresnel import Conductor, Dielectric, Schlick

    match table.choice("kind", ("dielectric", "conductor", "schlick")):
        case "dielectric":
            table.expect(("kind", "index"))
            with table.naming():
                return Dielectric(table.per_channel("index", above=0.0))
        case "conductor":
            table.expect(("kind", "index", "extinction"))
            index = table.per_channel("index", above=0.0)
            with table.naming():
                return Conductor(index, table.per_channel("extinction"))
        case _:
            table.expect(("kind", "f0"))
            with table.naming():
                return Schlick(table.per_channel("f0"))
