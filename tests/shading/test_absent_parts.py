"""Absent is not zero: what a scene lacks is not in the traced program.

Each test traces the shading with a part and without it, counts primitives over the pixels, and says
which must be gone. The counts are of whole planes: arithmetic on a few constants is free.
"""

from collections import Counter
from collections.abc import Iterator

import jax
import numpy as np
import pytest
from jax.extend import core

import diffshade as ds
from diffshade.light.attenuation import AbstractAttenuation
from diffshade.shading.basis import basis, contract

GBUFFER = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(16, 16, 2.5))
PIXELS = GBUFFER.pixel_count
FULL = ds.Material(ka=0.1, kd=0.5, specular=ds.Phong(ks=0.4, shininess=20.0))
ATTENUATED = ds.PointLight((1.0, 2.0, 3.0), 1.0, ds.QuadraticAttenuation(1.0, 0.1, 0.1))


def equations(jaxpr: core.Jaxpr) -> Iterator[core.JaxprEqn]:
    """Every equation of a program, those of its nested programs included."""
    for equation in jaxpr.eqns:
        nested = _nested(equation)
        if nested:
            for inner in nested:
                yield from equations(inner)
        else:
            yield equation


def _nested(equation: core.JaxprEqn) -> list[core.Jaxpr]:
    found = []
    for value in equation.params.values():
        for item in value if isinstance(value, (tuple, list)) else (value,):
            if isinstance(item, core.ClosedJaxpr):
                found.append(item.jaxpr)
            elif isinstance(item, core.Jaxpr):
                found.append(item)
    return found


def planes(scene: ds.Scene, material: ds.Material, gbuffer: ds.GBuffer = GBUFFER) -> Counter[str]:
    """How often each primitive computes a whole plane in the traced program."""

    def shade(gbuffer: ds.GBuffer, scene: ds.Scene, material: ds.Material):  # type: ignore[no-untyped-def]
        return contract(basis(gbuffer, scene, material), material)

    program = jax.make_jaxpr(shade)(gbuffer, scene, material).jaxpr
    return Counter(
        e.primitive.name
        for e in equations(program)
        if e.primitive.name != "broadcast_in_dim"  # of a constant: no work of its own
        and any(v.aval.shape[-1:] == (gbuffer.pixel_count,) for v in e.outvars)
    )


def total(counts: Counter[str]) -> int:
    return sum(counts.values())


def test_no_lights() -> None:
    everything = planes(ds.Scene(ambient=0.2, lights=ATTENUATED), FULL)
    assert {"mul", "add", "sqrt", "div", "exp", "log"} <= set(everything)
    assert total(planes(ds.Scene(ambient=0.2), FULL)) == 0


def test_no_specular_part_no_power_no_view() -> None:
    diffuse = planes(ds.Scene(lights=ATTENUATED), ds.Material(kd=0.5))
    glossy = planes(ds.Scene(lights=ATTENUATED), ds.Material(kd=0.5, specular=ds.Phong(0.4, 20.0)))
    assert glossy["exp"] == 1
    assert glossy["log"] == 1
    assert diffuse["exp"] == diffuse["log"] == diffuse["pow"] == 0
    assert total(diffuse) < total(glossy) - 10


def test_no_view_vector_without_a_lobe() -> None:
    camera = ds.PerspectiveCamera(16, 16, 0.6, position=(0, 0, 4))
    gbuffer = ds.gbuffer(ds.Sphere(), camera)
    scene = ds.Scene(lights=ds.ParallelLight((0, 1, 1)))
    glossy = planes(scene, FULL, gbuffer)
    assert glossy["sqrt"] == 1  # of |eye - P|
    assert planes(scene, ds.Material(ka=0.1, kd=0.5), gbuffer)["sqrt"] == 0


def test_no_diffuse_part() -> None:
    scene = ds.Scene(lights=ATTENUATED)
    specular = planes(scene, ds.Material(specular=ds.Phong(0.4, 20.0)))
    both = planes(scene, ds.Material(kd=0.5, specular=ds.Phong(0.4, 20.0)))
    gone = both - specular
    assert gone["select_n"] == 1  # max(0, n.l)
    assert gone["mul"] >= 2
    assert gone["add"] >= 1


def test_no_ambient_part() -> None:
    scene = ds.Scene(ambient=0.2, lights=ATTENUATED)
    with_it = planes(scene, FULL)
    for without in (
        planes(ds.Scene(lights=ATTENUATED), FULL),
        planes(scene, ds.Material(kd=0.5, specular=ds.Phong(0.4, 20.0))),
    ):
        assert with_it - without == Counter(add=1)


def test_no_attenuation_no_distance() -> None:
    free = planes(ds.Scene(lights=ds.PointLight((1.0, 2.0, 3.0))), ds.Material(kd=0.5))
    attenuated = planes(ds.Scene(lights=ATTENUATED), ds.Material(kd=0.5))
    assert free["sqrt"] == free["div"] == attenuated["sqrt"] == 1  # 1 / |s|
    gone = attenuated - free
    assert gone["div"] == 1  # 1 / (c0 + c1 d + c2 d^2)
    assert gone["mul"] == 4  # d = |s|^2 / |s|, Horner's rule, and f I_p


def test_no_per_pixel_light_vector_for_a_parallel_light() -> None:
    point = planes(ds.Scene(lights=ds.PointLight((1.0, 2.0, 3.0))), ds.Material(kd=0.5))
    parallel = planes(ds.Scene(lights=ds.ParallelLight((1.0, 2.0, 3.0))), ds.Material(kd=0.5))
    assert point["sqrt"] == point["div"] == 1
    assert point["sub"] == 3
    assert parallel["sqrt"] == parallel["sub"] == 0
    # n.l (3 products, 2 sums), max(0, .), I_p and k_d are all that is left.
    assert parallel == Counter(mul=5, add=2, le=1, select_n=1)


def test_normals_alone_are_enough_for_parallel_lights() -> None:
    gbuffer = ds.GBuffer.from_arrays(None, np.tile([0.0, 0.6, 0.8], (3, 3, 1)))
    image = ds.render(gbuffer, ds.Scene(lights=ds.ParallelLight((0, 0, 1))), ds.Material(kd=0.5))
    np.testing.assert_allclose(image, 0.4, rtol=1e-6)
    with pytest.raises(ds.BadInput, match="normals only"):
        ds.render(gbuffer, ds.Scene(lights=ds.PointLight((0, 0, 1))), ds.Material(kd=0.5))


def test_of_an_environment_only_the_degrees_that_there_are() -> None:
    dull, point = ds.Material(kd=0.5), ds.Scene(lights=ATTENUATED)

    def around(order: int, material: ds.Material) -> Counter[str]:
        light = ds.EnvironmentLight(np.ones((order + 1) ** 2))
        return planes(ds.Scene(lights=light), material)

    def more(order: int, material: ds.Material) -> Counter[str]:
        light = ds.EnvironmentLight(np.ones((order + 1) ** 2))
        return planes(ds.Scene(lights=(ATTENUATED, light)), material) - planes(point, material)

    arithmetic = {"mul", "add", "sub"}
    # E(n) is a polynomial, without n.l, and dark where there is no normal
    assert set(more(4, dull)) <= arithmetic | {"eq", "select_n"}
    assert around(4, dull) == around(2, dull)  # it has no degree above 2
    assert total(around(0, dull)) < total(around(1, dull)) < total(around(2, dull))
    # and so is a lobe, without its logarithm
    assert set(more(4, FULL)) <= arithmetic | {"eq", "select_n", "or"}
    lobes = [total(around(order, FULL)) for order in (2, 3, 4)]
    assert lobes == sorted(lobes)
    assert around(4, FULL)["exp"] == around(4, FULL)["log"] == 0


def test_no_object_colour() -> None:
    scene = ds.Scene(lights=ATTENUATED)
    plain = planes(scene, ds.Material(kd=(0.5, 0.5, 0.5)))
    coloured = planes(scene, ds.Material(kd=0.5, od=(0.5, 0.4, 0.3)))
    assert total(plain) < total(coloured)


def test_no_work_on_the_background() -> None:
    """Of 256 pixels the sphere covers about half; no plane of the shading is as large as the image."""
    assert PIXELS < 0.6 * 256
    scene = ds.Scene(ambient=0.1, lights=(ATTENUATED, ds.ParallelLight((0, 0, 1))))

    def image(gbuffer: ds.GBuffer, scene: ds.Scene, material: ds.Material) -> jax.Array:
        return ds.render(gbuffer, scene, material)

    program = jax.make_jaxpr(image)(GBUFFER, scene, FULL).jaxpr
    whole = Counter(
        e.primitive.name for e in equations(program) if any(v.aval.size >= 256 for v in e.outvars)
    )
    assert set(whole) <= {"broadcast_in_dim", "scatter", "reshape", "concatenate", "stack"}


def test_grey_lights_are_summed_once_for_all_channels() -> None:
    grey = planes(ds.Scene(lights=ds.PointLight((1, 2, 3), 0.7)), ds.Material(kd=0.5))
    colour = planes(ds.Scene(lights=ds.PointLight((1, 2, 3), (0.7, 0.6, 0.5))), ds.Material(kd=0.5))
    assert colour["mul"] - grey["mul"] == 4  # I_p and k_d, of two more channels
    assert colour["sqrt"] == grey["sqrt"] == 1


def test_every_attenuation_is_only_what_it_needs() -> None:
    def of(attenuation: AbstractAttenuation | None) -> Counter[str]:
        light = ds.PointLight((1.0, 2.0, 3.0), 1.0, attenuation)
        return planes(ds.Scene(lights=light), ds.Material(kd=0.5))

    none = of(None)
    assert (of(ds.ExponentialAttenuation(0.1)) - none)["exp"] == 1
    assert (of(ds.InverseSquare()) - none)["div"] == 1
    assert (of(ds.LinearAttenuation(1.0, 0.5)) - none)["div"] == 1
    assert none["exp"] == 0
    assert none["div"] == 1  # 1 / |s|


def test_a_thousand_lights_compile_like_sixteen() -> None:
    def lit(count: int) -> ds.Scene:
        return ds.Scene(lights=tuple(ds.PointLight((float(k), 2.0, 3.0)) for k in range(count)))

    def size(count: int) -> int:
        return total(planes(lit(count), ds.Material(kd=0.5)))

    assert size(1024) == size(16)
    # XLA's time to compile a concatenation grows with the square of what it joins.
    program = jax.make_jaxpr(ds.render)(GBUFFER, lit(1024), ds.Material(kd=0.5)).jaxpr
    joined = [
        len(e.invars) for e in equations(program) if e.primitive.name in ("concatenate", "stack")
    ]
    assert 1 < max(joined) <= 32


def test_no_shadows() -> None:
    free = planes(ds.Scene(lights=ATTENUATED), FULL)
    shadowed = ds.shadowed(ATTENUATED, GBUFFER, ds.Sphere((1, 1, 2), 0.4))
    assert planes(ds.Scene(lights=shadowed), FULL) - free == Counter(mul=1)
