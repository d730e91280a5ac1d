"""Transfer functions against published values."""

import json
from pathlib import Path

import numpy as np
import pytest

from diffshade.errors import BadInput
from diffshade.io.encoding import decode, encode_srgb

REFERENCES = Path(__file__).resolve().parents[3] / "shared/data/reference_values.json"

OURS = {
    "srgb.from_linear_rgb": lambda inputs: encode_srgb(inputs["linear"]),
    "linear_rgb.from_srgb": lambda inputs: decode(inputs["srgb"], "srgb"),
    "eotf_sRGB": lambda inputs: decode(inputs["srgb"], "srgb"),
}


@pytest.mark.parametrize("function", OURS)
def test_values_that_other_projects_assert(function: str) -> None:
    if not REFERENCES.exists():
        pytest.skip(f"{REFERENCES.name} is absent: the shared data are not beside the repository")
    entries = [e for e in json.loads(REFERENCES.read_text()) if e["function"] == function]
    assert entries
    for entry in entries:
        tolerance = {"rtol": 0.0, **entry["tol"]}
        np.testing.assert_allclose(OURS[function](entry["inputs"]), entry["expected"], **tolerance)


def test_both_branches_of_iec_61966_2_1() -> None:
    linear = np.array([0.0, 0.001, 0.0031308, 0.004, 0.18, 1.0])
    power = [1.055 * value ** (1 / 2.4) - 0.055 for value in (0.004, 0.18)]
    display = [0.0, 0.01292, 12.92 * 0.0031308, *power, 1.0]
    np.testing.assert_allclose(encode_srgb(linear), display, rtol=1e-14)
    np.testing.assert_allclose(decode(display, "srgb"), linear, rtol=1e-6, atol=0)


def test_nothing_is_clipped_and_no_nan_is_made() -> None:
    assert encode_srgb(-0.1) == pytest.approx(-1.292)
    assert decode(-0.1, "srgb") == pytest.approx(-0.1 / 12.92)
    assert encode_srgb(4.0) == pytest.approx(1.055 * 4 ** (1 / 2.4) - 0.055)
    assert decode([-0.5, 0.5], 2.0).tolist() == [-0.25, 0.25]


def test_linear_and_gamma() -> None:
    values = np.array([0.0, 0.25, 1.0, 3.0], np.float32)
    assert np.array_equal(decode(values, "linear"), values)
    np.testing.assert_allclose(decode(values, 2.2), values.astype(float) ** 2.2, rtol=1e-6)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_precision_is_kept(dtype: type) -> None:
    values: np.ndarray = np.linspace(0, 1, 7, dtype=dtype)
    assert encode_srgb(values).dtype == dtype
    assert {decode(values, encoding).dtype for encoding in ("linear", "srgb", 2.2)} == {
        np.dtype(dtype)
    }


@pytest.mark.parametrize("encoding", ["sRGB", "", 0, -2.2, float("nan"), True, None])
def test_another_encoding_is_refused(encoding: object) -> None:
    with pytest.raises(BadInput, match='give "linear", "srgb" or a gamma'):
        decode([0.5], encoding)  # type: ignore[arg-type]
