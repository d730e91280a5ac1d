"""Random truths for fits, what an image can tell of each, and how far a fit is from one.

The images are made and the Cramer-Rao bounds computed by `plain_phong`, in float64, independently
of the package. What is compared are the coefficients that an image measures, those at the reference
distance d0: k_a, n, k_d f(d0), k_s f(d0), and l0, l1, l2 of f(d0) / f(d) = l0 + l1 d/d0 + l2 (d/d0)^2.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import diffshade as ds
from benchmarks import numpy_shading
from benchmarks.plain_phong import Terms, predict, terms

__all__ = [
    "BOUNDARIES",
    "Ball",
    "Truth",
    "ball",
    "draw",
    "errors",
    "magnitude",
    "observe",
    "reported",
    "scene",
    "standard_errors",
    "terms_of",
]

BOUNDARIES = ("inner", "c1 = 0", "c2 = 0", "c1 = c2 = 0", "ks = 0")
EXTENT = 2.2
"""World units across the image of a ball of radius 1."""

Named = dict[str, np.ndarray]


class Truth(NamedTuple):
    """A material and its lights, of C channels and L lights; I_a = 1 and c0 = 1."""

    ka: np.ndarray  # [C]
    kd: np.ndarray  # [C]
    ks: np.ndarray  # [C]
    shininess: float
    c1: float
    c2: float
    positions: np.ndarray  # [L, 3]
    intensities: np.ndarray  # [L, C]

    @property
    def unknowns(self) -> np.ndarray:
        """The flat vector of `plain_phong`."""
        return np.concatenate([self.ka, self.kd, self.ks, [self.shininess, self.c1, self.c2]])


class Ball(NamedTuple):
    """A unit ball seen from afar: the package's G-buffer, and the same points in float64."""

    gbuffer: ds.GBuffer
    points: np.ndarray  # [P, 3], which are the normals too
    inside: np.ndarray  # [H, W]


def ball(size: int) -> Ball:
    """A ball on size x size pixels, in the precision that JAX runs in."""
    camera = ds.OrthographicCamera(width=size, height=size, extent=EXTENT)
    gbuffer = ds.gbuffer(ds.Sphere(), camera)
    points, inside = numpy_shading.points(size, EXTENT, np.float64)
    assert np.array_equal(inside, gbuffer.mask), "the two disagree on which pixels are foreground"
    return Ball(gbuffer, points, inside)


def draw(rng: np.random.Generator, *, lights: int, channels: int, boundary: str = "inner") -> Truth:
    """n from 2 to 400 and k_s from 0.02 to 0.9, both log-uniform; lights 1.8 to 5 radii away."""

    def log_uniform(low: float, high: float, size: int | None = None) -> Any:
        return np.exp(rng.uniform(np.log(low), np.log(high), size))

    height, azimuth = rng.uniform(0.3, 1, lights), rng.uniform(0, 2 * np.pi, lights)
    across = np.sqrt(1 - height**2)
    direction = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), height], axis=-1)
    truth = Truth(
        ka=rng.uniform(0.03, 0.3, channels),
        kd=rng.uniform(0.1, 0.9, channels),
        ks=log_uniform(0.02, 0.9, channels),
        shininess=float(log_uniform(2, 400)),
        c1=float(rng.uniform(0.02, 0.5)),
        c2=float(rng.uniform(0.01, 0.3)),
        positions=direction * rng.uniform(1.8, 5, (lights, 1)),
        intensities=rng.uniform(0.7, 1.5, (lights, channels)),
    )
    match boundary:
        case "c1 = 0":
            return truth._replace(c1=0.0)
        case "c2 = 0":
            return truth._replace(c2=0.0)
        case "c1 = c2 = 0":
            return truth._replace(c1=0.0, c2=0.0)
        case "ks = 0":
            return truth._replace(ks=np.zeros(channels))
    assert boundary == "inner"
    return truth


def scene(truth: Truth) -> ds.Scene:
    """What a fit is told: ambient light, and the lights without their attenuation."""
    lights = zip(truth.positions, truth.intensities, strict=True)
    return ds.Scene(ambient=1.0, lights=tuple(ds.PointLight(*light) for light in lights))


def terms_of(truth: Truth, points: np.ndarray) -> Terms:
    """The geometry of a truth's lights over points of the unit ball, in JAX's precision."""
    plane = jnp.asarray(points.T)
    return terms(plane, plane, jnp.asarray(truth.positions), jnp.asarray(truth.intensities))


def observe(truth: Truth, ball: Ball) -> np.ndarray:
    """The exact image [H, W, C], float64."""
    with jax.enable_x64(True):
        at = terms_of(truth, ball.points)
        planes = np.asarray(_predict(jnp.asarray(truth.unknowns), at))
    image = np.zeros((*ball.inside.shape, truth.ka.size))
    image[ball.inside] = planes.reshape(truth.ka.size, -1).T
    return image


def reported(unknowns: Any, d0: float) -> dict[str, Any]:
    """The coefficients at the reference distance, by the names that `fitting.Fit` gives them."""
    ka, kd, ks = unknowns[:-3].reshape(3, -1)
    n, c1, c2 = unknowns[-3:]
    f = 1 / (1 + c1 * d0 + c2 * d0**2)
    return {
        "ka": ka,
        "specular.0.shininess": n,
        "reference.kd": f * kd,
        "reference.specular.0.ks": f * ks,
        "reference.l0": f,
        "reference.l1": f * c1 * d0,
        "reference.l2": f * c2 * d0**2,
    }


def errors(found: Mapping[str, Any], truth: Truth, d0: float) -> Named:
    """How far `found` is from the truth, relative to `magnitude`."""
    true = reported(truth.unknowns, d0)
    return {
        name: np.abs(np.asarray(found[name]) - true[name]) / magnitude(name, true) for name in true
    }


def magnitude(name: str, true: Mapping[str, Any]) -> np.ndarray:
    """What an error is relative to: the coefficient, 1 for the shares l, whose sum that is.

    For a k_s of 0 it is the largest of the linear coefficients.
    """
    if name in ("reference.l0", "reference.l1", "reference.l2"):
        return np.ones(())
    largest = max(np.max(true[k]) for k in ("ka", "reference.kd", "reference.specular.0.ks"))
    return np.where(true[name] == 0, largest, true[name])


def standard_errors(truth: Truth, ball: Ball, d0: float, weight: np.ndarray | None = None) -> Named:
    """The Cramer-Rao bound for noise of standard deviation 1, absolute, by coefficient.

    `weight` [P * C, channel after channel] is the information of each observation where it is not 1.
    Infinite for what the image does not tell: n where k_s = 0, which is then left out.
    """
    with jax.enable_x64(True):
        unknowns = jnp.asarray(truth.unknowns)
        columns = np.asarray(_derivatives(unknowns, terms_of(truth, ball.points)))
        rows = {
            k: np.asarray(v) for k, v in jax.jacfwd(lambda x: reported(x, d0))(unknowns).items()
        }
    if weight is not None:
        columns = columns * np.sqrt(weight)[:, None]
    norm = np.linalg.norm(columns, axis=0)
    dead = norm == 0
    scale = np.where(dead, 1, norm)
    _, singular, directions = np.linalg.svd((columns / scale)[:, ~dead], full_matrices=False)
    null = singular < 1e-10 * singular[0]
    bounds = {}
    for name, row in rows.items():
        along = (row / scale)[..., ~dead] @ directions.T
        with np.errstate(divide="ignore"):
            bound = np.linalg.norm(along[..., ~null] / singular[~null], axis=-1)
        blind = (row[..., dead] != 0).any(-1) | (np.abs(along[..., null]) > 1e-6).any(-1)
        bounds[name] = np.where(blind, np.inf, bound)
    return bounds


_predict = jax.jit(predict)
_derivatives = jax.jit(jax.jacfwd(predict))
