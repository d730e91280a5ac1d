"""Levenberg-Marquardt under bounds, built of Optimistix's parts.

Optimistix's own solvers know no bounds, damp by the unscaled identity, and enlarge their step only on
an almost perfect prediction. Here the descent takes the best step inside the box, damped in proportion to
the curvature (Marquardt), and the search grows and shrinks its step faster.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float, PyTree, Scalar

from fitting.linear import damped_step

__all__ = ["BoundedLevenbergMarquardt"]

Vector = Float[Array, "q"]
Tolerance = float | Float[Array, ""]


class _DescentState(eqx.Module):
    y: Vector
    hessian: Float[Array, "q q"]
    gradient: Vector


class BoundedDampedDescent(optx.AbstractDescent[Vector, Any, _DescentState]):
    """The step d that minimises |J d + r|^2 + |sqrt(D) d|^2 / step_size with y + d in the box, exactly.

    D is the diagonal of J'J (Marquardt), so the damping has the units of each unknown.
    """

    lower: Vector
    upper: Vector

    def init(self, y: Vector, f_info_struct: Any) -> _DescentState:
        del f_info_struct
        return _DescentState(y, jnp.zeros((y.size, y.size), y.dtype), jnp.zeros_like(y))

    def query(self, y: Vector, f_info: Any, state: _DescentState) -> _DescentState:
        del state
        columns = jax.vmap(f_info.jac.mv, out_axes=1)(jnp.eye(y.size, dtype=y.dtype))
        return _DescentState(y, columns.T @ columns, columns.T @ f_info.residual)

    def step(self, step_size: Scalar, state: _DescentState) -> tuple[Vector, optx.RESULTS]:
        y, hessian, gradient = state.y, state.hessian, state.gradient
        info = jnp.finfo(y.dtype)
        # Never so little that a singular matrix could not be factorised.
        least = 2 * y.size * float(info.eps)
        damping = jnp.maximum(1 / jnp.maximum(step_size, float(info.tiny) ** 0.5), least)
        lower, upper = self.lower - y, self.upper - y
        step = damped_step(hessian, -gradient, damping, lower, upper)
        return step, optx.RESULTS.successful  # type: ignore[return-value]


class _TrustRegion(optx.ClassicalTrustRegion):
    """A trust region that starts wide, 1 / step_size being the damping, and ends at rounding.

    A step whose loss differs from the last by no more than rounding is accepted, with a smaller one
    to follow: otherwise a search that has arrived would reject its own noise until its steps run out.
    """

    first_step_size: Tolerance = 100.0

    def init(self, y: PyTree, f_info_struct: Any) -> Any:
        state = super().init(y, f_info_struct)
        first = jnp.asarray(self.first_step_size, y.dtype)
        return eqx.tree_at(lambda s: s.step_size, state, first)

    def step(
        self,
        first_step: Any,
        y: PyTree,
        y_eval: PyTree,
        f_info: Any,
        f_eval_info: Any,
        state: Any,
    ) -> Any:
        step_size, accept, result, state = super().step(
            first_step, y, y_eval, f_info, f_eval_info, state
        )
        loss, loss_eval = f_info.as_min(), f_eval_info.as_min()
        rounding = 16 * jnp.finfo(loss.dtype).eps * loss
        return step_size, accept | (loss_eval <= loss + rounding), result, state


class BoundedLevenbergMarquardt(optx.AbstractGaussNewton):
    """Minimise |r(y)|^2 over a box, lower <= y <= upper, by `optimistix.least_squares`.

    Every iterate lies in the box. `y` is one flat vector. Converges to the constrained minimum, also
    where some bounds are active, which clipping after an unconstrained step does not. `damping` is
    that of the first step, in parts of each unknown's curvature.
    """

    rtol: Tolerance  # type: ignore[assignment]
    atol: Tolerance  # type: ignore[assignment]
    norm: Callable[[PyTree], Scalar]
    descent: BoundedDampedDescent
    search: _TrustRegion
    verbose: Callable[..., None]

    def __init__(
        self,
        rtol: Tolerance,
        atol: Tolerance,
        lower: Vector,
        upper: Vector,
        *,
        damping: Tolerance = 0.01,
    ) -> None:
        self.rtol = rtol
        self.atol = atol
        self.norm = optx.max_norm
        self.descent = BoundedDampedDescent(lower, upper)
        self.search = _TrustRegion(
            high_cutoff=0.75,
            low_cutoff=1e-3,
            high_constant=8.0,
            low_constant=0.2,
            first_step_size=1 / damping,
        )
        self.verbose = _silent


def _silent(**_: Any) -> None:
    pass
