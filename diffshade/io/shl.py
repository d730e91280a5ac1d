"""AliceVision's `.shl`: light from all around, as its `lightingEstimation` writes it.

Nine rows of three numbers, red, green and blue, for what the rows are to be multiplied by:

    c_k:   n_x, n_y, n_z, 1, n_x n_y, n_x n_z, n_y n_z, n_x^2 - n_y^2, 3 n_z^2 - 1

(AliceVision, `augmentedNormals.hpp` and `main_lightingEstimation.cpp`.) An image is there the albedo
times the sum of c_k times these, solved for all nine together: the sum is E(n), and the albedo, 0.5
unless told otherwise, the plain k_d of `diffshade.EnvironmentLight`. Normals are in the axes of
AliceVision's scene, y down and z forward; here y and z are turned about, as AliceVision itself turns
a mesh that it writes.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from diffshade.errors import BadInput
from diffshade.io.text_rows import rows

if TYPE_CHECKING:
    from diffshade.light.environment import EnvironmentLight

__all__ = ["read_shl"]

_NUMBERS = (3, 1, 2, 0, 4, 7, 5, 8, 6)
"""The number l^2 + l + m of the harmonic that each row is of."""
_SIGNS = (1, -1, -1, 1, -1, -1, 1, 1, 1)
"""What becomes of each polynomial where y and z are turned about."""


def read_shl(path: str | os.PathLike[str]) -> EnvironmentLight:
    """The light of a file: L_lm = c / (A_l N_lm), of order 2; [9] where red, green and blue are alike.

    Raises `BadInput` for anything but nine rows of three finite numbers.

    >>> read_shl("global.shl").order
    2
    """
    from diffshade.light.environment import COSINE, LOWEST, EnvironmentLight

    found = rows(Path(path), 3)
    if len(found) != len(_NUMBERS):
        raise BadInput(
            f"{path}: {len(found)} rows where 9 belong; give a file of AliceVision's lightingEstimation"
        )
    # Y_lm is before 1; y, z, x; xy, yz, 3 z^2 - 1, xz, x^2 - y^2
    before = [a * n for a, normalised in zip(COSINE, LOWEST, strict=True) for n in normalised]
    harmonics = np.zeros((len(found), 3))
    for (where, values), number, sign in zip(found, _NUMBERS, _SIGNS, strict=True):
        if not (np.abs(values) < 1e15).all():
            raise BadInput(f"{where}: holds what is as good as infinity; correct it")
        harmonics[number] = sign * values / before[number]
    grey = (harmonics == harmonics[:, :1]).all()
    coefficients: Any = harmonics[:, 0] if grey else harmonics
    one: Any = 1.0
    return EnvironmentLight(coefficients, one)
