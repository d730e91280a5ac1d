"""From the unknowns of the search back to coefficients as the texts name them."""

from dataclasses import dataclass, fields

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from diffshade.light.attenuation import AbstractAttenuation
from diffshade.reflectance.material import Material
from diffshade.reflectance.names import coefficient
from fitting.arrays import Array
from fitting.gauge import PolynomialGauge
from fitting.model import Model, linear_names
from fitting.shapes import shape_names

__all__ = ["Recovery", "clamped_within"]

Numbers = Float[Array, "..."]


@dataclass(frozen=True, eq=False)
class Recovery:
    """How k and u become coefficients.

    `upper` are the bounds that the linear ones have once their scale is set, `nearest` the least
    distance between a surface and a light whose attenuation is fitted.
    """

    model: Model
    upper: Float[np.ndarray, "C p"]
    nearest: float

    def coefficients(
        self, k: Float[np.ndarray, "*n C p"], u: Float[np.ndarray, "*n q"]
    ) -> dict[str, Numbers]:
        """Every coefficient by name, [*n, C] or [*n]; those at the reference distance too."""
        model, gauge = self.model, self.model.gauge
        names = linear_names(model.material)
        scale = self._scale(k, u)
        found = {
            name: k[..., i] * (scale[..., None] if self._attenuated[i] else 1)
            for i, name in enumerate(names)
        }
        unknown = {name: k for k, names in enumerate(model.searched) for name in names}
        for name in shape_names(model.material):
            if name in unknown:
                found[name] = np.exp(u[..., unknown[name]])
            else:
                value = np.asarray(coefficient(model.material, name), float)
                found[name] = np.broadcast_to(value, (*u.shape[:-1], *value.shape))
        if gauge is None:
            return found
        v = u[..., len(model.searched) :]
        constants = zip(fields(gauge.kind), gauge.constants(v, scale), strict=True)
        found |= {f"attenuation.{field.name}": value for field, value in constants}
        if not isinstance(gauge, PolynomialGauge):
            return found
        found |= {f"reference.l{number}": share for number, share in enumerate(gauge.shares(v))}
        f = gauge.at_reference(v)
        return found | {
            f"reference.{name}": f[..., None] * k[..., i]
            for i, name in enumerate(names)
            if self._attenuated[i]
        }

    def ranges(
        self, lower: Float[np.ndarray, "C p"], upper: Float[np.ndarray, "C p"]
    ) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Within which values each coefficient lies that has more than its unknown's bounds.

        `lower` and `upper` bound k. No scale of the law moves a bound of 0, or one that is infinite;
        others of what it multiplies are none of the coefficient's. Constants and shares are not
        negative, and shares at most 1.
        """
        gauge = self.model.gauge
        if gauge is None:
            return {}
        found = {}
        for i, name in enumerate(linear_names(self.model.material)):
            if self._attenuated[i]:
                low = np.where(lower[:, i] == 0, 0.0, -np.inf)
                high = np.where(upper[:, i] == 0, 0.0, np.inf)
                found[name] = found[f"reference.{name}"] = low, high
        zero, one, endless = np.zeros(1), np.ones(1), np.full(1, np.inf)
        found |= {f"attenuation.{field.name}": (zero, endless) for field in fields(gauge.kind)}
        if gauge.has_shares:
            found |= {f"reference.l{number}": (zero, one) for number in range(gauge.size)}
        return found

    def material(
        self, k: Float[np.ndarray, "C p"], u: Float[np.ndarray, "q"], dtype: np.dtype
    ) -> Material:
        """The recovered material, in a precision."""
        values, model = self.coefficients(k, u), self.model
        shapes = [name for names in model.searched for name in names]
        names = (*linear_names(model.material), *shapes)
        return eqx.tree_at(
            lambda material: [coefficient(material, name) for name in names],
            model.material,
            [jnp.asarray(values[name], dtype) for name in names],
        )

    def law(
        self, k: Float[np.ndarray, "C p"], u: Float[np.ndarray, "q"], dtype: np.dtype
    ) -> AbstractAttenuation | None:
        """The attenuation, where one was fitted."""
        gauge = self.model.gauge
        if gauge is None:
            return None
        constants = gauge.constants(u[len(self.model.searched) :], self._scale(k, u))
        return gauge.kind(*(jnp.asarray(value, dtype) for value in constants))

    @property
    def _attenuated(self) -> tuple[bool, ...]:
        """Which linear coefficients an attenuation multiplies: all but k_a."""
        return self.model.lit

    def _scale(self, k: Numbers, u: Numbers) -> Numbers:
        """The common scale of the law's constants and k_d, k_s, where nothing tells it; else 1."""
        gauge = self.model.gauge
        if not isinstance(gauge, PolynomialGauge) or not gauge.floating:
            return np.ones(u.shape[:-1])
        bounded = np.array(self._attenuated) & np.isfinite(self.upper) & (self.upper > 0)
        shares = np.where(bounded, k / np.where(bounded, self.upper, 1), 0)
        v = u[..., len(self.model.searched) :]
        return gauge.natural_scale(v, self.nearest, shares.max(axis=(-1, -2), initial=0))


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
