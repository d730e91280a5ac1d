"""`diffshade demo`: the main job on the capture that ships with the package."""

from __future__ import annotations

import json
from pathlib import Path

from diffshade.commands.console import show
from diffshade.commands.fit import fit_capture
from diffshade.commands.folder import check_folder

__all__ = ["CAPTURE", "demo"]

CAPTURE = Path(__file__).parents[1] / "captures" / "glossy_ball"
"""Six pictures of a ball by POV-Ray, which knows nothing of this library, and the truth."""


def demo(*, out: Path | None, as_json: bool) -> int:
    """Fit the capture, print what was recovered beside the truth; returns the exit status."""
    from fitting.report_text import fit_report

    if out is not None:
        check_folder(out)
    truth = json.loads((CAPTURE / "truth.json").read_text(encoding="utf-8"))
    fitted = fit_capture(CAPTURE)
    document = {**fitted.document, "truth": truth}
    title = "A glossy ball under near lights, rendered by POV-Ray: true and recovered coefficients"
    report = f"{title}\n\n{fit_report(document, truth=truth)}"
    if out is not None:
        report += f"\n\n{fitted.write(out, document, report, title)}"
    show(document, report, as_json=as_json)
    return fitted.status
