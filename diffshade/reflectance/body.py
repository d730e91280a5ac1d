"""The body under a surface: diffuse reflection of light that has passed the boundary twice."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from diffshade.arrays import positive
from diffshade.channels import Channels, channels
from diffshade.reflectance.fresnel import dielectric

__all__ = ["FresnelBody"]

Plane = Float[Array, "..."]


class FresnelBody(eqx.Module):
    """A diffuse body under a smooth clear boundary, as plastic and varnish have: darker at the rim.

        I = I_p k_d n.l T(n.l) T(n.v),   T = 1 - F

    F is that of a `dielectric` of refractive `index`, above 0, usually 1.2 to 1.6: one number, one a
    channel [C], or a map [C or 1, P]. By reciprocity light leaves under the angle by whose T it would
    enter. k_d holds all that does not depend on angles: of a body of albedo rho it is
    rho / (pi index^2 (1 - rho F_i)), with F_i the share that the boundary sends back from inside.

    >>> import jax.numpy as jnp
    >>> round(float(FresnelBody(1.5).passed(jnp.ones(()), jnp.ones(()))[0]), 4)
    0.9216
    """

    index: Float[Array, "..."] = eqx.field(converter=positive("index"), default=1.5)
    kind: ClassVar[str] = "fresnel"

    def passed(self, n_dot_l: Plane, n_dot_v: Plane) -> Channels:
        """T(n.l) T(n.v) for cosines that are not negative: one plane, or one a channel."""
        return tuple(
            (1 - dielectric(n_dot_l, index)) * (1 - dielectric(n_dot_v, index))
            for index in channels(self.index)
        )
