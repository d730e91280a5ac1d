"""A capture with its lights where its photographs want them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from diffshade.errors import BadInput
from diffshade.io.capture import Capture
from diffshade.light.parallel import ParallelLight
from diffshade.light.point import AbstractPointLight
from diffshade.reflectance.material import Material
from fitting.calibrate.joint_lights import FEWEST, RefinedLights, refine_lights
from fitting.calibrate.sampled import sampled
from fitting.limits import Bounds
from fitting.report import plain

__all__ = ["with_refined_lights"]

MOST = 2**16
"""Pixels times images that are looked at, a fair sample of them."""


def with_refined_lights(
    capture: Capture, material: Material, bounds: Bounds
) -> tuple[Capture, dict[str, Any]]:
    """The capture with its lights refined and a note on what changed, and what a document says of them.

    Outliers such as shadows and dirt have little weight in that, whatever the fit makes of them.
    Raises `BadInput` for lights other than one parallel light an image, and for a single image.
    """
    if any(isinstance(light, AbstractPointLight) for s in capture.scenes for light in s.lights):
        raise BadInput(
            "its lights are near, and --refine-lights turns distant ones: leave it out, or use"
            " fitting.calibrate.refine_near_lights, which wants a ball of known size and its camera"
        )
    if len(capture.images) < 2:
        raise BadInput(
            "of one image nothing tells a light that was turned from a surface that was: give"
            " photographs under other lights too, or leave out --refine-lights"
        )
    for name, scene in zip(capture.names, capture.scenes, strict=True):
        if [type(light) for light in scene.lights] != [ParallelLight]:
            kinds = ", ".join(sorted({type(light).__name__ for light in scene.lights})) or "none"
            raise BadInput(
                f"{name}: has {len(scene.lights)} lights ({kinds}) where --refine-lights turns the one"
                " parallel light of an image: leave it out, or leave out --refine-lights"
            )
    looked_at = sampled(capture.images, capture.gbuffer, capture.valid, MOST)
    found = refine_lights(
        looked_at.images,
        looked_at.gbuffer,
        capture.scenes,
        material=material,
        bounds=bounds,
        valid=looked_at.valid,
    )
    document = _document(found, capture.names)
    note = _note(found, document)
    return replace(capture, scenes=found.scenes, notes=(*capture.notes, note)), document


def _document(found: RefinedLights, names: tuple[str, ...]) -> dict[str, Any]:
    """The `lights` of a "diffshade.fit/1" document."""
    reasons = {light.image: light.reason for light in found.moved}
    return {
        "before": plain(found.before),
        "relative_residual": plain(found.relative_residual),
        "converged": found.converged,
        "per_image": [
            {
                "file": name,
                "degrees": plain(found.changes[k]),
                "standard_error": plain(found.standard_errors[k]),
                "gain": plain(found.strengths[k]),
                "gain_error": plain(found.strength_errors[k]),
                "direction": plain(found.directions[k]),
                "moved": reasons.get(k),
            }
            for k, name in enumerate(names)
        ],
    }


def _note(found: RefinedLights, document: dict[str, Any]) -> str:
    changes = found.changes
    moved = [row["file"] for row in document["per_image"] if row["moved"]]
    told = f"the lamp of {' and of '.join(moved)} has moved" if moved else "no lamp stands out"
    if len(changes) < FEWEST:
        told = f"which lamp has moved is not told by fewer than {FEWEST} images"
    unfinished = "" if found.converged else "; the refinement did not converge"
    return (
        f"lights refined by the shading: turned by {changes.min():.2f} to {changes.max():.2f} degrees,"
        f" strengths {found.strengths.min():.3f} to {found.strengths.max():.3f}; {told}; residual"
        f" {found.before:.4f} to {found.relative_residual:.4f}{unfinished}"
    )
