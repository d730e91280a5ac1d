"""Forms of Phong's lobe: what each is off in a render of a large exponent, and what it takes."""

import statistics
import time
from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

import diffshade as ds
from benchmarks import renders
from diffshade import guard
from diffshade.arrays import coefficients, positive
from diffshade.channels import channels
from diffshade.fusion import Node
from diffshade.reflectance.lobe import AbstractLobe, log_cosine
from diffshade.shading.image import image_planes
from diffshade.shading.kept_geometry import KeptGeometry
from diffshade.vector import Vec3, dot, reflect, versine

__all__ = ["FORMS", "table"]

Plane = Float[Array, "..."]
Form = Callable[[Vec3, Vec3, Vec3, Plane], Plane]
"""log(r.v) of n, l, v and n.l, minus infinity where the lobe is dark."""


def of_dot(n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane) -> Plane:
    """The logarithm of r.v as it stands."""
    return guard.log_base(jnp.where(n_dot_l <= 0, 0, dot(reflect(l, n), v)))


def of_unit_lengths(n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane) -> Plane:
    """The same over |r| |v|, which rounding keeps from being 1."""
    r = reflect(l, n)
    c = jnp.where(n_dot_l <= 0, 0, dot(r, v))
    return guard.log_base(c * guard.reciprocal_sqrt(dot(r, r) * dot(v, v)))


def _versine(n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane) -> Plane:
    dark = (n_dot_l <= 0) | (dot(v, v) == 0)
    return jnp.where(dark, 1, versine(reflect(l, n), v))


def of_rest(n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane) -> Plane:
    """log(1 - |r - v|^2 / 2), with 1 - ... rounded."""
    return guard.log_base(1 - _versine(n, l, v, n_dot_l))


def of_log1p(n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane) -> Plane:
    """JAX's log1p(-|r - v|^2 / 2)."""
    return _log1p(_versine(n, l, v, n_dot_l))


def ours(n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane) -> Plane:
    """The package's."""
    return log_cosine(reflect(l, n), v, n_dot_l)


@Node
def _log1p(q: Plane) -> Plane:
    dark = q >= 1
    return jnp.where(dark, -jnp.inf, jnp.log1p(-jnp.where(dark, 0, q)))


@_log1p.derivative
def _(y: Plane, planes: Any, tangents: Any) -> Plane:
    dark = planes[0] >= 1
    return jnp.where(dark, 0, -tangents[0]) * guard.reciprocal.computed(
        jnp.where(dark, 1, 1 - planes[0])
    )


FORMS: dict[str, Form] = {
    "log(r.v)": of_dot,
    "log(r.v / (|r| |v|))": of_unit_lengths,
    "log(1 - |r - v|^2 / 2)": of_rest,
    "log1p(-|r - v|^2 / 2)": of_log1p,
    "the package's": ours,
}


class Lobe(AbstractLobe):
    """Phong's lobe by one of the forms."""

    ks: Float[Array, "..."] = eqx.field(converter=coefficients("ks"))
    shininess: Float[Array, "..."] = eqx.field(converter=positive("shininess"))
    form: Form = eqx.field(static=True)
    kind: ClassVar[str] = "phong"
    convex: ClassVar[bool] = True

    def angles(self, n: Vec3, l: Vec3, v: Vec3, n_dot_l: Plane) -> Plane:
        return self.form(n, l, v, n_dot_l)

    def at(self, angles: Plane) -> tuple[Plane, ...]:
        return tuple(guard.power_of_log(angles, exponent) for exponent in channels(self.shininess))


def by(form: Form) -> Callable[..., Lobe]:
    """A lobe's class, as `renders` takes it."""
    return lambda ks, shininess: Lobe(ks, shininess, form)


def prepared(form: Form) -> dict[str, Callable[[], Any]]:
    """A value and a gradient in 13 coefficients, compiled: 512 x 512, four coloured lights."""
    gbuffer, lit, material = renders.scene(4, 32.0, 512, by(form))
    surface, options = KeptGeometry(gbuffer, None), ds.compiler_options()
    value = jax.jit(lambda *a: image_planes(*a, plain=False), compiler_options=options)
    observed = 0.9 * jnp.stack(value(surface, lit, material))
    unknown = material, lit.lights[0].attenuation
    return {
        "value": lambda: jax.block_until_ready(value(surface, lit, material)),
        "gradient": lambda: jax.block_until_ready(renders.slope(unknown, gbuffer, lit, observed)),
    }


def table(rounds: int) -> str:
    """Errors and CPU times, as Markdown."""
    with jax.enable_x64(False):
        programs = {name: prepared(form) for name, form in FORMS.items()}
        times: dict[tuple[str, str], list[float]] = {}
        for number in range(rounds + 1):
            for name, program in programs.items():
                for what, run in program.items():
                    before = time.process_time()
                    for _ in range(3):
                        run()
                    spent = (time.process_time() - before) / 3
                    if number:  # the first compiles
                        times.setdefault((name, what), []).append(spent)
    first = next(iter(FORMS))
    head = ["form", *(f"error, n = {n:g}" for n in renders.EXPONENTS)]
    head += [f"{what}, {unit}" for what in ("value", "gradient") for unit in ("ms", "ratio")]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for name, form in FORMS.items():
        cells = [name]
        cells += [f"{renders.image_error(1, n, lobe=by(form)):.1e}" for n in renders.EXPONENTS]
        for what in ("value", "gradient"):
            own, base = times[name, what], times[first, what]
            ratio = statistics.median(a / b for a, b in zip(own, base, strict=True))
            cells += [f"{1e3 * statistics.median(own):.2f}", f"{ratio:.2f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
