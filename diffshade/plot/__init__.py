"""What is shown, by a notebook, a report or a file: `pictures` are arrays, `charts` Matplotlib's axes."""

from diffshade.plot.charts import (
    chromaticities,
    correlations,
    cosine_powers,
    lobes,
    objective,
    recovered,
    residuals,
    trade_off,
)
from diffshade.plot.pictures import (
    comparison,
    contact_sheet,
    diverging,
    enlarged,
    exposure,
    left_out,
    panels,
    reduced,
    residual_scale,
    tone,
)

__all__ = [
    "chromaticities",
    "comparison",
    "contact_sheet",
    "correlations",
    "cosine_powers",
    "diverging",
    "enlarged",
    "exposure",
    "left_out",
    "lobes",
    "objective",
    "panels",
    "recovered",
    "reduced",
    "residual_scale",
    "residuals",
    "tone",
    "trade_off",
]
