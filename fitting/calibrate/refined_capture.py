"""A capture of a ball, with the circle that its shading speaks for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diffshade.errors import BadInput
from diffshade.io.capture import Capture
from diffshade.io.circle import ball_gbuffer
from diffshade.reflectance.material import Material
from fitting.calibrate.shading_circle import refine_circle
from fitting.limits import Bounds

__all__ = ["with_refined_circle"]


def with_refined_circle(capture: Capture, material: Material, bounds: Bounds) -> Capture:
    """The capture with its circle refined, and a note on what changed.

    Raises `BadInput` where the geometry is not made of a circle, and where no circle within 5 % of
    the radius fits the shading best.
    """
    if capture.circle is None:
        raise BadInput("its geometry is not made of a circle: leave out --refine-circle")
    mask = np.asarray(capture.gbuffer.mask)
    found = refine_circle(
        capture.images,
        capture.circle,
        capture.scenes,
        mask=mask,
        valid=capture.valid,
        material=material,
        bounds=bounds,
    )
    if found.at_limit:
        raise BadInput(
            "its shading wants a circle farther than 5 % of the radius from the one that is there:"
            " check the lights' directions, or leave out --refine-circle"
        )
    (cx, cy, radius), errors = found.circle, found.standard_errors
    gbuffer = ball_gbuffer(found.circle, (mask.shape[0], mask.shape[1]), mask)
    inside = np.asarray(gbuffer.mask)
    unfinished = "" if found.converged else "; the refinement did not converge"
    note = (
        f"circle refined by the shading: radius {found.start.radius:.2f} to {radius:.2f} +-"
        f" {errors.radius:.2f}, centre ({found.start.cx:.2f}, {found.start.cy:.2f}) to ({cx:.2f},"
        f" {cy:.2f}) +- ({errors.cx:.2f}, {errors.cy:.2f}) pixels; residual off the rim"
        f" {found.before:.4f} to {found.relative_residual:.4f}{unfinished}"
    )
    return replace(
        capture,
        gbuffer=gbuffer,
        valid=tuple(valid & inside for valid in capture.valid),
        clipped=tuple(clipped & inside for clipped in capture.clipped),
        circle=found.circle,
        notes=(*capture.notes, note),
    )
