"""The gamma of the photographs of a capture."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from diffshade.errors import BadInput
from diffshade.io.capture import Capture, Colour
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from fitting.calibrate.response import GAMMAS, Response, fit_gamma
from fitting.limits import Bounds
from fitting.report import plain

__all__ = ["gamma_of", "gamma_to_json", "with_gamma"]


def gamma_of(capture: Capture, material: Material, bounds: Bounds) -> Response:
    """The gamma of a capture that was read as linear, so that its values are those of the files.

    What images were divided by is part of their light again: a gamma is of what the sensor saw. Raises
    `BadInput` where no gamma fits best, where the 95 % interval is all that is sought, for images of
    different kinds or numbers of lights, and where an attenuation is to be fitted.
    """
    if capture.fit_attenuation is not None:
        raise BadInput(
            "its attenuation is to be fitted, which needs the gamma: give it numbers, or leave out"
            " --fit-gamma"
        )
    if len({jax.tree.structure(scene) for scene in capture.scenes}) > 1:
        raise BadInput(
            "its images have different kinds or numbers of lights, of which --fit-gamma cannot compare"
            " the shading: leave some out, or give --encoding"
        )
    channels = capture.images[0].shape[2]
    exposures = [
        np.ones(channels) if s.exposure is None else np.broadcast_to(s.exposure, channels)
        for s in capture.sources
    ]
    found = fit_gamma(
        [image * e.astype(image.dtype) for image, e in zip(capture.images, exposures, strict=True)],
        capture.gbuffer,
        [_exposed(scene, e) for scene, e in zip(capture.scenes, exposures, strict=True)],
        material=material,
        bounds=bounds,
        valid=capture.valid,
    )
    if found.at_limit:
        low, high = GAMMAS
        raise BadInput(
            f"no gamma from {low:g} to {high:g} fits its shading best: check geometry and lights, or"
            " give --encoding in place of --fit-gamma"
        )
    if found.interval == GAMMAS:
        low, high = GAMMAS
        raise BadInput(
            f"its images do not tell the gamma: with a material of its own any from {low:g} to {high:g}"
            " fits them, as where lights and model make all of the surface equally bright; check the"
            " lights, or give --encoding in place of --fit-gamma"
        )
    return found


def gamma_to_json(found: Response) -> dict[str, Any]:
    """The `response` of a "diffshade.fit/1" document."""
    return {
        "gamma": plain(found.gamma),
        "standard_error": plain(found.standard_error),
        "interval": plain(found.interval),
        "relative_residual": plain(found.relative_residual),
        "converged": found.converged,
    }


def with_gamma(capture: Capture, found: Response) -> Capture:
    """The capture, which was read with this gamma, with a note on where that comes from."""
    low, high = found.interval
    unfinished = "" if found.converged else "; the search did not converge"
    note = (
        f"gamma found by the shading: {found.gamma:.3f} +- {found.standard_error:.3f}, 95 % interval"
        f" {low:.3f} to {high:.3f}, taken as exact by all that follows; as right as geometry, lights and"
        f" model are, which leave {found.relative_residual:.3g} of the encoded values{unfinished}"
    )
    return replace(capture, notes=(*capture.notes, note))


def _exposed(scene: Scene, exposure: Colour) -> Scene:
    """The scene in which an image is what it was before it was divided."""

    def parts(scene: Scene) -> list[Any]:
        lights: Any = scene.lights
        own = [light.intensity for light in lights]
        return own if scene.ambient is None else [scene.ambient, *own]

    scaled = [part * jnp.asarray(exposure, part.dtype) for part in parts(scene)]
    return eqx.tree_at(parts, scene, scaled) if scaled else scene
