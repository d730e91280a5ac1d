"""`diffshade fit`: the coefficients of a material from photographs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from diffshade.commands.console import WrongUsage, note, show
from diffshade.commands.folder import check_folder, write_folder
from diffshade.commands.refinements import Refinements
from diffshade.errors import BadInput, naming
from diffshade.progress import Progress, bar

if TYPE_CHECKING:
    from diffshade.io.capture import Capture
    from diffshade.reflectance.material import Material
    from fitting.found import Fit

__all__ = ["Fitted", "Hold", "fit", "fit_capture", "fit_into"]

Hold = tuple[str, tuple[float, ...]]
"""The name of a coefficient and the value it is held at: one number, or one a channel."""


@dataclass(frozen=True)
class Fitted:
    """A fit, what it was fitted to, and its document."""

    capture: Capture
    fit: Fit
    document: dict[str, Any]
    refined: bool = False
    """Whether the capture is not as it was read; then it is written beside the fit."""

    def write(self, folder: Path, document: Mapping[str, Any], report: str, title: str) -> str:
        """Write a folder of results; `title` is that of the page. Returns which files there are."""
        scenes = tuple(self.fit.scene)
        own = self.capture, self.fit.material, scenes
        with bar(f"writing {folder}"):
            names = write_folder(folder, document, report, title, *own, with_capture=self.refined)
        return f"written into {folder}: {', '.join(names)}"

    @property
    def status(self) -> int:
        """The exit status: 0, or 1 where the search did not converge."""
        return 0 if self.fit.converged else 1


def fit(path: Path, *, out: Path | None, as_json: bool, **options: Any) -> int:
    """Fit a capture, print the result, write it where `out` says; returns the exit status.

    The options are those of `fit_capture`.
    """
    fitted, report = fit_into(out, path, **options)
    show(fitted.document, report, as_json=as_json)
    return fitted.status


def fit_into(out: Path | None, path: Path, **options: Any) -> tuple[Fitted, str]:
    """Fit a capture and write it where `out` says; the fit and its report, and what was written."""
    from fitting.report_text import fit_report

    if out is not None:
        check_folder(out, with_capture=Refinements.asked(**options).any)
    fitted = fit_capture(path, **options)
    report = fit_report(fitted.document)
    if out is not None:
        title = f"A fit of {path.resolve().name}"
        report += f"\n\n{fitted.write(out, fitted.document, report, title)}"
    return fitted, report


def fit_capture(
    path: Path,
    *,
    model: str = "phong",
    hold: Sequence[Hold] = (),
    robust: bool = False,
    censor: bool = False,
    gains: bool = False,
    certify: bool = False,
    fit_gamma: bool = False,
    refine_circle: bool = False,
    refine_lights: bool = False,
    white: float | None = None,
    circle: tuple[float, float, float] | None = None,
    encoding: str | float | None = None,
    allow_outside: bool = False,
    devices: Sequence[Any] | None = None,
) -> Fitted:
    """Read a capture and fit it, on one device of JAX or on several."""
    started = perf_counter()
    import fitting
    from fitting.named_models import MODELS, named_bounds, named_material
    from fitting.report import fit_to_json

    asked = Refinements(gamma=fit_gamma, circle=refine_circle, lights=refine_lights)
    asked.check(model, encoding)
    if model == "auto" and hold:
        raise WrongUsage("--hold: names coefficients of one model; give --model too, not auto")
    capture, said = asked.of(
        path,
        model,
        white=white,
        circle=circle,
        encoding=encoding,
        allow_outside=allow_outside,
    )
    ambient = any(scene.ambient is not None for scene in capture.scenes)
    loaded = perf_counter()
    observed = capture.images, capture.gbuffer, capture.scenes
    options: dict[str, Any] = {
        "robust": "tukey" if robust else None,
        "valid": capture.valid,
        "clipped": capture.clipped if censor else None,
        "gains": gains,
        "devices": devices,
    }
    compared: tuple[fitting.Comparison, ...] = ()
    with naming(path):
        if model == "auto":
            laws, names = (capture.fit_attenuation,), tuple(MODELS)
            with bar("comparing models") as progress:
                compared = fitting.compare(
                    *observed, laws, materials=names, progress=_naming(names, progress), **options
                )
            found, model = compared[0].fit, compared[0].name
        if certify or not compared:
            material = named_material(model, ambient=ambient)
            with bar(f"fitting {len(capture.images)} images"):
                found = fitting.fit(
                    *observed,
                    material=_held(material, hold, capture.images[0].shape[2]),
                    attenuation=capture.fit_attenuation,
                    hold=[name for name, _ in hold],
                    bounds=named_bounds(model),
                    certify=certify,
                    profiles=certify,
                    **options,
                )
    seconds = {"load": loaded - started, "fit": perf_counter() - loaded}
    document = fit_to_json(found, capture, model=model, seconds=seconds) | said
    if compared:
        document["compared"] = [
            {"model": row.name, "bic": row.bic, "relative_residual": row.fit.relative_residual}
            for row in compared
        ]
    return Fitted(capture, found, document, refined=asked.any)


def _naming(models: Sequence[str], progress: Progress | None) -> Progress:
    """Notes each model as its fit begins, whoever watches: all of them take a minute or two."""

    def tell(finished: int, count: int) -> None:
        if progress is not None and finished:
            progress(finished, count)
        if finished < count:
            note(f"fitting {models[finished]}, model {finished + 1} of {count}")

    tell(0, len(models))
    return tell


def _held(material: Material, hold: Sequence[Hold], channel_count: int) -> Material:
    """The material with the values of what is held."""
    import equinox as eqx
    import jax.numpy as jnp

    from diffshade.reflectance.names import coefficient
    from fitting.model import held_names
    from fitting.shapes import is_shape

    for name, values in hold:
        try:
            names = held_names([name], material)
        except BadInput as error:
            raise WrongUsage(f"--hold: {error}") from None
        counts = (1,) if all(map(is_shape, names)) else (1, channel_count)
        if len(values) not in counts:
            raise WrongUsage(
                f"--hold {name}: {len(values)} numbers; give"
                f" {' or '.join(map(str, dict.fromkeys(counts)))}"
            )
        value = jnp.asarray(values if len(values) > 1 else values[0], float)
        for full in names:
            material = eqx.tree_at(lambda m: coefficient(m, full), material, value)  # noqa: B023
    return material
