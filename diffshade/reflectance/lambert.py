"""Lambert's law of diffuse reflection."""

from jaxtyping import Array, Float

from diffshade import guard

__all__ = ["lambert"]


def lambert(n_dot_l: Float[Array, "..."]) -> Float[Array, "..."]:
    """max(0, n.l): the cosine of the angle of incidence (LIGHT-4), 0 where the light is behind.

    The derivative at the terminator n.l = 0 is 0. Multiply by I_p k_d for the radiance; a renderer
    with an albedo rho in radiance units has k_d = rho / pi.
    """
    return guard.positive(n_dot_l)
