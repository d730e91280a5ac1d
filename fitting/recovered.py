"""From the unknowns of the search back to coefficients as the texts name them."""

from dataclasses import fields

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from diffshade.light.attenuation import AbstractAttenuation, QuadraticAttenuation
from diffshade.reflectance.material import Material
from fitting.gauge import CONSTANTS, PolynomialGauge, ReferenceAttenuation
from fitting.model import Model, coefficient, linear_names, shininess_names

__all__ = ["Recovery", "clamped_within", "recover"]

Numbers = Float[Array, "..."]


class Recovery(eqx.Module):
    """How k and u become coefficients; `nearest` is the least distance between surface and light."""

    model: Model
    upper: Float[Array, "C p"]
    nearest: Float[Array, ""] | None

    def material(
        self, k: Float[Array, "C p"], u: Float[Array, "q"]
    ) -> tuple[Material, AbstractAttenuation | None]:
        """The recovered material, and the attenuation of its lights where one was fitted."""
        material, law = self.model.unpack(u)
        if self.model.gauge is None or law is None:
            return self.model.with_linear(material, k), None
        scale = self._scale(k, law)
        k = jnp.where(_attenuated(material, k), scale * k, k)
        return (
            self.model.with_linear(material, k),
            self.model.gauge.reported(self.model.of_law(u), scale),
        )

    def coefficients(self, k: Float[Array, "C p"], u: Float[Array, "q"]) -> dict[str, Numbers]:
        """Every coefficient by name; those at the reference distance too."""
        material, law = self.material(k, u)
        names = (*linear_names(material), *shininess_names(material))
        found = {name: coefficient(material, name) for name in names}
        gauge, fitted = self.model.gauge, self.model.unpack(u)[1]
        if gauge is None or fitted is None:
            return found
        found |= {f"attenuation.{f.name}": getattr(law, f.name) for f in fields(type(law))}  # type: ignore[arg-type]
        shares = gauge.shares(self.model.of_law(u))
        if not shares:
            return found
        at_reference = fitted(gauge.distance)
        return (
            found
            | {f"reference.l{number}": share for number, share in enumerate(shares)}
            | {
                f"reference.{name}": at_reference * column
                for name, column in zip(linear_names(material), k.T, strict=True)
                if name != "ka"
            }
        )

    def _scale(self, k: Numbers, law: AbstractAttenuation) -> Float[Array, ""]:
        """The common scale of the law's constants and k_d, k_s, where nothing tells it; else 1."""
        assert self.model.gauge is not None
        assert self.nearest is not None
        if not self.model.gauge.floating:
            return jnp.ones_like(self.nearest)
        assert isinstance(law, ReferenceAttenuation)
        attenuated = _attenuated(self.model.material, k)
        bounded = attenuated & jnp.isfinite(self.upper) & (self.upper > 0)
        shares = jnp.where(bounded, k / jnp.where(bounded, self.upper, 1), 0)
        limited = len(law.l) == len(CONSTANTS[QuadraticAttenuation])  # no other law has a clamp
        least = law(self.nearest) if limited else jnp.zeros_like(self.nearest)
        return law.natural_scale(least, jnp.max(shares))


def _attenuated(material: Material, k: Float[Array, "C p"]) -> Bool[Array, "C p"]:
    """Which linear coefficients an attenuation multiplies: all but k_a."""
    return jnp.broadcast_to(jnp.array([name != "ka" for name in linear_names(material)]), k.shape)


def clamped_within(model: Model, u: Float[np.ndarray, "q"]) -> float:
    """The distance under which the fitted law is clamped at f = 1; 0 where none is."""
    gauge = model.gauge
    if not isinstance(gauge, PolynomialGauge) or not gauge.clamped:
        return 0.0
    l0, *rest = (float(l) for l in u[len(model.searched) :])
    if l0 >= 1:
        return 0.0
    roots = np.roots([*reversed(rest), l0 - 1])  # 1/f is 1 at one t > 0, as no l is negative
    ahead = roots[(np.imag(roots) == 0) & (np.real(roots) > 0)].real
    return float(ahead[0]) * float(gauge.distance) if ahead.size else np.inf


@jax.jit
def recover(
    recovery: Recovery, k: Float[Array, "C p"], u: Float[Array, "q"]
) -> tuple[Material, AbstractAttenuation | None, dict[str, Numbers]]:
    """The material, the attenuation, and every coefficient by name."""
    return *recovery.material(k, u), recovery.coefficients(k, u)
