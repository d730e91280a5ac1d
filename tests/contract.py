"""The contract of every public function: finite values and derivatives for input of `guard`'s ranges.

`CONTRACT` says of each how a case is made (`strategies`) and what is computed of it; `NO_FLOATS` which
names have nothing to differentiate, and why. What is exported and stands in neither fails a test.
"""

from collections.abc import Callable, Iterator
from functools import partial
from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np
import strategies
from computed import (
    SMITH,
    WAVELENGTHS,
    Contract,
    against_a_white,
    around_white,
    attenuated,
    ball,
    behind_each_other,
    between_colours,
    both_sides,
    error,
    faceted,
    from_basis,
    gbuffer,
    glow,
    glowing,
    grooved,
    kept,
    lobe,
    of_angles,
    of_colours,
    of_corners,
    of_grooves,
    of_inverses,
    of_numbers,
    of_one_colour,
    of_shares,
    of_sphere,
    of_vectors,
    of_vertices,
    on_a_device,
    orthographic,
    parallel_light,
    perspective,
    point_light,
    powers,
    refracted,
    refractions,
    shaded,
    sky,
    smith,
    spot_light,
    temperatures,
    triangles,
    under_glass,
)
from jax.flatten_util import ravel_pytree
from strategies import Cases

import diffshade as ds
from diffshade import guard, harmonics, vector
from diffshade.colour import (
    cie,
    device,
    dominant,
    interpolate,
    metamer,
    munsell,
    names,
    observer,
    spectrum,
    srgb,
    transfer,
)
from diffshade.fusion import search_options
from diffshade.geometry import normals
from diffshade.reflectance import (
    blinn_phong,
    conversion,
    distribution,
    fresnel,
    lambert,
    masking,
    phong,
)

__all__ = ["CONTRACT", "NO_FLOATS", "Contract", "exported", "failure", "finite"]

MODES = ("value", "grad", "jacfwd", "jacrev", "hessian")

NO_FLOATS = {
    "interpolate.SYSTEMS": "names, and functions of `colour.device`",
    "cie.D65": "two numbers",
    "cie.SRGB": "numbers",
    "cie.Primaries": "numbers of the host",
    "cie.in_gamut": "says yes or no",
    "dominant.complementary_wavelength": "the dominant one of another chromaticity",
    "metamer.are_metamers": "says yes or no",
    **dict.fromkeys(
        (f"munsell.{name}" for name in ("WHITE", "munsell_to_xyy", "xyy_to_munsell")),
        "found in tables of the host",
    ),
    **dict.fromkeys(
        (
            f"names.{name}"
            for name in ("LIGHTNESS", "NAMES", "SATURATION", "colour_name", "colour_of_name")
        ),
        "words",
    ),
    **dict.fromkeys(
        (
            f"observer.{name}"
            for name in ("LUMENS", "illuminant", "spectral_locus", "standard_observer")
        ),
        "tables of the host",
    ),
    "spectrum.trapezoid": "computed on the host",
    "transfer.intensity_levels": "computed on the host",
    "transfer.levels_needed": "computed on the host",
    "transfer.look_up_table": "computed on the host",
    "guard.shortest": "a constant of a type",
    **dict.fromkeys(
        (f"conversion.to_{name}" for name in ("beckmann", "blinn_phong", "ggx", "phong")),
        "makes a lobe of another, whose coefficients it has by the other functions",
    ),
    "shadowed": "decides on values what is seen of lights, and is never differentiated",
    "resolved": "chooses a number of samples, or an order; what it returns is a light",
    "harmonics.order_of": "of whole numbers",
    "conversion.difference": "the largest over many directions: to be read, not descended",
    "fresnel.AbstractFresnel": "the class of its three kinds",
    "BadInput": "an exception",
    "compiler_options": "options of a compiler",
    "load_mesh": "reads a file; what it gives is a Mesh",
    "visibility": "decides on values, and is never differentiated",
    "peel": "the same",
}


def exported() -> Iterator[str]:
    """The public names: of the package, and of the modules that formulas are read in."""
    modules: tuple[ModuleType, ...] = (
        *(ds, guard, harmonics, vector, normals, lambert, phong, blinn_phong),
        *(conversion, distribution, fresnel, masking),
        *(cie, device, interpolate, srgb, transfer),
        *(dominant, metamer, munsell, names, observer, spectrum),
    )
    for module in modules:
        for name in module.__all__:
            within = module.__name__.rpartition(".")[2]
            yield name if hasattr(ds, name) else f"{within}.{name}"


def finite(contract: Contract) -> Callable[[Cases], jax.Array]:
    """One program that says of each case which of the `MODES` are finite: [count, 5]."""

    def of_one(case: dict[str, jax.Array]) -> jax.Array:
        flat, unravel = ravel_pytree(case)

        def values(x: jax.Array) -> jax.Array:
            return jnp.concatenate([jnp.ravel(y) for y in jax.tree.leaves(contract.of(unravel(x)))])

        def total(x: jax.Array) -> jax.Array:
            return values(x).sum()

        slope = jax.grad(total)
        found = (
            values(flat),
            slope(flat),
            jax.jacfwd(values)(flat),
            jax.jacrev(values)(flat),
            jax.jacfwd(slope)(flat),
        )
        return jnp.stack([jnp.isfinite(x).all() for x in found])

    return jax.jit(jax.vmap(of_one), compiler_options=search_options())


def failure(cases: Cases, are_finite: np.ndarray) -> str | None:
    """Of what `finite` says, [count, 5]: the first case that is not, and in which of the `MODES`."""
    bad = np.flatnonzero(~are_finite.all(axis=1))
    if not bad.size:
        return None
    which = [mode for mode, fine in zip(MODES, are_finite[bad[0]], strict=True) if not fine]
    case = {name: array[bad[0]].tolist() for name, array in cases.items()}
    return f"{', '.join(which)} not finite at {case}"


quadratic = partial(point_light, kind=ds.QuadraticAttenuation)

CONTRACT: dict[tuple[str, ...], Contract] = {
    # diffshade
    ("render",): shaded(quadratic, ds.Phong, ds.BlinnPhong),
    ("PointLight",): shaded(point_light, ds.Phong, eye=False),
    ("ParallelLight",): shaded(parallel_light, ds.Phong),
    ("Phong",): shaded(quadratic, ds.Phong),
    ("BlinnPhong",): shaded(quadratic, under_glass),
    ("Material",): shaded(parallel_light, ds.Phong, ds.BlinnPhong, eye=False),
    ("SpotLight",): shaded(spot_light, ds.Phong),
    ("EnvironmentLight",): shaded(sky, ds.Phong),
    **{
        (f"{kind}Light",): shaded(partial(glowing, kind))
        for kind in ("Rectangle", "Disc", "Sphere", "Line")
    },
    ("Scene",): shaded(lambda case: (point_light(case), parallel_light(case))),
    ("QuadraticAttenuation",): attenuated(ds.QuadraticAttenuation),
    ("LinearAttenuation",): attenuated(ds.LinearAttenuation),
    ("InverseSquare",): attenuated(ds.InverseSquare),
    ("ExponentialAttenuation",): attenuated(ds.ExponentialAttenuation),
    ("Windowed",): attenuated(ds.Windowed),
    ("KeptGeometry", "keep_geometry"): Contract(strategies.scenes, kept),
    ("Basis", "basis", "contract"): Contract(strategies.scenes, from_basis),
    ("mean_squared_error",): Contract(strategies.captures, error),
    ("Sharded", "shard"): Contract(strategies.scenes, on_a_device),
    ("GBuffer",): Contract(strategies.points, gbuffer),
    ("gbuffer", "Sphere", "OrthographicCamera"): Contract(
        strategies.spheres, partial(ball, orthographic)
    ),
    ("layers",): Contract(strategies.spheres, both_sides),
    ("render_layers", "InterpolatedTransparency"): behind_each_other(ds.InterpolatedTransparency),
    ("FilteredTransparency",): behind_each_other(ds.FilteredTransparency),
    ("PerspectiveCamera",): Contract(strategies.spheres, partial(ball, perspective)),
    ("Mesh",): Contract(strategies.meshes, partial(triangles, ds.PhongShading(), True)),
    **{
        (type(frequency).__name__,): Contract(
            strategies.meshes, partial(triangles, frequency, False)
        )
        for frequency in (ds.PhongShading(), ds.GouraudShading(), ds.FlatShading())
    },
    # Singularities
    ("guard.log_base", "guard.power", "guard.power_of_log"): Contract(
        powers, lambda case: guard.power(case["x"], case["n"])
    ),
    ("guard.log_one_minus",): Contract(
        powers, lambda case: guard.power_of_log(guard.log_one_minus(abs(case["x"])), case["n"])
    ),
    ("guard.ratio",): Contract(strategies.colours, of_shares),
    ("guard.positive", "lambert.lambert"): of_numbers(lambert.lambert),
    ("guard.reciprocal",): of_inverses(guard.reciprocal),
    ("guard.reciprocal_sqrt",): of_numbers(guard.reciprocal_sqrt),
    ("guard.sqrt",): of_numbers(guard.sqrt),
    # Vectors
    ("vector.Vec3",): of_vectors(lambda a, b: (a + b, a - b, -a, a * b.x, a.to_array())),
    ("vector.cross",): of_vectors(vector.cross),
    ("vector.direction",): of_vectors(vector.direction, 1),
    ("vector.dot",): of_vectors(vector.dot),
    ("vector.halfway",): of_vectors(lambda a, b: vector.halfway(vector.unit(a), vector.unit(b))),
    ("vector.length",): of_vectors(vector.length, 1),
    ("vector.reflect",): of_vectors(vector.reflect),
    ("vector.refract",): Contract(refractions, refracted),
    ("vector.versine",): of_vectors(vector.versine),
    ("vector.unit",): of_vectors(vector.unit, 1),
    # Harmonics
    ("harmonics.spherical_harmonics", "harmonics.each_harmonic", "harmonics.bands"): Contract(
        strategies.vectors, of_sphere
    ),
    # Normals
    ("normals.face_normals",): of_corners(normals.face_normals),
    ("normals.plane_normals",): of_corners(normals.plane_normals),
    ("normals.newell_normal",): Contract(
        strategies.meshes, lambda case: normals.newell_normal(case["vertices"])
    ),
    ("normals.vertex_normals",): Contract(strategies.meshes, of_vertices),
    ("normals.angle_weights",): of_corners(normals.angle_weights),
    ("normals.area_weights",): of_corners(normals.area_weights),
    ("normals.sphere_weights",): of_corners(normals.sphere_weights),
    ("normals.uniform_weights",): of_corners(normals.uniform_weights),
    # Colours
    **{
        (f"device.{name}",): of_colours(getattr(device, name))
        for name in device.__all__
        if name != "cmyk_to_rgb"
    },
    ("device.cmyk_to_rgb",): of_colours(lambda rgb: device.cmyk_to_rgb(device.rgb_to_cmyk(rgb))),
    ("cie.rgb_to_xyz", "cie.xyz_to_rgb"): of_colours(lambda x: cie.xyz_to_rgb(cie.rgb_to_xyz(x))),
    ("cie.between_screens",): of_colours(lambda x: cie.between_screens(x, cie.SRGB, cie.SRGB)),
    ("cie.xyz_to_xyy",): of_colours(cie.xyz_to_xyy),
    ("cie.xyy_to_xyz",): of_colours(lambda x: cie.xyy_to_xyz(cie.xyz_to_xyy(x))),
    ("cie.xyz_to_luv",): of_colours(cie.xyz_to_luv),
    ("cie.luv_to_xyz",): of_colours(lambda x: cie.luv_to_xyz(cie.xyz_to_luv(x))),
    ("srgb.from_srgb",): of_colours(srgb.from_srgb),
    ("srgb.to_srgb",): of_colours(srgb.to_srgb),
    ("transfer.displayed",): of_colours(lambda x: transfer.displayed(x, 2.2)),
    ("transfer.value_for",): of_colours(lambda x: transfer.value_for(x, 2.2)),
    ("interpolate.interpolate",): Contract(strategies.colours, between_colours),
    # Spectra
    ("spectrum.blackbody",): Contract(temperatures, lambda case: glow(case["kelvin"])),
    ("spectrum.sensor_response", "observer.luminance"): of_colours(
        lambda x: observer.luminance(x, WAVELENGTHS)
    ),
    ("observer.spectrum_to_xyz",): Contract(strategies.colours, against_a_white),
    ("metamer.metamer", "metamer.metameric_black"): Contract(strategies.colours, of_one_colour),
    ("dominant.dominant_wavelength",): of_colours(around_white(dominant.dominant_wavelength)),
    ("dominant.excitation_purity",): of_colours(around_white(dominant.excitation_purity)),
    # Lobes
    ("GGX", "Dielectric"): faceted(ds.GGX, lambda case: ds.Dielectric(case["index"])),
    ("Beckmann", "Conductor"): faceted(
        ds.Beckmann,
        lambda case: ds.Conductor(case["index"], case["extinction"]),
        masking="separable",
        rational=True,
    ),
    ("TorranceSparrow", "Schlick"): faceted(
        ds.TorranceSparrow, lambda case: ds.Schlick(case["f0"])
    ),
    ("FresnelBody",): faceted(ds.Beckmann, None),
    **{
        (f"distribution.{name}",): of_angles(getattr(distribution, name), "cosine", "alpha")
        for name in distribution.__all__
    },
    **{
        (f"masking.{name}",): of_angles(getattr(masking, name), "cosine", "alpha")
        for name in ("ggx_shadow", "beckmann_shadow", "rational_beckmann_shadow")
    },
    ("conversion.alpha_of",): of_angles(conversion.alpha_of, "shininess"),
    ("conversion.exponent_of",): of_angles(conversion.exponent_of, "alpha"),
    ("conversion.plain",): of_angles(conversion.plain, "f0", "shininess"),
    ("conversion.normalised",): of_angles(conversion.normalised, "f0", "shininess"),
    ("masking.separable",): of_angles(smith(masking.separable), *SMITH),
    ("masking.height_correlated",): of_angles(smith(masking.height_correlated), *SMITH),
    ("masking.v_groove",): Contract(grooved, of_grooves),
    ("fresnel.dielectric",): of_angles(fresnel.dielectric, "cosine", "index"),
    ("fresnel.conductor",): of_angles(fresnel.conductor, "cosine", "index", "extinction"),
    ("fresnel.schlick",): of_angles(fresnel.schlick, "cosine", "f0"),
    ("phong.phong",): lobe(phong.phong),
    ("phong.blurred",): of_angles(lambda n: phong.blurred(n, 5), "shininess"),
    ("blinn_phong.blinn_phong",): lobe(blinn_phong.blinn_phong),
}
