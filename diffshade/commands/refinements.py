"""What `diffshade fit` makes of a capture before it fits it: its gamma, its circle, its lights.

Each is found with the others as they are, in that order: a gamma is of the values themselves; a wrong
circle turns the normals, which lights would follow.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from diffshade.commands.console import WrongUsage
from diffshade.errors import naming
from diffshade.progress import bar

if TYPE_CHECKING:
    from diffshade.io.capture import Capture
    from diffshade.reflectance.material import Material

__all__ = ["Refinements"]


@dataclass(frozen=True)
class Refinements:
    """What is to be refined."""

    gamma: bool
    circle: bool
    lights: bool

    @classmethod
    def asked(
        cls,
        *,
        fit_gamma: bool = False,
        refine_circle: bool = False,
        refine_lights: bool = False,
        **_others: Any,
    ) -> Refinements:
        """Those among the options of a fit."""
        return cls(gamma=fit_gamma, circle=refine_circle, lights=refine_lights)

    @property
    def any(self) -> bool:
        """Whether anything is."""
        return self.gamma or self.circle or self.lights

    def check(self, model: str, encoding: str | float | None) -> None:
        """Refuse options that do not go with it."""
        flags = {"--fit-gamma": self.gamma, "--refine-circle": self.circle}
        flags["--refine-lights"] = self.lights
        for flag, asked in flags.items():
            if asked and model == "auto":
                raise WrongUsage(f"{flag}: is by one model's shading; give --model too, not auto")
        if self.gamma and encoding is not None:
            raise WrongUsage("--fit-gamma: finds what --encoding states; give one of the two")

    def of(
        self,
        path: Path,
        model: str,
        *,
        encoding: str | float | None,
        **reading: Any,
    ) -> tuple[Capture, dict[str, Any]]:
        """The capture at a path, refined, and what the document of the fit says of that.

        `reading`: the other options of `read_capture`.
        """
        said: dict[str, Any] = {}
        capture = _read(path, encoding="linear" if self.gamma else encoding, **reading)
        if not self.any:
            return capture, said
        from fitting.named_models import named_bounds, named_material

        ambient = any(scene.ambient is not None for scene in capture.scenes)
        given: tuple[Material, Any] = named_material(model, ambient=ambient), named_bounds(model)
        if self.gamma:
            from fitting.calibrate.decoded_capture import gamma_of, gamma_to_json, with_gamma

            with naming(path), bar("finding the gamma by the shading"):
                found = gamma_of(capture, *given)
            said["response"] = gamma_to_json(found)
            capture = with_gamma(_read(path, encoding=found.gamma, **reading), found)
        if self.circle:
            from fitting.calibrate.refined_capture import with_refined_circle

            with naming(path), bar("refining the circle by the shading"):
                capture = with_refined_circle(capture, *given)
        if self.lights:
            from fitting.calibrate.relit_capture import with_refined_lights

            with naming(path), bar("refining the lights by the shading"):
                capture, said["lights"] = with_refined_lights(capture, *given)
        return capture, said


def _read(path: Path, **reading: Any) -> Capture:
    from diffshade.io.read_capture import read_capture

    with bar(f"reading {path}") as progress:
        return read_capture(path, progress=progress, **reading)
