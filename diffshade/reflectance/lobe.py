"""What every specular lobe is: a coefficient k_s and a shape over directions."""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.bounds import Cone
from diffshade.channels import Channels
from diffshade.vector import Vec3, dot, versine

__all__ = ["AbstractLobe", "log_cosine"]

Plane = Float[Array, "..."]


class AbstractLobe(eqx.Module):
    """A specular term k_s s(n, l, v). The radiance is linear in k_s; the shape s holds the rest.

    `convex` says that s is not negative, and falls and is convex in the one coefficient of the lobe
    that fitting searches, for all directions: a power x^n of 0 <= x <= 1 is. What was fitted can then
    be proven to be the best.
    """

    kind: eqx.AbstractClassVar[str]
    convex: eqx.AbstractClassVar[bool]
    ks: eqx.AbstractVar[Float[Array, "..."]]

    @abstractmethod
    def angles(self, n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane) -> Plane:
        """What s needs of the unit vectors n, l, v: the same for every coefficient of the lobe.

        A search over the coefficients computes it once. Written for planes: no `jit`, `vmap` or loop
        around the functions of `guard` and `vector`.
        """

    @abstractmethod
    def at(self, angles: Plane) -> tuple[Plane, ...]:
        """s from `angles`: one plane, or one a channel; 0 where n.l <= 0."""

    def most(self, n: Cone, l: Cone, v: Cone) -> Plane | None:
        """The largest s for n, l, v in cones; None, the default, where it is not known."""
        return None

    def filtered(self, bands: tuple[Channels, ...]) -> Channels | None:
        """The integral of L(w) s over all directions w of light, from the degrees of L in a direction.

        `bands` holds sum over m of L_lm Y_lm(r), for each l, where the viewer is mirrored to: one plane,
        or one a channel. None, the default, of a lobe that is not the same all around r.
        """
        return None

    def shape(self, n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane) -> tuple[Plane, ...]:
        """s for unit vectors n, l, v: one plane, or one a channel; 0 where n.l <= 0."""
        return self.at(self.angles(n, l, v, n_dot_l))


def log_cosine(a: Vec3, b: Vec3, n_dot_l: Plane) -> Plane:
    """log(a.b) of unit vectors, from 1 - a.b = |a - b|^2 / 2, which loses nothing where they meet.

    Minus infinity where the lobe is dark: the light behind the surface, or b = 0.
    """
    dark = (n_dot_l <= 0) | (dot(b, b) == 0)
    return guard.log_one_minus(jnp.where(dark, 1, versine(a, b)))
