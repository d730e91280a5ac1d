"""A fit for people to read: one HTML page that needs nothing else, neither files nor scripts.

Every number comes from the "diffshade.fit/1" document; the pictures are given beside it. A part of
the document that is absent has no section. Light or dark as the reader's system is, and for print.
"""

from collections.abc import Iterable, Iterator, Mapping
from importlib.resources import files
from typing import Any
from xml.etree.ElementTree import Element

from fitting.report_html_coefficients import (
    coefficients_section,
    correlations_section,
    minimum_section,
)
from fitting.report_html_images import Pictures, pictures_section, reasons, residuals_section
from fitting.report_html_lights import lights_section
from fitting.report_markup import document_text, element, listing, number, optional
from fitting.report_rows import comparison

__all__ = ["fit_page"]

Document = Mapping[str, Any]


def fit_page(document: Document, pictures: Pictures | None = None, *, title: str) -> str:
    """A "diffshade.fit/1" document as the text of an HTML file.

    `title` says what was fitted. `pictures` are those of the images in `per_image`, in that order;
    without them the page has none. Raises `ValueError` where their numbers differ.

    >>> empty = {"ka": None, "kd": [0.6], "lobes": [], "body": None, "attenuation": None}
    >>> errors = {**empty, "kd": [0.01]}
    >>> row = {"file": "a.png", "relative_residual": 0.02, "pixels_used": 9, "pixels_clipped": 0}
    >>> page = fit_page(
    ...     {"schema": "diffshade.fit/1", "model": "lambert", "coefficients": empty, "held": [],
    ...      "standard_errors": errors, "unidentified": [], "noise": 0.01, "converged": True,
    ...      "relative_residual": 0.02, "fraction_excluded": 0.0, "per_image": [row], "notes": [],
    ...      "seconds": {"load": 0.1, "fit": 0.2}}, title="a < b")
    >>> "<h1>a &lt; b</h1>" in page
    True
    """
    sections = [
        ("coefficients", "Coefficients", coefficients_section(document)),
        ("minimum", "Is it the best fit?", minimum_section(document)),
        ("correlations", "Correlations", correlations_section(document.get("correlations"))),
        (
            "residual",
            "Residual of each image",
            residuals_section(document, linked=pictures is not None),
        ),
        ("lights", "Lights", lights_section(document.get("lights"))),
        ("pictures", "Pictures", [] if pictures is None else pictures_section(document, pictures)),
        ("measured", "How it was measured", _measured(document)),
        ("notes", "Notes", listing(document["notes"])),
    ]
    present = [section for section in sections if section[2]]
    body = element(
        "body",
        element("header", element("h1", title), *_overview(document), _contents(present)),
        element(
            "main",
            *(
                element("section", element("h2", heading), *parts, id=name)
                for name, heading, parts in present
            ),
        ),
    )
    return f"<!DOCTYPE html>\n{document_text(element('html', _head(title), body, lang='en'))}\n"


def _head(title: str) -> Element:
    # Nothing may be loaded: what the page shows, it holds.
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    style = files("fitting").joinpath("report_page.css").read_text(encoding="utf-8")
    return element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=policy),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("title", title),
        element("style", style),
    )


def _contents(sections: Iterable[tuple[str, str, Any]]) -> Element:
    links = [element("a", heading, href=f"#{name}") for name, heading, _ in sections]
    return element("nav", *listing(links), aria_label="Contents")


# What was fitted, and what to heed


def _overview(document: Document) -> list[Element]:
    rows = document["per_image"]
    counts = [f"{sum(row[key] for row in rows):,} {why}" for key, why in reasons(document)]
    facts: dict[str, str | None] = {
        "Model": f"{document['model']}: {_equation(document)}",
        "Compared": comparison(document) or None,
        "Images": f"{len(rows)}, with {sum(row['pixels_used'] for row in rows):,} pixels used",
        "Left out": (
            f"{100 * document['fraction_excluded']:.3g} % of the object's pixels"
            f" ({', '.join(counts)})"
        ),
        "Relative residual": number(document["relative_residual"]),
        "Weighted residual": optional(document.get("weighted_residual")),
        "Noise": f"{number(document['noise'])}, the standard deviation of the residual",
        "Time": ", ".join(
            f"{name} {seconds:.3g} s" for name, seconds in document["seconds"].items()
        )
        or None,
    }
    pairs = [
        part
        for name, text in facts.items()
        if text is not None
        for part in (element("dt", name), element("dd", text))
    ]
    heed = listing(_warnings(document))
    return [
        element("dl", *pairs),
        *([element("div", *heed, class_="heed")] if heed else []),
    ]


def _equation(document: Document) -> str:
    """The model's formula, of the terms that it has."""
    values = document["coefficients"]
    cosines = {"phong": "(r·v)", "blinn_phong": "(n·h)"}
    several = len(values["lobes"]) > 1
    passed = " T(n·l) T(n·v)" if values.get("body") else ""
    terms = [f"kd n·l{passed}"] if values["kd"] is not None else []
    for j, lobe in enumerate(values["lobes"], 1):
        index = f"{j}" if several else ""
        weight = " W(n·l)" if lobe.get("weight") else ""
        boundary = " F" if lobe.get("fresnel") else ""
        shape = f"D{index}{boundary} G{index} / (4 n·v)"
        if lobe["kind"] in cosines:
            shape = f"{cosines[lobe['kind']]}^n{index}"
        terms.append(f"ks{index}{weight} {shape}")
    ambient = "ka Ia + " if values["ka"] is not None else ""
    attenuation = "f(d) " if values["attenuation"] is not None else ""
    return f"I = {ambient}Σ {attenuation}Ip ({' + '.join(terms)}), over the lights"


def _warnings(document: Document) -> Iterator[str | Element]:
    if not document["converged"]:
        yield "The search did not converge: these numbers are not a minimum."
    names = dict.fromkeys(n for item in document["unidentified"] for n in item["coefficients"])
    if names:
        link = element("a", "the reasons", href="#unidentified")
        yield element("span", f"Not identified: {', '.join(names)}; see ", link, ".")
    if document.get("basins"):
        yield "Another minimum fits the images as well, within the noise."
    certificate = document.get("certificate")
    if certificate is not None and not certificate["proven"]:
        yield "It is not proven that no other minimum is better."
    suspects = [row["file"] for row in document.get("suspect_images") or []]
    if suspects:
        yield f"Images that disagree with the others: {', '.join(suspects)}."
    lights = (document.get("lights") or {}).get("per_image", ())
    moved = [row["file"] for row in lights if row["moved"] is not None]
    if moved:
        yield f"Images whose lamp has moved: {', '.join(moved)}."


# How it was measured


def _measured(document: Document) -> list[Element]:
    says = [
        "Relative residual: the norm of observed − predicted over the norm of observed, unweighted,"
        " over all used pixels and all channels, in linear light.",
        "Left out: pixels that are clipped (any channel at or above 0.98 of full scale as encoded),"
        " not finite or not opaque, in all their channels.",
        "Standard errors: those of independent noise as large as the residual, or those by which"
        " four images or more disagree, where that is more. What the model leaves out of all images"
        " alike comes on top of them.",
        "Not identified: the images do not tell the coefficient to 10 % of its size, for noise of a"
        " thousandth of their maximum or as large as was found.",
    ]
    if document.get("intervals") is not None:
        says.append("95 % intervals: in 95 of 100 such fits they hold the true value.")
    if document.get("weighted_residual") is not None:
        says.append(
            "Weighted residual: the relative residual with the weights of the robust fit, which"
            " gives little or none to pixels that disagree."
        )
    if document.get("gains") is not None:
        says.append("Gain: by what each image's light is multiplied, as fitted.")
    return listing(says)
