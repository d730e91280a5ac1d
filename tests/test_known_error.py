"""The error of every formula stays within the bounds that stand beside it, and that of renders too."""

from typing import Any

import numpy as np
import pytest

from benchmarks.errors import measure
from benchmarks.formulas import FORMULAS, Formula
from benchmarks.renders import GRADIENT, IMAGE, gbuffer_error, gradient_error, image_error

pytestmark = pytest.mark.float64  # both precisions are measured in one run


def named(formula: Formula) -> str:
    return formula.name


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("formula", FORMULAS, ids=named)
def test_values_against_fifty_digits(formula: Formula, dtype: Any) -> None:
    for stratum in formula.strata:
        error = measure(formula, stratum, dtype, 64, derivatives=False).value
        assert error <= stratum.value, stratum.name


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("formula", [f for f in FORMULAS if f.traced], ids=named)
def test_derivatives_against_fifty_digits(formula: Formula, dtype: Any) -> None:
    for stratum in formula.strata:
        if stratum.derivative is not None:
            error = measure(formula, stratum, dtype, 64).derivative
            assert error is not None
            assert error <= stratum.derivative, stratum.name


def test_a_sphere_is_rounded_once() -> None:
    assert gbuffer_error(512) <= 0.5 + 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [1.0, 10.0, 32.0, 100.0, 200.0])
@pytest.mark.parametrize("lights", IMAGE)
def test_a_render_in_single_precision(lights: int, exponent: float) -> None:
    assert image_error(lights, exponent) <= IMAGE[lights]
    assert gradient_error(lights, exponent) <= GRADIENT
