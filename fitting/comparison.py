"""Which model the images speak for: the same fit with several, and what an information criterion says."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from diffshade.arrays import ArrayLike
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.attenuation import AbstractAttenuation
from diffshade.progress import Progress, telling
from diffshade.reflectance.material import Material
from diffshade.scene import Scene
from fitting.estimate import fit
from fitting.found import Fit
from fitting.named_models import named_bounds, named_material

__all__ = ["Comparison", "compare"]


@dataclass(frozen=True)
class Comparison:
    """One model among those that were compared.

    `parameters` counts what is free, the noise among it. `bic` is m log n - 2 `log_likelihood`
    (Schwarz 1978), less is better. `weight`, exp(-(bic - least bic)/2) over the sum of all, is about
    the probability of the model, if one of those compared is true and none was preferred before.
    """

    name: str
    fit: Fit
    parameters: int
    log_likelihood: float
    bic: float
    weight: float


def compare(
    images: ArrayLike | Sequence[ArrayLike],
    gbuffer: GBuffer | Sequence[GBuffer],
    scenes: Scene | Sequence[Scene],
    attenuations: Sequence[type[AbstractAttenuation] | None] = (None,),
    *,
    materials: Sequence[Material | str | None] = (None,),
    progress: Progress | None = None,
    **options: Any,
) -> tuple[Comparison, ...]:
    """Fit every law of attenuation with every material, and rank them; the best is first.

    `attenuations` are as `fit` takes them: None for the scene's, or types such as
    `ds.LinearAttenuation`. `materials` are models of reflectance, each with its terms and lobes; None is
    the default, and a name one of `fitting.MODELS`, with its bounds: "phong", "blinn-phong", "lambert",
    "phong2", "ggx", "plastic" or "plastic2". `progress` is called after each fit. All `options` are those
    of `fit`. For independent normal
    noise of one unknown variance

        log L = -n/2 (log(2 pi |r|^2 / n) + 1),   BIC = m log n - 2 log L,

    n observations, r the residual, m free parameters (Schwarz 1978). What a model gets wrong leaves
    residuals that are not independent, so that the BIC of photographs is too sure of the ranking.
    Residuals within rounding count as rounding: of two laws that fit without noise the one with
    fewer constants is first. With `robust`, `noise` or `clipped` |r|^2 is that of the weighted residual.

    Raises `BadInput` as `fit` does, and where nothing is given to compare.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(24, 24, 2.2))
    >>> lights = ds.PointLight((0.5, 0, 2), 1.0, ds.ExponentialAttenuation(0.4))
    >>> image = ds.render(g, ds.Scene(lights=lights), ds.Material(kd=0.6))
    >>> unlike = ds.Scene(lights=ds.PointLight((0.5, 0, 2)))
    >>> matte, laws = ds.Material(kd=0.5), (None, ds.InverseSquare, ds.ExponentialAttenuation)
    >>> compare(image, g, unlike, laws, materials=[matte])[0].name
    'ExponentialAttenuation'
    """
    models = list(product(materials, attenuations))
    if not models:
        raise BadInput("attenuations or materials is empty: give at least one of each to compare")
    rows = []
    given = [scenes] if isinstance(scenes, Scene) else scenes
    ambient = any(scene.ambient is not None for scene in given)
    for model, law in telling(models, len(models), progress):
        own = options
        if isinstance(model, str):
            material: Material | None = named_material(model, ambient=ambient)
            own = options | {"bounds": named_bounds(model) | dict(options.get("bounds") or {})}
        else:
            material = model
        found = fit(images, gbuffer, scenes, material=material, attenuation=law, **own)
        likelihood = found.likelihood
        assert likelihood is not None
        parts = [_law_name(law)] if len(attenuations) > 1 or len(materials) == 1 else []
        if len(materials) > 1:
            parts.insert(0, model if isinstance(model, str) else _material_name(found.material))
        rows.append(
            Comparison(
                ", ".join(parts),
                found,
                likelihood.parameters,
                likelihood.log_likelihood,
                likelihood.bic,
                weight=0.0,
            )
        )
    rows.sort(key=lambda row: row.bic)
    evidence = np.exp([(rows[0].bic - row.bic) / 2 for row in rows])
    weights = (evidence / evidence.sum()).tolist()
    return tuple(replace(row, weight=weight) for row, weight in zip(rows, weights, strict=True))


def _law_name(law: type[AbstractAttenuation] | None) -> str:
    return "attenuation as given" if law is None else law.__name__


def _material_name(material: Material) -> str:
    """Its terms and lobes: "ka + kd + Phong"."""
    terms = [name for name in ("ka", "kd", "body") if getattr(material, name) is not None]
    return " + ".join([*terms, *(type(lobe).__name__ for lobe in material.specular)])
