"""`diffshade evaluate`: how well a fitted material predicts other photographs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from diffshade.commands.console import show
from diffshade.commands.fit_file import fit_file, refuse_swapped
from diffshade.errors import BadInput, naming
from diffshade.io.json_document import read_json
from diffshade.progress import bar

if TYPE_CHECKING:
    from diffshade.io.capture import Capture
    from diffshade.light.attenuation import AbstractAttenuation
    from diffshade.reflectance.material import Material

__all__ = ["evaluate", "evaluate_capture"]


def evaluate(
    fit_json: Path,
    path: Path,
    *,
    as_json: bool,
    **reading: Any,
) -> int:
    """Evaluate a fit on a capture and print the result; returns the exit status."""
    from fitting.report_text import evaluation_report

    document = evaluate_capture(fit_json, path, **reading)
    show(document, evaluation_report(document), as_json=as_json)
    return 0


def evaluate_capture(
    fit_json: Path,
    path: Path,
    **reading: Any,
) -> dict[str, Any]:
    """Read a fit and a capture; how the one predicts the other, as a document.

    The fit may be the folder that it lies in. `reading`: the options of `read_capture`.

    Where the capture asks for attenuation constants to be fitted, the fit's are used.
    """
    import fitting
    from diffshade.io.read_capture import read_capture
    from fitting.gauge import with_attenuation
    from fitting.report import evaluation_to_json, material_from_json

    refuse_swapped(fit_json, path)
    fit_json = fit_file(fit_json)
    material, attenuation = material_from_json(read_json(fit_json, "a fit.json"))
    with bar(f"reading {path}") as progress:
        capture = read_capture(path, **reading, progress=progress)
    _check(capture, path, material, attenuation, fit_json)
    scenes = capture.scenes
    if capture.fit_attenuation is not None and attenuation is not None:
        scenes = tuple(with_attenuation(scene, attenuation) for scene in scenes)
    with naming(path), bar("predicting images") as progress:
        found = fitting.evaluate(
            material,
            capture.images,
            capture.gbuffer,
            scenes,
            valid=capture.valid,
            progress=progress,
        )
        return evaluation_to_json(found, capture)


def _check(
    capture: Capture,
    path: Path,
    material: Material,
    attenuation: AbstractAttenuation | None,
    fit_json: Path,
) -> None:
    """Refuse a fit that is not for captures of this form."""
    import jax

    if capture.fit_attenuation is not None and attenuation is None:
        raise BadInput(
            f"{path}: leaves the attenuation to be fitted, and {fit_json} has none; give its lights"
            " their constants"
        )
    channel_count = capture.images[0].shape[2]
    found = {leaf.shape[0] for leaf in jax.tree.leaves(material) if leaf.ndim} - {1, channel_count}
    if found:
        raise BadInput(
            f"{path}: images of {channel_count} channel{'s' * (channel_count > 1)}, where {fit_json}"
            f" has coefficients for {min(found)}; give photographs like those of the fit"
        )
