"""Where what is held sets the scale that k_d, k_s and c0, c1, c2 share: how the search begins.

Held k_d, say, leaves a law whose constants may be of any size, and a grid fine enough for all sizes would
be large. Without the scale all are found up to one factor s, f k = (s f) (k / s), which what is held then
tells: that is where the law with its scale starts.
"""

from dataclasses import replace

import numpy as np

from fitting.basins import Basins
from fitting.gauge import PolynomialGauge
from fitting.limits import Limits
from fitting.model import Model

__all__ = ["scaled", "unscaled"]


def unscaled(model: Model) -> Model | None:
    """The model whose scale is free, of one whose scale is known; None of any other."""
    gauge = model.gauge
    if not isinstance(gauge, PolynomialGauge) or gauge.floating:
        return None
    held = tuple(None if value else value for value in gauge.held)  # one held at 0 is no scale
    return replace(model, gauge=PolynomialGauge(gauge.distance, held))


def scaled(basins: Basins, model: Model, limit: Limits) -> Basins:
    """The minima of the unscaled model as starts of `model`, whose scale is known."""
    assert isinstance(model.gauge, PolynomialGauge)
    count, lit = len(model.searched), np.array(model.lit)
    given = np.where(limit.held & lit, limit.lower, 0)
    held = np.array([value or 0.0 for value in model.gauge.held])
    laws = basins.u[:, count:]
    # By what is held: k / s as near to it as can be, or l / s
    over = np.sum(basins.k * given, axis=(1, 2)) + laws @ held
    scale = over / (np.sum(given**2) + np.sum(held**2))
    scale = np.where(scale > 0, scale, 1)[:, None]
    u = np.concatenate([basins.u[:, :count], laws / scale], axis=1)
    k = np.where(lit, basins.k / scale[:, :, None], basins.k)
    return replace(basins, u=np.clip(u, *limit.box), k=np.clip(k, limit.lower, limit.upper))
