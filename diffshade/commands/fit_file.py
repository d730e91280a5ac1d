"""Where a fit lies: a `fit.json`, or the folder that `fit --out` wrote it into."""

from __future__ import annotations

from pathlib import Path

from diffshade.errors import BadInput

__all__ = ["fit_file", "refuse_swapped"]

CAPTURES = (".toml", ".lp", ".dome")
"""The suffixes of captures that are files."""


def fit_file(path: Path) -> Path:
    """The fit in a folder; what is no folder as it is. Raises `BadInput` for a folder without one."""
    if not path.is_dir():
        return path
    if (path / "fit.json").is_file():
        return path / "fit.json"
    below = sorted(path.glob("*/fit.json"))
    instead = f"give one of those below it, as {below[0].parent}" if below else "give one that has"
    raise BadInput(f"{path}: this folder has no fit.json, which fit --out writes; {instead}")


def refuse_swapped(fit_json: Path, capture: Path) -> None:
    """Raise `BadInput` where a capture stands in the place of a fit, and a fit in that of a capture."""
    fit_last = capture.suffix.lower() == ".json" or (capture / "fit.json").is_file()
    capture_first = fit_json.suffix.lower() in CAPTURES or (
        fit_json.is_dir() and not (fit_json / "fit.json").is_file()
    )
    if fit_last and capture_first:
        raise BadInput(
            f"{fit_json} and {capture}: seem to be swapped; the fit goes first, and then the capture"
        )
