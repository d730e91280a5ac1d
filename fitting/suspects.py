"""A bad image among many, found by what the others leave of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.residual import ImageResidual
from fitting.weights import MAD

__all__ = ["SuspectImage", "suspects"]

FEWEST = 5
"""Images among which one can stand out."""
SPREADS = 3.5
"""Robust standard deviations of the logarithm of the residual beyond which an image stands out ..."""
FACTOR = 1.5
"""... where it is also so many times the typical one."""


@dataclass(frozen=True)
class SuspectImage:
    """An image whose residual stands out from those of the others, by its number, and why."""

    image: int
    reason: str


def suspects(per_image: Sequence[ImageResidual]) -> tuple[SuspectImage, ...]:
    """The images that fit so much worse than the others that something is wrong with them.

    Judged by the relative residual on a logarithmic scale, against the median and the median
    absolute deviation of all, which a few bad images do not move. A wrong light, a moved camera, a
    changed exposure and a blurred image all show so.
    """
    residuals = np.array([image.relative_residual for image in per_image], float)
    told = np.isfinite(residuals) & (residuals > 0)
    if told.sum() < FEWEST:
        return ()
    logarithm = np.log(np.where(told, residuals, 1.0))
    middle = np.median(logarithm[told])
    spread = MAD * np.median(np.abs(logarithm[told] - middle))
    above = logarithm - middle
    bad = told & (above > SPREADS * spread) & (above > np.log(FACTOR))
    return tuple(
        SuspectImage(
            int(k),
            f"its relative residual {residuals[k]:.3g} is {np.exp(above[k]):.1f} times that of the"
            " typical image: check its light, its exposure and that nothing moved, or leave it out",
        )
        for k in np.flatnonzero(bad)
    )
