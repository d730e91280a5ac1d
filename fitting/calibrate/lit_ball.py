"""A ball whose place is nearly known, and lamps on rays that are nearly known: the model of both.

The unknowns theta are those that all images share, k, the three numbers of the ball's outline in pixels
(right, up, out) and the shapes u of the lobes; then for each image's lamp the tangents of two angles
across its ray and the logarithm of the distance along it, relative to where it starts. A pixel moves a
ball of radius R at the distance D by D / f across the line of sight; one of radius moves it by D / r
along it, r = f R / D being that of the outline, f the focal length in pixels.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from diffshade.errors import BadInput
from diffshade.geometry.camera import PerspectiveCamera
from diffshade.geometry.sphere import Sphere
from diffshade.geometry.surface import Visibility
from diffshade.geometry.view import gbuffer, visibility
from fitting.arrays import Array
from fitting.columns import Photo, predict, scenery
from fitting.model import Model

__all__ = [
    "OF_LAMP",
    "OUTLINE",
    "LitBall",
    "Pulls",
    "moves_of",
    "pulls",
    "well_inside",
]

RIM = 0.95
"""Of the outline's radius: pixels beyond are not looked at, as they are partly background."""
KNOTS = 16
"""Levels at which the codes of a channel may be off, each alone; between them linearly."""
FULL = 255
"""The largest code."""
OUTLINE, OF_LAMP = 3, 3
"""Numbers of the ball, and of each lamp."""


class Pulls(eqx.Module):
    """Of each image, in the shared unknowns and its own lamp's; J is the derivative of the residual r.

    `gram` is J'J, `blocks` what each block adds to J'r, `square` r'r, `codes` what an error of one
    code at each knot of each channel would add to J'r.
    """

    gram: Float[Array, "*K n n"]
    blocks: Float[Array, "*K B n"]
    square: Float[Array, "*K"]
    codes: Float[Array, "*K s n"] | None


class LitBall(eqx.Module):
    """Photographs at some pixels of a ball, and where ball and lamps are when their unknowns are 0.

    `moves` are what the centre moves by for each number of the outline; `rays` the direction of
    each image's lamp and two across it, from `points`, `distances` how far along it the lamp is;
    `levels` the radiance of codes at equal distances, where codes may be off.
    """

    index: Int[Array, "P"]
    block: Int[Array, "P"]
    photos: Photo
    model: Model
    camera: PerspectiveCamera
    ball: Sphere
    moves: Float[Array, "3 3"]
    points: Float[Array, "K 3"]
    rays: Float[Array, "K 3 3"]
    distances: Float[Array, "K"]
    levels: Float[Array, "t"] | None
    blocks: int = eqx.field(static=True)

    @property
    def linear(self) -> int:
        """How many numbers k has."""
        return self.model.channel_count * self.model.column_count

    @property
    def shared(self) -> int:
        """How many unknowns all images have in common."""
        return self.linear + OUTLINE + self.model.size

    def k(self, theta: Float[Array, "n"]) -> Float[Array, "C p"]:
        """The linear coefficients."""
        return theta[: self.linear].reshape(self.model.channel_count, -1)

    def u(self, theta: Float[Array, "n"]) -> Float[Array, "q"]:
        """The shapes."""
        return theta[self.linear + OUTLINE : self.shared]

    def sphere(self, theta: Float[Array, "n"]) -> Sphere:
        """The ball."""
        outline = theta[self.linear : self.linear + OUTLINE]
        return Sphere(self.ball.center + outline @ self.moves, self.ball.radius)

    def positions(self, theta: Float[Array, "n"]) -> Float[Array, "K 3"]:
        """Of all lamps."""
        of_lamps = theta[self.shared :].reshape(-1, OF_LAMP)
        return jax.vmap(_position)(self.points, self.rays, self.distances, of_lamps)


def _position(
    point: Float[Array, "3"],
    ray: Float[Array, "3 3"],
    distance: Float[Array, ""],
    moved: Float[Array, "3"],
) -> Float[Array, "3"]:
    l, first, second = ray
    return point + distance * jnp.exp(moved[2]) * (l + moved[0] * first + moved[1] * second)


def well_inside(sphere: Sphere, camera: PerspectiveCamera) -> Visibility:
    """Those that see the ball well within its outline, where sin(angle to its centre) = R / D."""
    seen = visibility(sphere, camera)
    towards = np.asarray(sphere.center, float) - np.asarray(camera.position, float)
    towards = towards / np.linalg.norm(towards)
    d = np.asarray(camera.rays(seen.index).direction.to_array(), float)
    away = np.linalg.norm(np.cross(d, towards), axis=-1)
    inside = away < RIM * away.max(initial=0)
    if not inside.any():
        raise BadInput("the camera sees nothing of the ball: correct its place")
    return Visibility(seen.shape, seen.index[inside])


def moves_of(sphere: Sphere, camera: PerspectiveCamera) -> tuple[Float[np.ndarray, "3 3"], float]:
    """What the centre moves by as the outline moves right, up, and out by a pixel; its radius."""
    away = np.asarray(sphere.center, float) - np.asarray(camera.position, float)
    distance = float(np.linalg.norm(away))
    right, up = (np.asarray(axis.to_array(), float) for axis in camera.axes()[:2])
    focal = camera.height / (2 * np.tan(float(camera.fov) / 2))
    radius = focal * float(sphere.radius) / distance
    across = np.stack([right, up])
    across -= np.outer(across @ away, away) / distance**2
    return np.append(across * distance / focal, -away[None] / radius, axis=0), radius


@eqx.filter_jit
def pulls(seen: LitBall, theta: Float[Array, "n"]) -> Pulls:
    """What tells a step and its errors, of the residual r = observed - predicted."""
    shape = (seen.camera.height, seen.camera.width)

    def of_image(one: tuple[Any, ...]) -> Pulls:
        photo, point, ray, distance, lamp = one

        def image(local: Float[Array, "n"]) -> Float[Array, "C P"]:
            surface = gbuffer(seen.sphere(local), seen.camera, Visibility(shape, seen.index))
            there = _position(point, ray, distance, local[seen.shared :])
            light: Any = photo.lights[0]
            lit = eqx.tree_at(
                lambda p: p.lights[0].position, photo, there.reshape(light.position.shape)
            )
            at = scenery(lit, surface, seen.model.material)
            return jnp.stack(predict(seen.model.columns(seen.u(local), at), seen.k(local)))

        local = jnp.concatenate([theta[: seen.shared], lamp])
        predicted, push = jax.linearize(image, local)
        residual = (photo.observed - predicted) * photo.weight[None]
        jacobian = (
            -jax.vmap(push)(jnp.eye(local.size, dtype=local.dtype)) * photo.weight[None, None]
        )
        codes = None
        if seen.levels is not None:
            off = _hats(seen.levels, predicted) * photo.weight[None, None]
            codes = jnp.einsum("jcp,mcp->cjm", off, jacobian).reshape(-1, local.size)
        each = jnp.einsum("mcp,cp->pm", jacobian, residual)
        return Pulls(
            jnp.einsum("mcp,ncp->mn", jacobian, jacobian),
            jax.ops.segment_sum(each, seen.block, seen.blocks),
            jnp.sum(residual**2),
            codes,
        )

    lamps = theta[seen.shared :].reshape(-1, OF_LAMP)
    images = (seen.photos, seen.points, seen.rays, seen.distances, lamps)
    return jax.lax.map(of_image, images)


def _hats(levels: Float[Array, "t"], radiance: Float[Array, "C P"]) -> Float[Array, "j C P"]:
    """What an error of one code at each knot adds to the radiance, linear between knots."""
    last = len(levels) - 1
    at = jnp.arange(last + 1, dtype=levels.dtype)
    level = jnp.interp(radiance, levels, at)
    knots = np.arange(KNOTS, dtype=levels.dtype) * (last / (KNOTS - 1))
    away = jnp.abs(level[None] - knots[:, None, None]) * ((KNOTS - 1) / last)
    code: Any = jnp.gradient(levels, FULL / last)
    return jnp.maximum(1 - away, 0) * jnp.interp(level, at, code)[None]
