"""Where a fit lies: a `fit.json`, or the folder that `fit --out` wrote it into."""

from __future__ import annotations

from pathlib import Path

from diffshade.errors import BadInput
from diffshade.io.json_document import read_json

__all__ = ["fit_file", "refuse_swapped"]


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
    if _is_fit(capture) and not _is_fit(fit_json) and _is_capture(fit_json):
        raise BadInput(
            f"{fit_json} and {capture}: seem to be swapped; the fit goes first, and then the capture"
        )


def _is_fit(path: Path) -> bool:
    """Whether a fit lies there: other programs write files that end in `.json` too."""
    if path.is_dir():
        return (path / "fit.json").is_file()
    if path.suffix.lower() != ".json":
        return False
    try:
        schema = read_json(path, "a fit.json").values.get("schema")
    except BadInput:
        return False
    return isinstance(schema, str) and schema.startswith("diffshade.fit/")


def _is_capture(path: Path) -> bool:
    """Whether it has the form of a capture, which may be damaged."""
    from diffshade.io.photometric_stereo import FILES

    if path.is_dir():
        return any((path / name).is_file() for name in ("capture.toml", *FILES))
    return path.suffix.lower() in (".toml", ".lp", ".dome", ".json")
