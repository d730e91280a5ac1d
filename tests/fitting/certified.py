"""Fits with one shininess to search, and their residual by another road: dense least squares of SciPy."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear
from truths import draw

import diffshade as ds
from fitting.attempt import attempted, searched
from fitting.inputs import match
from fitting.limits import Bounds, Limits, limits
from fitting.model import default_material, model_of
from fitting.observed import Observed
from fitting.polish import Minimum

GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(32, 32, 2.2))


@dataclass(frozen=True)
class Case:
    """An image of `GBUFFER` and its scene, the minimum that was found, and the limits of u."""

    image: np.ndarray
    scene: ds.Scene
    observed: Observed
    limit: Limits
    minimum: Minimum

    @staticmethod
    def of(
        image: np.ndarray,
        scene: ds.Scene,
        start: ds.Material,
        bounds: Bounds | None = None,
        hold: frozenset[str] = frozenset(),
    ) -> "Case":
        """The fit of an image, all of `start` unknown but for what `hold` names in full."""
        observed = Observed(match(image, GBUFFER, scene, None))
        model = model_of(start, hold, image.shape[2])
        limit = limits(model, hold, start, bounds or {}, start_given=True)
        basins = searched(observed, model, limit, None, None)
        found = attempted(observed, model, limit, basins, None, gains=False)
        return Case(image, scene, observed, limit, found.minimum)


def case(rng: np.random.Generator, *, light_count: int, noise: float) -> Case:
    """A random truth under lights of known attenuation; noise in units of the image's maximum."""
    truth = draw(rng, light_count, attenuated=False)
    image = np.asarray(ds.render(GBUFFER, truth.scene, truth.material))
    noise = rng.normal(0, noise * image.max(), image.shape) if noise else np.zeros(image.shape)
    image = image + (noise * GBUFFER.mask[..., None]).astype(image.dtype)
    return Case.of(image, truth.scene, default_material([truth.scene]))


def dense_residual(case: Case, shininess: float) -> float:
    """The relative residual at a shininess, of the best linear coefficients within their bounds."""
    problem = case.minimum.problem
    fitted = problem.model.material
    columns = [
        *([ds.Material(ka=1.0)] if fitted.ka is not None else []),
        *([ds.Material(kd=1.0)] if fitted.kd is not None else []),
        ds.Material(specular=ds.Phong(ks=1.0, shininess=float(shininess))),
    ]
    planes = [np.asarray(ds.render(GBUFFER, case.scene, m), float)[GBUFFER.mask] for m in columns]
    observed = case.image[GBUFFER.mask].astype(float)
    square = 0.0
    for c in range(observed.shape[1]):
        matrix = np.stack([plane[:, min(c, plane.shape[1] - 1)] for plane in planes], axis=1)
        edges = problem.lower[c], problem.upper[c]
        solved = lsq_linear(matrix, observed[:, c], edges, method="bvls", tol=1e-14)
        square += 2 * solved.cost
    return float(np.sqrt(square) / np.linalg.norm(observed))
