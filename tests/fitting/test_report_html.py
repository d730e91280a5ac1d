"""The page: well-formed, complete in itself, and never other than the document says."""

import base64
import copy
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from diffshade.io import png
from diffshade.io.encoding import Encoding
from fitting.report_html import fit_page
from fitting.report_html_images import ImagePanels, Pictures
from fitting.report_plot import curve_plot, linear_ticks, log_ticks

VOID = {"meta", "img", "br", "hr", "input", "link"}
DOCUMENT = {
    "schema": "diffshade.fit/1",
    "model": "phong",
    "coefficients": {
        "ka": None,
        "kd": [0.51, 0.31, 0.11],
        "lobes": [{"kind": "phong", "ks": [0.41, 0.42, 0.43], "shininess": 60.0}],
        "body": None,
        "attenuation": None,
    },
    "standard_errors": {
        "ka": None,
        "kd": [0.001, 0.002, 0.003],
        "lobes": [{"kind": "phong", "ks": [None, None, None], "shininess": 2.5}],
        "body": None,
        "attenuation": None,
    },
    "unidentified": [{"coefficients": ["kd"], "reason": "kd shares a scale: hold one"}],
    "held": ["specular.0.ks"],
    "noise": 0.0123,
    "relative_residual": 0.0345,
    "fraction_excluded": 0.015,
    "per_image": [
        {
            "file": f"{k}.png",
            "relative_residual": residual,
            "pixels_used": 1000 + k,
            "pixels_clipped": 70 + k,
            "pixels_unusable": k,
        }
        for k, residual in enumerate((0.02, 0.06, 0.03))
    ],
    "converged": True,
    "seconds": {"load": 0.25, "fit": 1.5},
    "notes": ["images read as linear"],
}
PAIRS = [[0.506, 0.514], [0.306, 0.314], [0.104, 0.116]]
OPTIONAL = {
    "intervals": {
        "ka": None,
        "kd": PAIRS,
        "lobes": [{"kind": "phong", "ks": [[None, None]] * 3, "shininess": [51.5, 69.5]}],
        "body": None,
        "attenuation": None,
    },
    "correlations": {"names": ["kd", "n"], "matrix": [[1.0, -0.37], [-0.37, 1.0]]},
    "basins": [
        {"coefficients": {"kd": 0.77, "lobes": [{"shininess": 7.5}]}, "relative_residual": 0.0346}
    ],
    "certificate": {"proven": True, "tolerance": 1e-3, "shininess": [0.1, 1e5], "reason": "Bound."},
    "profile": [
        {
            "names": ["specular.0.shininess"],
            "values": [1.0, 10.0, 60.0, 1000.0],
            "relative_residual": [0.3, 0.2, 0.1, 0.4],
        }
    ],
    "weighted_residual": 0.0111,
    "suspect_images": [{"file": "1.png", "reason": "six times the others"}],
    "gains": [1.0, 0.987, [1.0, 1.1, 1.2]],
}


class Page(HTMLParser):
    """Tags, attributes and texts of a page; fails where a tag is not closed in its turn."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.sections: dict[str, str] = {}
        self.heads: list[tuple[str, str]] = []
        self.words = ""
        self.section = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert len(dict(attrs)) == len(attrs)
        self.tags.append((tag, dict(attrs)))
        if tag == "section":
            self.section = dict(attrs)["id"] or ""
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        if tag == "section":
            self.section = ""

    def handle_data(self, data: str) -> None:
        if "style" in self.open:
            return
        self.words += data
        self.sections[self.section] = self.sections.get(self.section, "") + data
        if re.fullmatch("h[1-6]", self.open[-1] if self.open else ""):
            self.heads.append((self.open[-1], data))

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def document(**changes: object) -> dict:
    return {**copy.deepcopy(DOCUMENT), **copy.deepcopy(changes)}


def a_png(level: int) -> bytes:
    return png.write(np.full((2, 3, 3), level, np.uint8), Encoding.DISPLAY)


def pictures(count: int = 3) -> Pictures:
    panels = tuple(ImagePanels(*(a_png(50 * k + j) for j in range(4))) for k in range(count))
    reasons = {"used": "#d1d1d1", "clipped": "#e69900"}
    return Pictures(panels, 2.5, 0.004, ("#05308c", "#f7f7f7", "#850817"), reasons)


def page(made: dict, shown: Pictures | None = None, title: str = "A fit of ball") -> Page:
    return Page(fit_page(made, shown, title=title))


# Structure


def test_the_structure_of_a_small_page() -> None:
    made = page(document(), pictures())
    assert made.heads == [
        ("h1", "A fit of ball"),
        ("h2", "Coefficients"),
        ("h3", "Not identified, and what to do"),
        ("h2", "Residual of each image"),
        ("h2", "Pictures"),
        ("h2", "How it was measured"),
        ("h2", "Notes"),
    ]
    assert [made.all(tag) for tag in ("main", "html", "script", "svg")] == [
        [{}],
        [{"lang": "en"}],
        [],
        [],
    ]
    assert [len(made.all(tag)) for tag in ("table", "caption", "figure", "img")] == [2, 2, 3, 12]
    # Each row of each table begins with a heading that says of what it is one.
    assert {th.get("scope") for th in made.all("th")} == {"col", "row", "rowgroup"}


def test_it_needs_nothing_else() -> None:
    made = page(document(**OPTIONAL), pictures())
    refers = [v for _, a in made.tags for k, v in a.items() if k in ("src", "href", "xlink:href")]
    assert all(v is not None and v.startswith(("#", "data:image/png;base64,")) for v in refers)
    assert not {"script", "link", "iframe", "object", "base"} & {tag for tag, _ in made.tags}
    text = fit_page(document(**OPTIONAL), pictures(), title="t")
    assert not re.search(r"https?:|//|url\(|@import|\son\w+=", re.sub('base64,[^"]*', "", text))
    targets = {a["id"] for _, a in made.tags if "id" in a}
    assert {v[1:] for v in refers if v and v[0] == "#"} <= targets
    assert len(targets) == sum("id" in a for _, a in made.tags)


def test_light_dark_and_print() -> None:
    text = fit_page(document(), title="t")
    assert '<meta name="color-scheme" content="light dark">' in text
    assert "prefers-color-scheme: dark" in text
    assert "@media print" in text


def test_pictures_are_embedded_in_their_order_and_have_words() -> None:
    made = page(document(), pictures())
    images = made.all("img")
    data = [base64.b64decode((image["src"] or "").partition(",")[2]) for image in images]
    assert data == [a_png(50 * k + j) for k in range(3) for j in range(4)]
    alts = [image["alt"] or "" for image in images]
    assert len(set(alts)) == 12
    assert all(f"{k // 4}.png" in alt for k, alt in enumerate(alts))
    assert alts[7] == "Pixels of 1.png left out: 71 clipped, 1 not finite or not opaque"
    assert "linear × 2.5" in made.sections["pictures"]
    assert "−0.004" in made.sections["pictures"]


def test_as_many_pictures_as_images() -> None:
    with pytest.raises(ValueError, match="zip"):
        fit_page(document(), pictures(2), title="t")


# What it says


def test_the_numbers_are_those_of_the_document() -> None:
    made = page(document())
    for said in ("phong: I = Σ Ip (kd n·l + ks (r·v)^n)", "3,003 pixels used", "1.5 % of the obj"):
        assert said in made.words
    for said in ("213 clipped", "3 not finite", "0.0345", "0.0123", "load 0.25 s, fit 1.5 s"):
        assert said in made.sections[""]
    found = made.sections["coefficients"]
    for said in ("0.5100", "± 0.0010", "60.0", "± 2.5", "kd shares a scale: hold one"):
        assert said in found
    assert found.count("held") == 3  # ks, of each channel
    assert found.count("not identified") == 3  # kd
    assert "Not identified: kd" in made.sections[""]
    assert "Worst: 1.png, 0.06, 2 times the median" in made.sections["residual"]
    assert "images read as linear" in made.sections["notes"]


def test_bars_are_as_long_as_the_residuals_and_the_worst_is_marked() -> None:
    made = page(document())
    widths = [a["style"] for a in made.all("span") if (a.get("style") or "").startswith("width")]
    assert widths == ["width: 33.3%", "width: 100.0%", "width: 50.0%"]
    assert [a.get("class") for a in made.all("tr")].count("worst") == 1


@pytest.mark.parametrize(
    ("key", "section", "says"),
    [
        ("intervals", "coefficients", ["0.5060 to 0.5140", "51.5 to 69.5"]),
        ("correlations", "correlations", ["−0.37"]),
        ("basins", "minimum", ["0.0346", "kd 0.77", "lobes.0.shininess 7.5"]),
        ("certificate", "minimum", ["Proven", "0.1 to 100,000", "0.001", "Bound."]),
        ("profile", "minimum", ["Dashed: the recovered value, 60.", "1,000"]),
        ("weighted_residual", "", ["0.0111"]),
        ("suspect_images", "residual", ["1.png disagrees with the others: six times"]),
        ("gains", "residual", ["0.987", "1, 1.1, 1.2"]),
    ],
)
def test_an_optional_part_is_there_when_the_document_has_it(key, section, says) -> None:
    made = page(document(**{key: OPTIONAL[key]}), pictures())
    assert all(text in made.sections[section] for text in says)
    for absent in ({}, {key: None}):
        without = page(document(**absent), pictures())
        assert not any(text in without.sections.get(section, "") for text in says[:1])
    everything = page(document(**OPTIONAL))
    assert all(text in everything.sections[section] for text in says)


def test_what_there_is_to_heed() -> None:
    certificate = {**OPTIONAL["certificate"], "proven": False, "reason": "Two nodes are too far."}
    made = page(document(**{**OPTIONAL, "converged": False, "certificate": certificate}))
    for said in ("did not converge", "not proven", "Another minimum", "disagree with the others"):
        assert said in made.sections[""]
    assert "is not proven. Two nodes are too far." in made.sections["minimum"]
    calm = page(document(unidentified=[], basins=[]))
    assert "heed" not in [a.get("class") for a in calm.all("div")]
    assert "No other minimum came within the noise" in calm.sections["minimum"]


def test_a_fitted_attenuation_and_a_truth() -> None:
    law = {"kind": "quadratic", "c0": 1.0, "c1": 0.0, "c2": 0.25, "reference_distance": 2.0}
    law |= {"l0": 0.5, "l1": 0.0, "l2": 0.5, "kd": [0.2, 0.1, 0.05], "ks": [[0.2] * 3]}
    made = document()
    made["coefficients"]["attenuation"] = law
    made["standard_errors"]["attenuation"] = {
        **dict.fromkeys(law, 0.01),
        "c0": 1e-19,
        "kd": [0.01] * 3,
        "ks": [[0.01] * 3],
    }
    made["truth"] = {"kd": [0.5, 0.3, 0.1], "ks": [0.4] * 3, "shininess": 61.25}
    made["truth"]["attenuation"] = {"c0": 1.0, "c1": 0.0, "c2": 0.26}
    shown = page(made)
    found = shown.sections["coefficients"]
    for said in ("d0 = 2:", "kd f(d0)", "by convention", "61.25", "0.26"):
        assert said in found
    assert "f(d) Ip" in shown.sections[""]
    # kd has no scale of its own; kd f(d0), which was measured, is not doubted.
    assert found.count("not identified") == 3


def test_what_is_not_finite_is_said() -> None:
    made = document(relative_residual=None, noise=None)
    made["coefficients"]["kd"][0] = made["per_image"][1]["relative_residual"] = None
    profile = {
        "names": ["specular.0.shininess"],
        "values": [1.0, 2.0, 3.0],
        "relative_residual": [None, None, 0.1],
    }
    made |= {"correlations": {"names": ["a", "b"], "matrix": [[1, None], [None, 1]]}}
    made |= {"profile": [profile]}
    shown = page(made)
    assert shown.words.count("not finite") >= 4
    assert shown.all("svg") == []


def test_correlations_of_many_coefficients_are_the_strongest() -> None:
    names = [f"k{j}" for j in range(40)]
    matrix = np.eye(40)
    matrix[7, 3] = matrix[3, 7] = -0.875
    made = page(document(correlations={"names": names, "matrix": matrix.tolist()}))
    assert "k3 and k7: -0.875" in made.sections["correlations"]
    assert "k39 and" not in made.sections["correlations"]


# Escaping


HOSTILE = """<script>alert('1')</script>"&amp;' onload=x ]]>--><b>"""


def test_what_comes_from_outside_stays_text() -> None:
    made = document(notes=[HOSTILE], suspect_images=[{"file": HOSTILE, "reason": HOSTILE}])
    made["per_image"][1]["file"] = made["model"] = HOSTILE
    made["unidentified"] = [{"coefficients": [HOSTILE], "reason": HOSTILE}]
    made["correlations"] = {"names": [HOSTILE, "b"], "matrix": [[1, 0.5], [0.5, 1]]}
    made["basins"] = [{"coefficients": {HOSTILE: 1.0}, "relative_residual": 0.1}]
    made["certificate"] = {"proven": False, "tolerance": None, "shininess": None, "reason": HOSTILE}
    harmless = json.loads(json.dumps(made).replace(json.dumps(HOSTILE)[1:-1], "x"))
    hostile, plain = page(made, pictures(), HOSTILE), page(harmless, pictures(), "x")
    assert [tag for tag, _ in hostile.tags] == [tag for tag, _ in plain.tags]
    assert [a.keys() for _, a in hostile.tags] == [a.keys() for _, a in plain.tags]
    assert hostile.heads[0] == ("h1", HOSTILE)
    assert hostile.words.count(HOSTILE) >= 10
    assert any(image["alt"] == f"{HOSTILE} as photographed" for image in hostile.all("img"))


# The plot


@pytest.mark.parametrize(
    ("low", "high"), [(0.1, 1e5), (1, 1e4), (40, 90), (59.9, 60.1), (0.001, 0.0021)]
)
@pytest.mark.parametrize("ticks", [linear_ticks, log_ticks])
def test_ticks_are_few_round_and_inside(ticks, low: float, high: float) -> None:
    found = ticks(low, high)
    assert 3 <= len(found) <= 12
    assert found == sorted(set(found))
    assert low <= found[0] < found[-1] <= high
    assert all(len(f"{tick:g}") <= 6 for tick in found)


def test_the_curve_the_interval_and_the_value() -> None:
    x, y = [100.0, 1.0, 10.0, 1000.0], [0.1, 0.3, 0.2, 0.3]
    plot = curve_plot(
        x, y, x_label="n", y_label="r", title="over n", value=100.0, interval=(10.0, None)
    )
    assert plot is not None
    line = plot.find("polyline[@class='curve']")
    value = plot.find("line[@class='value']")
    band = plot.find("rect[@class='interval']")
    assert line is not None
    assert value is not None
    assert band is not None
    points = [tuple(map(float, p.split(","))) for p in line.get("points", "").split()]
    across, up = zip(*points, strict=True)
    np.testing.assert_allclose(np.diff(across), across[1] - across[0], atol=0.2)  # decades
    assert up[0] == up[3] < up[1] < up[2]  # down the page
    assert float(value.get("x1", "")) == across[2]
    assert float(band.get("x", "")) == across[1]
    assert float(band.get("x", "")) + float(band.get("width", "")) == pytest.approx(across[3])
    assert plot.findtext("title") == plot.get("aria-label") == "over n"


def test_gaps_narrow_intervals_and_what_lies_outside() -> None:
    x, y = [1.0, 2.0, 4.0, 8.0, 16.0], [0.3, 0.2, None, 0.1, 0.2]
    words = {"x_label": "n", "y_label": "r", "title": "t"}
    narrow = curve_plot(x, y, value=100.0, interval=(7.9999, 8.0001), **words)
    assert narrow is not None
    assert len(narrow.findall("polyline")) == 2
    assert narrow.find("line[@class='value']") is None
    band = narrow.find("rect[@class='interval']")
    assert band is not None
    assert float(band.get("width", "")) == 2
    outside = curve_plot(x, y, interval=(20.0, 30.0), **words)
    assert outside is not None
    assert outside.find("rect") is None
    assert curve_plot([1.0, 2.0], [None, 0.1], **words) is None
    steep = curve_plot([1.0, 2.0, 3.0], [1e-6, 1e-3, 1.0], **words)
    assert steep is not None
    assert "0.001" in [text.text for text in steep.findall("text")]
