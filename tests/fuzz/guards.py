"""Every guard of the package, how its source reads without it, and what tests hold it."""

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

__all__ = ["GUARDS", "PACKAGE", "Guard", "unlisted", "without"]

PACKAGE = Path(__file__).parents[2] / "diffshade"


class Guard(NamedTuple):
    """A piece of source, once in its file, what takes its place, and tests that fail then."""

    name: str
    file: str
    source: str
    without: str
    tests: tuple[str, ...]


def finite(*names: str) -> tuple[str, ...]:
    """The contract of functions."""
    test = "tests/test_contract.py::test_values_and_derivatives_are_finite"
    return tuple(f"{test}[{name}]" for name in names)


def kink(*names: str) -> tuple[str, ...]:
    """Stated derivatives."""
    test = "tests/test_contract.py::test_the_derivative_at_a_kink_is_the_stated_one"
    return tuple(f"{test}[{name}]" for name in names)


POWER = finite("guard.log_base-guard.power-guard.power_of_log")
ZERO = ("tests/test_guard.py::test_zero_with_zero_derivatives_where_it_is_singular",)
POWER_ZERO = ("tests/test_guard.py::test_power_and_its_derivatives_are_finite",)
ROUNDING = ("tests/test_guard.py::test_arguments_are_harmless_whatever_a_selection_says",)
RULELESS = ("tests/test_guard.py::test_a_node_without_its_rule_has_the_same_derivatives",)
LEFT_OF_ONE = ("tests/test_guard.py::test_the_logarithm_of_what_is_left_of_one",)
WHITE = ("tests/colour/test_dominant.py::test_white_has_none",)
REFLECTANCE, NORMALS, LAW = "reflectance/", "geometry/normals.py", "light/attenuation.py"
FRESNEL, FACETS = "tests/reflectance/test_fresnel.py::", "tests/reflectance/test_microfacet.py::"
DARK = (FACETS + "test_it_is_dark_behind_the_surface",)
IN_MICROFACETS = (
    (
        "total reflection",
        "fresnel.py",
        "jnp.where(total, 1, 0.5 * s * s * (1 + p * p))",
        "0.5 * s * s * (1 + p * p)",
        (FRESNEL + "test_all_is_reflected_beyond_the_critical_angle",),
    ),
    (
        "alike media along the surface",
        "fresnel.py",
        "jnp.where(across < guard.shortest(across) ** 0.5, 0, across)",
        "across",
        (FRESNEL + "test_second_derivatives_are_finite_of_alike_media",),
    ),
    (
        "a metal of a small index",
        "fresnel.py",
        "jnp.where(x > 0, size + x, y * guard.ratio(y, size - x))",
        "size + x",
        (FRESNEL + "test_the_slope_of_a_metal_in_a_small_index",),
    ),
    (
        "the angle of a facet that lies flat",
        "distribution.py",
        "jnp.where(versine < near, series, angle * angle)",
        "angle * angle",
        (FACETS + "test_the_slope_of_a_gaussian_at_its_peak",),
    ),
    (
        "rational masking beyond its range",
        "masking.py",
        "jnp.where(t >= 1.6, 0, near)",
        "near",
        (FACETS + "test_no_facet_hides_another_from_above",),
    ),
    (
        "grooves: all of the light",
        "masking.py",
        "jnp.where(slope * n_dot_l < 1, slope * n_dot_l, 1)",
        "slope * n_dot_l",
        (FACETS + "test_no_more_is_reflected_than_arrives",),
    ),
    (
        "grooves: hidden from the viewer",
        "masking.py",
        "jnp.where(hidden, slope, guard.ratio(lit, n_dot_v))",
        "guard.ratio(lit, n_dot_v)",
        (FACETS + "test_no_more_is_reflected_than_arrives",),
    ),
    ("no light on facets", "microfacet.py", "jnp.where(dark, 0, n_dot_l)", "n_dot_l", DARK),
    ("facets that are not seen", "microfacet.py", "jnp.where(dark, 1, n_dot_v)", "n_dot_v", DARK),
)
IN_GUARD = (
    ("positive", "jnp.where(x <= 0, 0, x)", "jnp.maximum(x, 0)", kink("n.l = 0, diffuse")),
    ("sqrt: before", "jnp.sqrt(jnp.maximum(x, least))", "jnp.sqrt(x)", finite("guard.sqrt")),
    (
        "sqrt: after",
        "jnp.where(x <= least, 0, jnp.sqrt(jnp.maximum(x, least)))",
        "jnp.sqrt(jnp.maximum(x, least))",
        ZERO,
    ),
    ("sqrt: what is tiny", "_smallest(x) ** 0.5", "0.0", finite("guard.sqrt")),
    (
        "reciprocal_sqrt: before",
        "jnp.sqrt(1 / jnp.maximum(x, least))",
        "jnp.sqrt(1 / x)",
        ROUNDING,
    ),
    (
        "reciprocal_sqrt: after",
        "jnp.where(x <= least, 0, jnp.sqrt(1 / jnp.maximum(x, least)))",
        "jnp.sqrt(1 / jnp.maximum(x, least))",
        ZERO,
    ),
    (
        "reciprocal_sqrt: what is tiny",
        "least = shortest(x)",
        "least = 0.0",
        finite("guard.reciprocal_sqrt"),
    ),
    (
        "reciprocal: before",
        "1 / jnp.where(tiny, 1, x)",
        "1 / x",
        RULELESS,
    ),
    (
        "reciprocal: after",
        "jnp.where(tiny, 0, 1 / jnp.where(tiny, 1, x))",
        "1 / jnp.where(tiny, 1, x)",
        ZERO,
    ),
    (
        "reciprocal: what is tiny",
        "jnp.abs(x) < _smallest(x) ** 0.75",
        "x == 0",
        ("tests/test_guard.py::test_a_reciprocal_leaves_room_for_products",),
    ),
    (
        "power: what is tiny",
        "float(jnp.finfo(jnp.result_type(x)).eps)",
        "_smallest(x)",
        POWER,
    ),
    ("log_base: before", "jnp.log(jnp.maximum(x, least))", "jnp.log(x)", ROUNDING),
    (
        "log_base: after",
        "jnp.where(x <= least, -jnp.inf, jnp.log(jnp.maximum(x, least)))",
        "jnp.log(jnp.maximum(x, least))",
        POWER_ZERO,
    ),
    ("log_base: its slope", "jnp.maximum(x, _dimmest(x))", "x", POWER),
    (
        "log_one_minus: before",
        "jnp.log(jnp.maximum(rest, _dimmest(rest)))",
        "jnp.log(rest)",
        RULELESS,
    ),
    (
        "log_one_minus: after",
        "jnp.where(rest <= 0, -jnp.inf, logarithm)",
        "logarithm",
        LEFT_OF_ONE,
    ),
    (
        "log_one_minus: its slope after",
        "jnp.where(rest <= 0, 0, -tangents[0])",
        "-tangents[0]",
        LEFT_OF_ONE,
    ),
    (
        "power_of_log: before",
        "jnp.maximum(log_x, math.log(_dimmest(log_x)))",
        "log_x",
        ROUNDING,
    ),
    (
        "power_of_log: after",
        "jnp.where(log_x == -jnp.inf, 0, jnp.exp(n * _lit(log_x)))",
        "jnp.exp(n * _lit(log_x))",
        POWER_ZERO,
    ),
)

GUARDS = (
    *(Guard(name, "guard.py", *rest) for name, *rest in IN_GUARD),
    Guard(
        "ratio: what is tiny",
        "guard.py",
        "jnp.where(jnp.abs(whole) <= shortest(whole), 0, whole)",
        "whole",
        finite("guard.ratio"),
    ),
    Guard(
        "the root of black",
        "colour/cie.py",
        "jnp.where(is_dark, DARK, brightness)",
        "brightness",
        finite("cie.xyz_to_luv"),
    ),
    *(
        Guard(f"white, which has no {name}", "colour/dominant.py", source, without, WHITE)
        for name, source, without in (
            ("wavelength", "jnp.where(_is_white(ray), 0, found)", "found"),
            ("purity", "jnp.where(_is_white(ray), 0, crossed)", "crossed"),
        )
    ),
    Guard(
        "unit: vectors that are tiny",
        "vector.py",
        "jnp.where(size < guard.shortest(size), 0, size)",
        "size",
        finite("vector.unit", "vector.length"),
    ),
    Guard(
        "unit: squares out of range",
        "vector.py",
        "return size, a * guard.reciprocal(size)",
        "return jnp.ones_like(size), a",
        ("tests/test_guard.py::test_a_unit_vector_of_any_length",),
    ),
    Guard(
        "opposite directions of light and view",
        "vector.py",
        "jnp.where(opposite, 0, square)",
        "square",
        kink("all but opposite vectors"),
    ),
    Guard(
        "the clamp of the attenuation",
        LAW,
        "guard.reciprocal(jnp.where(q < 1, 1, q))",
        "jnp.minimum(guard.reciprocal(q), 1)",
        kink("the edge of the clamp"),
    ),
    Guard(
        "the window: beyond its reach",
        LAW,
        "jnp.where(d < self.reach, d, self.reach) * ",
        "d * ",
        ("tests/light/test_attenuation.py::test_a_window_ends_smoothly_at_the_reach",),
    ),
    Guard(
        "the window: its end",
        LAW,
        "jnp.where(d < self.reach, 1 - square * square, 0)",
        "1 - square * square",
        ("tests/light/test_attenuation.py::test_a_window_ends_smoothly_at_the_reach",),
    ),
    Guard(
        "an environment: no direction",
        "shading/prefiltered.py",
        "jnp.where(nowhere, 0, plane)",
        "plane",
        ("tests/shading/test_prefiltered.py::test_nothing_is_lit_that_has_no_normal_or_no_view",),
    ),
    Guard(
        "lobes: light behind",
        REFLECTANCE + "lobe.py",
        "(n_dot_l <= 0) | (dot(b, b) == 0)",
        "dot(b, b) == 0",
        kink("n.l = 0, Phong", "n.l = 0, Blinn-Phong"),
    ),
    Guard(
        "lobes: no direction",
        REFLECTANCE + "lobe.py",
        "(n_dot_l <= 0) | (dot(b, b) == 0)",
        "n_dot_l <= 0",
        ("tests/test_guard.py::test_a_lobe_of_no_direction_is_dark",),
    ),
    Guard(
        "lobes: what is dark",
        REFLECTANCE + "lobe.py",
        "jnp.where(dark, 1, versine(a, b))",
        "versine(a, b)",
        kink("n.l = 0, Phong", "n.l = 0, Blinn-Phong"),
    ),
    Guard(
        "Blinn-Phong: bound of opposite directions",
        REFLECTANCE + "blinn_phong.py",
        """jnp.where(
            sum_of_cosines < shortest, sum_of_cosines * guard.reciprocal(shortest), 1
        )""",
        "sum_of_cosines * guard.reciprocal(shortest)",
        ("tests/shading/test_cull.py::test_no_pixel_is_brighter_than_the_bound[none-blinn_phong]",),
    ),
    Guard(
        "angles of a face without extent",
        NORMALS,
        "jnp.where(nothing, 1, adjacent)",
        "adjacent",
        kink("an angle of a face without extent"),
    ),
    Guard(
        "normals that cancel up to rounding",
        NORMALS,
        "jnp.where(some, plane, 0) for plane",
        "plane for plane",
        ("tests/geometry/test_normals.py::test_normals_that_cancel_up_to_rounding_are_zero",),
    ),
    *(Guard(name, f"reflectance/{file}", *rest) for name, file, *rest in IN_MICROFACETS),
    Guard(
        "refraction: where nothing goes on",
        "vector.py",
        "jnp.where(total, 0, component) for",
        "component for",
        ("tests/test_refract.py::test_beyond_the_critical_angle_derivatives_are_zero",),
    ),
)

SELECTING = {
    "colour/cie.py": "the branches of L*; a guard among them is in the list",
    "colour/device.py": "the branches of hues and of the saturation",
    "colour/dominant.py": "the side of white that has a wavelength; guards of white are in the list",
    "colour/interpolate.py": "the shorter way round",
    "light/distributed.py": "which axis is another one",
    "light/spot.py": "where the cone ends",
    "bounds.py": "of values that are never differentiated",
    "geometry/raycast.py": "the same",
    "shading/cull.py": "the same",
    "pages.py": "which of two planes is written",
    "shading/image.py": "which pixels are a page's own",
}
"""Modules whose selections guard nothing, and what they are."""

GUARDED = re.compile(r"jnp\.where\(|jnp\.maximum\(.*(least|dimmest)")


def unlisted() -> list[str]:
    """The guards in the source that no entry names: file and line."""
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        file, text = path.relative_to(PACKAGE).as_posix(), path.read_text()
        if file in SELECTING:
            continue
        spans = [
            (text.index(g.source), text.index(g.source) + len(g.source))
            for g in GUARDS
            if g.file == file
        ]
        for match in GUARDED.finditer(text):
            if not any(first <= match.start() < last for first, last in spans):
                found.append(f"{file}:{text[: match.start()].count(chr(10)) + 1}")
    return found


@contextmanager
def without(guard: Guard, package: Path) -> Iterator[None]:
    """A copy of the package without a guard, as long as this lasts."""
    path = package / guard.file
    text = path.read_text()
    if text.count(guard.source) != 1:
        raise ValueError(
            f"{guard.file} has {guard.source!r} {text.count(guard.source)} times, not once"
        )
    path.write_text(text.replace(guard.source, guard.without))
    # Python tells a source that has changed by its time in seconds and its size.
    shutil.rmtree(path.parent / "__pycache__", ignore_errors=True)
    try:
        yield
    finally:
        path.write_text(text)
        shutil.rmtree(path.parent / "__pycache__", ignore_errors=True)
