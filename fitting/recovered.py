"""From the unknowns of the search back to coefficients as the texts name them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from diffshade.light.attenuation import QuadraticAttenuation
from diffshade.reflectance.material import Material
from fitting.gauge import ReferenceAttenuation
from fitting.model import Model, coefficient, linear_names, shininess_names

__all__ = ["Recovery", "recover"]

Numbers = Float[Array, "..."]


class Recovery(eqx.Module):
    """How k and u become coefficients; `nearest` is the least distance between surface and light."""

    model: Model
    upper: Float[Array, "C p"]
    nearest: Float[Array, ""] | None

    def material(
        self, k: Float[Array, "C p"], u: Float[Array, "q"]
    ) -> tuple[Material, QuadraticAttenuation | None]:
        """The recovered material, and the attenuation of its lights where one was fitted."""
        material, law = self.model.unpack(u)
        scale = self._scale(k, law)
        if law is None or scale is None:
            return self.model.with_linear(material, k), None
        k = jnp.where(_attenuated(material, k), scale * k, k)
        return self.model.with_linear(material, k), QuadraticAttenuation(*law.constants(scale))

    def coefficients(self, k: Float[Array, "C p"], u: Float[Array, "q"]) -> dict[str, Numbers]:
        """Every coefficient by name; those at the reference distance too."""
        material, law = self.material(k, u)
        names = (*linear_names(material), *shininess_names(material))
        found = {name: coefficient(material, name) for name in names}
        reference = self.model.unpack(u)[1]
        if law is not None and reference is not None:
            found |= {f"attenuation.{name}": getattr(law, name) for name in ("c0", "c1", "c2")}
            shares = zip(("l0", "l1", "l2"), reference.shares, strict=True)
            found |= {f"reference.{name}": share for name, share in shares}
            found |= {
                f"reference.{name}": reference.gain * column
                for name, column in zip(linear_names(material), k.T, strict=True)
                if name != "ka"
            }
        return found

    def exceeds_one(self, u: Float[np.ndarray, "q"]) -> bool:
        """Whether a law whose scale is known passes 1, where LIGHT-12 would clamp it."""
        if self.nearest is None or not self.model.scaled:
            return False
        l0, l1, l2 = (float(l) for l in u[len(self.model.searched) :])
        t = float(self.nearest) / float(self.model.distance)  # type: ignore[arg-type]
        return l0 + t * (l1 + t * l2) < 1 - 1e-6

    def _scale(self, k: Numbers, law: ReferenceAttenuation | None) -> Float[Array, ""] | None:
        """The common scale of c0, c1, c2 and k_d, k_s: known where one of these is held."""
        if law is None or self.nearest is None:
            return None
        if self.model.scaled:
            return jnp.ones_like(law.gain)
        attenuated = _attenuated(self.model.material, k)
        bounded = attenuated & jnp.isfinite(self.upper) & (self.upper > 0)
        shares = jnp.where(bounded, k / jnp.where(bounded, self.upper, 1), 0)
        return law.natural_scale(self.nearest, jnp.max(shares))


def _attenuated(material: Material, k: Float[Array, "C p"]) -> Bool[Array, "C p"]:
    """Which linear coefficients an attenuation multiplies: all but k_a."""
    return jnp.broadcast_to(jnp.array([name != "ka" for name in linear_names(material)]), k.shape)


@jax.jit
def recover(
    recovery: Recovery, k: Float[Array, "C p"], u: Float[Array, "q"]
) -> tuple[Material, QuadraticAttenuation | None, dict[str, Numbers]]:
    """The material, the attenuation, and every coefficient by name."""
    return *recovery.material(k, u), recovery.coefficients(k, u)
