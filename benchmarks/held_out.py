"""A real ball: how well a fit predicts photographs under lights that it has not seen.

Four of 24 lights are left out at a time, image k in fold k mod 6, and one residual is taken over all
folds together. The photographs (DiLiGenT's ball) are not part of the repository.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

import fitting
from benchmarks.figures import ROOT, Figure, ask
from diffshade.io.capture import Capture
from diffshade.io.read_capture import read_capture
from fitting.named_models import named_bounds, named_material

__all__ = ["figures", "run"]

DATA = ROOT.parent / "shared" / "data" / "diligent_ball"
FOLDS = 6
MOST = {"phong": 0.095, "phong2": 0.088, "plastic": 0.0805, "plastic2": 0.0805}


def measure(folder: str, model: str) -> dict[str, Any]:
    """The residual over lights left out, and how wide each lobe is in each fold."""
    capture = read_capture(folder)
    count = len(capture.images)
    square = norm = 0.0
    widths, converged = [], True
    for fold in range(FOLDS):
        left_out = [k for k in range(count) if k % FOLDS == fold]
        fit = _fit(capture, model, [k for k in range(count) if k % FOLDS != fold])
        images, scenes, valid = _chosen(capture, left_out)
        evaluation = fitting.evaluate(fit.material, images, capture.gbuffer, scenes, valid=valid)
        share = sum(
            float((image[used].astype(np.float64) ** 2).sum())
            for image, used in zip(images, valid, strict=True)
        )
        square, norm = square + share * evaluation.relative_residual**2, norm + share
        widths.append([_width(lobe) for lobe in fit.material.specular])
        converged = converged and fit.converged
    together = _fit(capture, model, list(range(count)))
    return {
        "left out": (square / norm) ** 0.5,
        "all lights fitted": together.relative_residual,
        "widths": widths,
        "converged": converged and together.converged,
    }


def _fit(capture: Capture, model: str, chosen: list[int]) -> fitting.Fit:
    images, scenes, valid = _chosen(capture, chosen)
    material = named_material(model, ambient=True)
    return fitting.fit(
        images,
        capture.gbuffer,
        scenes,
        material=material,
        bounds=named_bounds(model),
        valid=valid,
    )


def _width(lobe: Any) -> float:
    return float(lobe.alpha if hasattr(lobe, "alpha") else lobe.shininess)


def _chosen(capture: Capture, chosen: list[int]) -> tuple[list[Any], list[Any], list[Any]]:
    together = (capture.images, capture.scenes, capture.valid)
    images, scenes, valid = ([each[k] for k in chosen] for each in together)
    return images, scenes, valid


def run(folder: str | Path = DATA) -> dict[str, Any]:
    """Every model, each in a process of its own; nothing where the photographs are absent."""
    folder = Path(folder)
    if not folder.is_dir():
        print(
            f"held-out is skipped: {folder} is absent; name another by held-out:folder=FOLDER",
            file=sys.stderr,
        )
        return {}
    return {model: ask("held_out", folder=str(folder.resolve()), model=model) for model in MOST}


def figures(results: dict[str, Any]) -> list[Figure]:
    """The residual of every model."""
    rows = []
    for model, found in results.items():
        rows += [
            Figure(f"ball, {model}: lights left out", found["left out"], most=MOST[model]),
            Figure(f"ball, {model}: all lights fitted", found["all lights fitted"]),
        ]
    return rows
