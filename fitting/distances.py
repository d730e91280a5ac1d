"""How far the lit points of a capture lie from its lights: the unit of an attenuation that is fitted."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from diffshade.light.point import PointLight
from diffshade.shading.one_light import Angles
from fitting.arrays import Array
from fitting.columns import Photo, photos, scenery
from fitting.model import Model
from fitting.observation import Group
from fitting.pages import Pages

__all__ = ["sample_distances", "share_nearer"]


def sample_distances(group: Group) -> Float[np.ndarray, "n"]:
    """The logarithm of the distance between each used point and each point light that it faces."""
    lights = [kind for kind in group.lights if isinstance(kind, PointLight)]
    surface = group.surface
    if not lights or surface.position is None:
        return np.zeros(0)
    here, normal = (
        np.stack([np.asarray(axis) for axis in (v.x, v.y, v.z)])
        for v in (surface.position, surface.normal)
    )
    lights_at = np.concatenate([np.asarray(kind.position) for kind in lights], axis=1)
    towards = lights_at[..., None] - here  # [K, L, 3, S]
    facing = np.einsum("klis,is->kls", towards, normal) > 0
    if surface.spread is None:  # else points are not pixels, and have no weight
        facing &= (np.asarray(group.weight) > 0)[:, None]
    square = np.einsum("klis,klis->kls", towards, towards)
    return 0.5 * np.log(square[facing & (square > 0)])


def share_nearer(pages: Pages, model: Model, limit: float) -> float:
    """The share of all pairs of a light and a point that it lights that are nearer than `limit`."""
    (lit, near), _ = pages.total(_nearer, None, model, np.asarray(limit))
    return float(near.sum() / max(lit.sum(), 1.0))


def _nearer(
    group: Group, gains: None, model: Model, limit: Float[Array, ""]
) -> tuple[tuple[Array, Array], Array]:
    """How many pairs there are in each image, and how many are nearer."""

    def of_image(photo: Photo) -> tuple[Array, Array]:
        lit = near = jnp.zeros(())
        at = scenery(photo, group.surface, model.material)
        for seen in at.angles:
            if isinstance(seen, Angles) and seen.distance is not None:
                faces = (seen.n_dot_l > 0) & (seen.distance > 0)
                if seen.emission is not None:
                    faces = faces & (seen.emission > 0)
                if at.spread is None:
                    faces = faces & (photo.weight > 0)[None]
                lit += jnp.sum(faces, dtype=lit.dtype)
                near += jnp.sum(faces & (seen.distance < limit), dtype=near.dtype)
        return lit, near

    return jax.lax.map(of_image, photos(group, gains)), jnp.zeros(())
