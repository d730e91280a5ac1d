"""Reports: the JSON documents, a material back from one, and the tables for people."""

import json
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diffshade import BlinnPhong, Material, Phong, QuadraticAttenuation, Scene
from diffshade.commands import usage
from diffshade.errors import BadInput
from diffshade.io.toml_document import Table
from diffshade.light.attenuation import (
    AbstractAttenuation,
    ExponentialAttenuation,
    LinearAttenuation,
)
from fitting.identify import Unidentified
from fitting.named_models import MODELS, named_material
from fitting.report import (
    evaluation_to_json,
    fit_to_json,
    intervals_to_json,
    material_from_json,
)
from fitting.report_text import (
    between,
    evaluation_report,
    fit_report,
    table,
    truth_table,
    uncertain,
)
from fitting.residual import Evaluation, ImageResidual

KD, KS = (0.1, 0.2, 1 / 3), (0.5, 0.25, 0.125)
CAPTURE = SimpleNamespace(
    names=("a.png", "b.png"),
    clipped=(np.array([[True, False]]), np.array([[True, True]])),
    notes=("images read as linear",),
)
PER_IMAGE = (ImageResidual(0.01, 100, 1), ImageResidual(0.03, 99, 3))
LAW = {"c0": 1.0, "c1": 0.0, "c2": 0.25}


def a_fit(*, attenuation: bool = False, **changed: object) -> SimpleNamespace:
    """What a report reads of a `Fit`, as plain values."""
    material = Material(kd=jnp.asarray(KD), specular=Phong(jnp.asarray(KS), jnp.asarray(60.0)))
    coefficients = {"kd": KD, "specular.0.ks": KS, "specular.0.shininess": 60.0}
    errors = {"kd": (1e-3, 2e-3, np.inf), "specular.0.ks": (1e-2,) * 3}
    if attenuation:
        coefficients |= {f"attenuation.{name}": value for name, value in LAW.items()}
        errors |= {"attenuation.c0": 1e-19, "attenuation.c1": 1e-3, "attenuation.c2": 2e-3}
        reference = {"l0": 0.5, "l1": 0.0, "l2": 0.5, "kd": KD, "specular.0.ks": KS}
        coefficients |= {f"reference.{name}": value for name, value in reference.items()}
        errors |= {f"reference.{name}": 0.01 * np.ones_like(v) for name, v in reference.items()}
    values = {
        "material": material,
        "scene": Scene(),
        "coefficients": {name: np.asarray(value) for name, value in coefficients.items()},
        "standard_errors": {name: np.asarray(value) for name, value in errors.items()},
        "unidentified": (Unidentified(("kd",), "no pixel tells " + "and tells " * 20),),
        "relative_residual": 0.02,
        "fraction_excluded": 0.015,
        "per_image": PER_IMAGE,
        "noise": float("nan"),
        "converged": True,
        "steps": 7,
        "reference_distance": 2.0 if attenuation else None,
        "intervals": {},
        "correlations": None,
        "basins": (),
        "suspect_images": (),
        "weighted_residual": None,
        "gains": None,
        "certificate": None,
        "profiles": (),
        "likelihood": None,
    }
    return SimpleNamespace(**values | changed)


def document(*, attenuation: bool = False) -> dict:
    made = fit_to_json(
        a_fit(attenuation=attenuation), CAPTURE, model="phong", seconds={"load": 0.5, "fit": 1.0}
    )
    return json.loads(json.dumps(made, allow_nan=False))


def as_table(made: object) -> Table:
    return Table(Path("fit.json"), "", made)  # type: ignore[arg-type]


# JSON


def test_a_fit_as_json() -> None:
    made = document()
    assert made["coefficients"] == {
        "ka": None,  # absent, which zero is not
        "kd": list(KD),
        "lobes": [{"kind": "phong", "ks": list(KS), "shininess": 60.0}],
        "body": None,
        "attenuation": None,
    }
    assert made["standard_errors"] == {
        "ka": None,
        "kd": [1e-3, 2e-3, None],  # infinite
        "lobes": [{"kind": "phong", "ks": [1e-2] * 3, "shininess": None}],  # held
        "body": None,
        "attenuation": None,
    }
    assert made["held"] == ["specular.0.shininess"]
    assert made["noise"] is None
    assert made["unidentified"][0]["coefficients"] == ["kd"]
    assert made["per_image"][1] == {
        "file": "b.png",
        "relative_residual": 0.03,
        "pixels_used": 99,
        "pixels_clipped": 2,
        "pixels_unusable": 1,
    }
    assert made["seconds"] == {"load": 0.5, "fit": 1.0}


def test_a_fitted_attenuation_as_json() -> None:
    made = document(attenuation=True)
    found, errors = made["coefficients"]["attenuation"], made["standard_errors"]["attenuation"]
    shares = {"l0": 0.5, "l1": 0.0, "l2": 0.5}
    reference = {"reference_distance": 2.0, **shares, "kd": list(KD), "ks": [list(KS)]}
    assert found == {"kind": "quadratic", **LAW, **reference}
    assert found.keys() == errors.keys()
    assert errors["reference_distance"] is None
    assert errors["kd"] == [0.01] * 3


def test_intervals_as_json() -> None:
    fit = a_fit(attenuation=True)
    ends = {
        name: (fit.coefficients[name] - 2 * error, fit.coefficients[name] + 2 * error)
        for name, error in fit.standard_errors.items()
    }
    made = json.loads(json.dumps(intervals_to_json(fit, ends), allow_nan=False))
    assert made["ka"] is None
    assert made["kd"][0] == pytest.approx([0.098, 0.102])
    assert made["kd"][2] == [None, None]  # infinite
    assert made["lobes"][0]["shininess"] == [None, None]  # held
    assert made["attenuation"]["c2"] == pytest.approx([0.246, 0.254])
    assert made["attenuation"]["ks"][0][1] == pytest.approx([0.23, 0.27])
    assert made.keys() == document(attenuation=True)["coefficients"].keys()


def test_an_evaluation_as_json() -> None:
    made = evaluation_to_json(Evaluation(float("inf"), 0.5, PER_IMAGE), CAPTURE)
    assert made["schema"] == "diffshade.evaluate/1"
    assert made["relative_residual"] is None
    assert made["fraction_excluded"] == 0.5
    assert [row["file"] for row in made["per_image"]] == ["a.png", "b.png"]


@pytest.mark.parametrize("attenuation", [False, True])
def test_the_material_of_a_document_is_that_of_the_fit(attenuation: bool) -> None:
    material, law = material_from_json(as_table(document(attenuation=attenuation)))
    fitted = a_fit().material
    assert jax.tree.structure(material) == jax.tree.structure(fitted)
    pairs = zip(jax.tree.leaves(material), jax.tree.leaves(fitted), strict=True)
    assert all(np.array_equal(one, other) and one.dtype == other.dtype for one, other in pairs)
    assert isinstance(law, QuadraticAttenuation) == attenuation
    if law is not None:
        assert {name: float(getattr(law, name)) for name in LAW} == LAW


def test_other_lobes_and_keys_of_later_versions_are_read() -> None:
    made = document()
    made["coefficients"]["lobes"][0]["kind"] = "blinn_phong"
    made["coefficients"]["kd"] = None
    made["later"] = 1
    material, _ = material_from_json(as_table(made))
    assert isinstance(material.specular[0], BlinnPhong)
    assert material.kd is None


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda d: d.update(schema="diffshade.evaluate/1"), "schema"),
        (lambda d: d.pop("coefficients"), "coefficients"),
        (lambda d: d["coefficients"].update(kd="0.5"), "kd"),
        (lambda d: d["coefficients"].update(kd=[0.5, float("nan"), 0.5]), "kd"),
        (lambda d: d["coefficients"].update(body={"kind": "other"}), "body"),
        (lambda d: d["coefficients"].update(kd=None, lobes=[]), "no coefficient"),
        (lambda d: d["coefficients"]["lobes"][0].update(kind="ward"), "lobe 1: kind"),
        (lambda d: d["coefficients"]["lobes"][0].update(alpha=0.1), "alpha"),
        (lambda d: d["coefficients"]["lobes"][0].pop("shininess"), "shininess"),
        (lambda d: d["coefficients"]["lobes"][0].update(shininess=-1), "shininess"),
        (lambda d: d["coefficients"]["attenuation"].update(kind="cubic"), "attenuation: kind"),
        (lambda d: d["coefficients"]["attenuation"].pop("c2"), "c2"),
        (lambda d: d["coefficients"]["attenuation"].update(c1=None), "c1"),
    ],
)
def test_what_is_no_fit_is_refused_in_one_line(spoil, says: str) -> None:
    made = document(attenuation=True)
    spoil(made)
    with pytest.raises(BadInput) as caught:
        material_from_json(as_table(made))
    message = str(caught.value)
    assert message.startswith("fit.json: ")
    assert says in message
    assert "\n" not in message


def test_the_command_line_offers_the_models_that_have_names() -> None:
    assert set(usage.MODELS) == set(MODELS)
    assert named_material("lambert", ambient=False).specular == ()
    first, second = named_material("phong2", ambient=True).specular
    assert first.shininess > second.shininess


# Text


@pytest.mark.parametrize(
    ("value", "error", "note", "reads"),
    [
        (0.161818, 4.57e-5, "", ("0.161818", "+/- 0.000046")),
        (559.4034, 0.8004, "", ("559.40", "+/- 0.80")),
        (12345.6, 789.0, "", ("12346", "+/- 789")),
        (0.0, 3e-5, "", ("0.000000", "+/- 0.000030")),
        (0.1 + 0.2, 1e-17, "", ("0.3", "+/- 1e-17")),
        (0.5, 0.0, "", ("0.5", "+/- 0e+00")),
        (0.5, None, "held", ("0.5", "(held)")),
        (0.5, None, "", ("0.5", "(error unknown)")),
        (None, 0.1, "", ("not finite", "")),
    ],
)
def test_a_value_and_its_error(value, error, note: str, reads: tuple[str, str]) -> None:
    assert uncertain(value, error, note) == reads


@pytest.mark.parametrize(
    ("interval", "reads"),
    [
        ((0.0996, 0.1004), "0.09960 to 0.10040"),
        ((41.2, 88.7), "41 to 89"),
        ((0.5, 0.5), "0.5 to 0.5"),
        ((0.0, 0.000108), "0 (bound) to 0.000108"),
        ((0.93, 1.0), "0.930 to 1 (bound)"),
        ((None, 88.7), "88.7 or less"),
        ((41.2, None), "41.2 or more"),
        ((None, None), "not known"),
    ],
)
def test_an_interval_in_words(interval, reads: str) -> None:
    assert between(interval) == reads


def test_intervals_stand_below_the_errors() -> None:
    made = {key: value for key, value in document().items() if key != "intervals"}
    assert "95 % intervals" not in fit_report(made)
    pairs = [[0.096, 0.104], [0.196, 0.204], [None, None]]
    lobe = {"kind": "phong", "ks": pairs, "shininess": [None, None]}
    made["intervals"] = {"ka": None, "kd": pairs, "lobes": [lobe], "attenuation": None}
    below = fit_report(made).partition("95 % intervals")[2].splitlines()
    assert below[1].split() == ["red", "green", "blue"]
    assert " ".join(below[2].split()) == "kd 0.0960 to 0.1040 0.1960 to 0.2040 not known"
    assert not any(line.startswith("shininess") for line in below[:5])  # held


def test_columns_are_aligned() -> None:
    lines = table([("", "x", ""), ("kd", "1.0", "+/- 0.1"), ("shininess", "20", "")], "<><")
    assert lines.splitlines() == [
        "              x",
        "kd          1.0 +/- 0.1",
        "shininess    20",
    ]


def test_the_report_says_everything() -> None:
    report = fit_report(document(attenuation=True))
    for said in (
        "model phong",
        "red",
        "(held)",
        "(error unknown)",
        "c2",
        "(by convention)",
        "d0 = 2",
    ):
        assert said in report
    for said in ("not identified: kd: no pixel tells", "0.02 of 2 images", "1.5 %", "3 clipped"):
        assert said in report
    assert "note: images read as linear" in report
    assert "CONVERGE" not in report
    assert max(map(len, report.splitlines())) <= 106
    assert report.isascii()


def test_a_report_of_what_went_badly() -> None:
    fit = a_fit(converged=False, relative_residual=float("inf"))
    made = fit_to_json(fit, CAPTURE, model="phong", seconds={})
    report = fit_report(made)
    assert "DID NOT CONVERGE" in report
    assert "relative residual not finite" in report


def test_a_report_names_the_image_that_stands_out() -> None:
    assert "disagrees" not in fit_report(document())
    suspect = {"file": "003.png", "reason": "nine times the others: check its light"}
    report = fit_report(document() | {"suspect_images": [suspect]})
    assert "003.png disagrees with the others: nine times the others: check its light" in report


def test_of_many_images_the_worst_are_named() -> None:
    made = document()
    made["per_image"] = [
        {"file": f"{k}.png", "relative_residual": k / 100, "pixels_used": 1, "pixels_clipped": 0}
        for k in range(30)
    ]
    report = evaluation_report(made)
    assert all(f"{k}.png" in report for k in (0, 1, 27, 28, 29))
    assert "12.png" not in report


def test_the_truth_beside_what_was_recovered() -> None:
    truth = {"kd": [0.1, 0.1, 0.1], "ks": [0.5] * 3, "shininess": 50.0, "attenuation": LAW}
    lines = truth_table(truth, document(attenuation=True)).splitlines()
    green = next(line for line in lines if "green" in line).split()
    assert green == ["kd", "green", "0.1", "0.2000", "+/-", "0.0020", "+100.0000", "%", "+50.0"]
    shininess = next(line for line in lines if line.startswith("shininess")).split()
    assert shininess == ["shininess", "50", "60", "(held)", "+20.0000", "%"]


@pytest.mark.parametrize(
    ("law", "kind"),
    [(LinearAttenuation(1.0, 0.25), "linear"), (ExponentialAttenuation(0.5), "exponential")],
)
def test_other_laws_are_written_and_read(law: AbstractAttenuation, kind: str) -> None:
    """With the constants that they have, and no reference distance where none is meant."""
    constants = {f.name: np.asarray(getattr(law, f.name)) for f in fields(law)}
    plain = a_fit()
    found = {f"attenuation.{name}": value for name, value in constants.items()}
    shares = {"reference.l0": 0.7, "reference.l1": 0.3, "reference.kd": 0.5}
    found |= {name: np.array(value) for name, value in shares.items() if kind == "linear"}
    fit = a_fit(
        coefficients=plain.coefficients | found,
        standard_errors=plain.standard_errors | {name: np.array(0.01) for name in found},
        reference_distance=2.0 if kind == "linear" else None,
    )
    made = fit_to_json(fit, CAPTURE, model="phong", seconds={"load": 0.5, "fit": 1.0})
    written = made["coefficients"]["attenuation"]
    assert written["kind"] == kind
    assert ("l1" in written) == ("reference_distance" in written) == (kind == "linear")
    read = material_from_json(as_table(made))[1]
    assert type(read) is type(law)
    assert {name: float(getattr(read, name)) for name in constants} == {
        name: float(value) for name, value in constants.items()
    }
    report = fit_report(made)
    assert ("f(d) = exp(-a d)" in report) == (kind == "exponential")
    assert ("l0 + l1 d/d0)" in report) == (kind == "linear")
